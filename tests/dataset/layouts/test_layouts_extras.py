"""Other people's readers open what is written: tonic, pycocotools, webdataset, zarr; more in test_layouts_peers.py."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sequences import events_of, framed, frames_of, labels_of, simulated, written

from evis.dataset.layouts.sample import EVENTS

pytestmark = pytest.mark.extras


def test_tonic_reads_dsec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Events, flow both ways, disparity and their times; it keeps each part in a folder of its own."""
    tonic: Any = pytest.importorskip("tonic", reason="tonic is not installed: make test-extras")
    imageio: Any = pytest.importorskip("imageio", reason="imageio is not installed: make test-extras")
    pytest.importorskip("png", reason="pypng is not installed: make test-extras")
    about, steps = simulated()
    written("dsec", tmp_path / "s", about, steps)
    recording = tmp_path / "DSEC" / "thun_00_a"
    places = {"events_left": "events/left"}
    places |= {f"optical_flow_{way}_event": f"flow/{way}" for way in ("forward", "backward")}
    for name, place in places.items():
        shutil.copytree(tmp_path / "s" / place, recording / name)
    for way in ("forward", "backward"):
        name = f"optical_flow_{way}_timestamps"
        (recording / name).mkdir()
        shutil.copy(tmp_path / f"s/flow/{way}_timestamps.txt", recording / name / f"thun_00_a_{name}.txt")

    def no_freeimage(*args: Any, **kwargs: Any) -> None:
        raise RuntimeError("no FreeImage here, and none is fetched")

    monkeypatch.setattr(imageio.plugins.freeimage, "download", lambda: None)
    monkeypatch.setattr(imageio.v2, "imread", no_freeimage)  # tonic takes pypng then
    targets = [f"optical_flow_{way}_{what}" for way in ("forward", "backward") for what in ("event", "timestamps")]
    (data,), target = tonic.datasets.DSEC(str(tmp_path), "thun_00_a", "events_left", targets)[0]
    want = events_of(steps, "cam0")
    assert np.array_equal(data["events_left"]["t"], want["t"] // 1000)
    for name in "xyp":
        assert np.array_equal(data["events_left"][name], want[name])
    for way, (images, times) in (("forward", target[:2]), ("backward", target[2:])):
        _, flows = labels_of(steps, "cam0", f"{way}_flow")
        _, valid = labels_of(steps, "cam0", f"{way}_valid")
        _, spans = labels_of(steps, "cam0", "flow_t")
        order = slice(None, None, 1 if way == "forward" else -1)
        assert times.tolist() == [(span // 1000)[order].tolist() for span in spans[1:]]
        for image, flow, known in zip(images, flows[1:], valid[1:], strict=True):
            seen = (known[0] > 0) & np.isfinite(flow[0]).all(-1)
            assert np.array_equal(image[..., 2], seen)
            assert np.abs(image[..., :2] - flow[0])[seen].max() <= 0.5 / 128


def test_tonic_reads_disparity_and_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a stereo pair, with the times of both."""
    tonic: Any = pytest.importorskip("tonic", reason="tonic is not installed: make test-extras")
    imageio: Any = pytest.importorskip("imageio", reason="imageio is not installed: make test-extras")
    about, plain = simulated("stereo_room", "depth")
    steps = framed(plain)
    written("dsec", tmp_path / "s", about, steps)
    name = "zurich_city_00_a"
    recording = tmp_path / "DSEC" / name
    places = {f"events_{side}": f"events/{side}" for side in ("left", "right")}
    places |= {f"images_rectified_{side}": f"images/{side}/rectified" for side in ("left", "right")}
    places |= {"disparity_event": "disparity/event"}
    for told, place in places.items():
        shutil.copytree(tmp_path / "s" / place, recording / told)
    for told, place in (("image_timestamps", "images"), ("disparity_timestamps", "disparity")):
        (recording / told).mkdir()
        shutil.copy(tmp_path / "s" / place / "timestamps.txt", recording / told / f"{name}_{told}.txt")
    monkeypatch.setattr(imageio.plugins.freeimage, "download", lambda: None)
    data = ["events_left", "events_right", "image_timestamps", "images_rectified_left", "images_rectified_right"]
    data, target = tonic.datasets.DSEC(str(tmp_path), name, data, ["disparity_event", "disparity_timestamps"])[0]
    for camera, read in zip(("left", "right"), data):
        want = events_of(steps, camera)
        assert np.array_equal(read[f"events_{camera}"]["t"], want["t"] // 1000)
        assert np.array_equal(read[f"events_{camera}"]["x"], want["x"])
    stamps, depths = labels_of(steps, "left", "depth")
    assert data[2].tolist() == target[1].tolist() == (stamps // 1000).tolist()
    for camera, images in zip(("left", "right"), data[3:]):
        assert np.array_equal(images, frames_of(steps, camera)[..., 0])
    focal_baseline = about.cameras["left"].k[0, 0] * about.cameras["right"].baseline
    assert np.abs(target[0] / 256 - focal_baseline / np.concatenate(depths)).max() <= 0.5 / 256


def test_pycocotools_reads_coco(tmp_path: Path) -> None:
    """Masks and boxes of every annotation."""
    coco: Any = pytest.importorskip("pycocotools.coco", reason="pycocotools is not installed: make test-extras")
    about, steps = simulated("warehouse", "boxes", "segmentation")
    written("coco", tmp_path / "s", about, steps)
    api = coco.COCO(str(tmp_path / "s/annotations/instances.json"))
    stamps, ids = labels_of(steps, "cam0", "segmentation")
    truth = dict(zip(stamps.tolist(), ids))
    assert len(api.getImgIds()) == len(stamps) and len(api.getCatIds()) > 10
    for image in api.loadImgs(api.getImgIds()):
        found = api.loadAnns(api.getAnnIds(imgIds=[image["id"]]))
        assert {a["track_id"] for a in found} == set(np.unique(truth[image["stamp_ns"]]).tolist()) - {0}
        for annotation in found:
            mask = api.annToMask(annotation).astype(bool)
            assert np.array_equal(mask, truth[image["stamp_ns"]][0] == annotation["track_id"])
            box = coco.maskUtils.toBbox(api.annToRLE(annotation))
            assert box.tolist() == annotation["bbox"]


def test_webdataset_streams_the_shards(tmp_path: Path) -> None:
    """Sample after sample, in order, as a pipe would bring them."""
    webdataset: Any = pytest.importorskip("webdataset", reason="webdataset is not installed: make test-extras")
    about, steps = simulated()
    written("webdataset", tmp_path / "s", about, steps)
    shards = [str(path) for path in sorted((tmp_path / "s").glob("*.tar"))]
    samples = list(webdataset.WebDataset(shards, shardshuffle=False).decode())
    assert [s["json"]["stamp_ns"] for s in samples[:-1]] == [step.stamp_ns for step in steps[:-1]]
    want = events_of(steps, "cam0")
    for name in "txyp":
        assert np.array_equal(np.concatenate([s["events.npz"][name] for s in samples]), want[name])
    for name in EVENTS:
        parts = [s["events.npz"][name] for s in samples if name in s["events.npz"]]
        assert np.concatenate(parts).tobytes() == np.concatenate(labels_of(steps, "cam0", name)[1]).tobytes()
    _, depths = labels_of(steps, "cam0", "depth")
    got = [s["depth.npz"]["depth"] for s in samples if "depth.npz" in s]
    assert np.array_equal(got, np.concatenate(depths))


def test_zarr_reads_zarr(tmp_path: Path) -> None:
    """The package itself, from the folder's root."""
    zarr: Any = pytest.importorskip("zarr", reason="zarr is not installed: make test-extras")
    about, steps = simulated()
    written("zarr", tmp_path / "s", about, steps)
    root, want = zarr.open_group(str(tmp_path / "s/sequence.zarr"), mode="r"), events_of(steps, "cam0")
    for name in "txyp":
        assert np.array_equal(root[f"cam0/events/{name}"][:], want[name])
    index = root["cam0/events/ms_to_idx"][:]
    assert np.array_equal(index, [np.count_nonzero(want["t"] < ms * 1_000_000) for ms in range(len(index))])
    assert root["cam0/depth/depth"].shape == (5, 48, 64) and root.attrs["scene"] == "spinning_disk"
