"""Depth, ids and labels of a bag as EXR and PNG, read back by OpenEXR and PIL."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from evis.bag import BagError
from evis.bag.export.topics import export
from evis.bag.writer import BagWriter
from evis.cli import main
from msgs.camera import Depth, Ids, Labels, Motion
from msgs.header import Header

RNG = np.random.default_rng(7)
DEPTH = RNG.uniform(0.1, 60, (1, 9, 11)).astype(np.float32)
DEPTH[0, 2, 2], DEPTH[0, 3, 3] = np.inf, 70.0
IDS = RNG.integers(0, 60_000, (1, 9, 11)).astype(np.int32)
FLOW = RNG.normal(size=(1, 5, 7, 2)).astype(np.float32)
FLOW[0, 1, :2] = [[300.0, 1.0], [1.0, -257.0]]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Images with a margin of 2, and labels without."""
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/depth", Depth(Header(40), DEPTH, margin=2))
        writer.write("/cam0/ids", Ids(Header(40), IDS, margin=2))
        writer.write("/cam0/labels", Labels(Header(40)))  # none yet: no file
        valid = (FLOW[..., 0] > 0).astype(np.uint8)
        writer.write("/cam0/labels", Labels(Header(50), forward_flow=FLOW, forward_valid=valid, depth=DEPTH[:, :5, :7]))
    return tmp_path / "a.mcap"


def channels(path: Path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path)) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def test_exr_of_each(bag: Path, tmp_path: Path) -> None:
    """Exactly, without margin."""
    export(bag, "/cam0/depth", tmp_path / "d")
    assert np.array_equal(channels(tmp_path / "d/000000.exr")["Z"], DEPTH[0, 2:-2, 2:-2])
    export(bag, "/cam0/ids", tmp_path / "i")
    assert np.array_equal(channels(tmp_path / "i/000000.exr")["id"], IDS[0, 2:-2, 2:-2])
    told = export(bag, "/cam0/labels", tmp_path / "l")
    assert told["images"] == 1 and told["channels"] == ["Z", "forward_flow.x", "forward_flow.y", "forward_valid"]
    got = channels(tmp_path / "l/000000.exr")
    assert np.array_equal(got["forward_flow.y"], FLOW[0, ..., 1])
    assert np.array_equal(got["forward_valid"], FLOW[0, ..., 0] > 0)


def test_png_of_depth_and_ids(bag: Path, tmp_path: Path) -> None:
    """Whole millimetres; what is too far is counted, the sky is not."""
    told = export(bag, "/cam0/depth", tmp_path / "d", as_png=True)
    inner = DEPTH[0, 2:-2, 2:-2].astype(float)
    with Image.open(tmp_path / "d/000000.png") as image:
        got = np.asarray(image).astype(int)
    near = inner < 65
    assert told["too_far"] == 1 and (got[~near] == 0).all() and (~near).sum() == 2
    assert np.abs(got[near] - inner[near] * 1000).max() <= 0.5 + 1e-6
    export(bag, "/cam0/ids", tmp_path / "i", as_png=True)
    with Image.open(tmp_path / "i/000000.png") as image:
        assert np.array_equal(np.asarray(image), IDS[0, 2:-2, 2:-2])
    assert (tmp_path / "d/times.txt").read_text() == (tmp_path / "i/times.txt").read_text() == "000000.png 40\n"
    with pytest.raises(BagError, match="PNG of whole numbers is of depth, ids and flow to a folder"):
        export(bag, "/cam0/depth", tmp_path / "d.npz", as_png=True)


def test_png_of_flow_and_labels(bag: Path, tmp_path: Path) -> None:
    """A folder for each kind; flow as DSEC codes it, what does not fit is not valid and counted."""
    told = export(bag, "/cam0/labels", tmp_path / "l", as_png=True)
    assert told["folders"] == ["depth", "forward_flow"] and told["images"] == 2 and told["too_far"] == 1
    assert told["too_fast"] == 2 and (tmp_path / "l/forward_flow/times.txt").read_text() == "000000.png 50\n"
    codes = cv2.imread(str(tmp_path / "l/forward_flow/000000.png"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    fits = (np.abs(FLOW[0]) < 256).all(-1)
    known = (FLOW[0, ..., 0] > 0) & fits
    assert codes.dtype == np.uint16 and np.array_equal(codes[..., 2], known) and known.sum() > 5
    assert np.abs((codes[..., :2].astype(float) - 2**15) / 128 - FLOW[0])[known].max() <= 0.5 / 128
    with Image.open(tmp_path / "l/depth/000000.png") as image:
        assert np.asarray(image).shape == (5, 7)


def test_png_of_motion(tmp_path: Path) -> None:
    """Backward vectors in px, without margin; NaN is not valid and not counted."""
    moved = np.full((1, 9, 11, 2), 1.5, np.float32)
    moved[0, 4, 5], moved[0, 4, 6] = np.nan, 300.0
    with BagWriter(tmp_path / "a.mcap") as writer:
        writer.write("/cam0/motion", Motion(Header(40), moved, margin=2))
    told = export(tmp_path / "a.mcap", "/cam0/motion", tmp_path / "m", as_png=True)
    codes = cv2.imread(str(tmp_path / "m/000000.png"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert told["too_fast"] == 1 and told["folders"] == [] and codes.shape == (5, 7, 3)
    assert codes[2, 3, 2] == codes[2, 4, 2] == 0 and codes[..., 2].sum() == 33
    assert (codes[..., :2][codes[..., 2] == 1] == 2**15 + 192).all()


def test_images_of_a_kind_that_cannot_be_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Another program's bag is whole: what is said names their encoding, and does not call it damaged."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](1, 0), "cam")
    image = store.types["sensor_msgs/msg/Image"](header, 2, 3, "16SC1", 0, 6, np.zeros(12, np.uint8))
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/depth", image.__msgtype__, typestore=store)
        writer.write(topic, 10**9, store.serialize_cdr(image, image.__msgtype__))
    assert main(["bag", "export", str(tmp_path / "b" / "b.mcap"), "--topic", "/depth", str(tmp_path / "o")]) == 0
    told = capsys.readouterr().err
    assert "1 chunks or messages cannot be read" in told and "encoding '16SC1' are not supported" in told
    assert "is damaged" not in told
