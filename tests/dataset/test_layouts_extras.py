"""Other people's readers open what is written: tonic, pycocotools, webdataset, zarr, and DSEC's public loader."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sequences import events_of, labels_of, simulated, written

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


def test_the_loader_of_dsec_reads_a_stereo_sequence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """uzh-rpg/DSEC, scripts/dataset/sequence.py, at its sensor's 640 x 480: disparity and windows of events."""
    peers = os.environ.get("EVIS_PEERS", "")
    scripts = Path(peers) / "DSEC" / "scripts"
    if not (peers and scripts.is_dir()):
        pytest.skip("EVIS_PEERS names no folder with a checkout of uzh-rpg/DSEC in DSEC/")
    for package in ("torch", "cv2", "numba"):
        pytest.importorskip(package, reason=f"{package} is not installed: make test-extras")
    monkeypatch.syspath_prepend(str(scripts))
    for name in [n for n in sys.modules if n.partition(".")[0] in ("dataset", "utils")]:
        monkeypatch.delitem(sys.modules, name)
    from dataset.sequence import Sequence  # type: ignore[import-not-found]
    from utils.eventslicer import EventSlicer  # type: ignore[import-not-found]

    about, steps = simulated("stereo_room", "depth", width=640, height=480)
    written("dsec", tmp_path / "s", about, steps)
    sequence = Sequence(tmp_path / "s", "train", 20, 15)
    stamps, depths = labels_of(steps, "left", "depth")
    assert len(sequence) == len(stamps) - 1  # it leaves the first out, before which there are no events
    focal_baseline = about.cameras["left"].k[0, 0] * about.cameras["right"].baseline
    for k in range(len(sequence)):
        item = sequence[k]
        want = focal_baseline / depths[k + 1][0]
        assert np.abs(item["disparity_gt"] - want)[want >= 1 / 256].max() <= 0.5 / 256 + 1e-5
        assert item["representation"]["left"].shape == (15, 480, 640) and bool(item["representation"]["left"].any())
    import h5py

    for camera in ("left", "right"):
        truth = events_of(steps, camera)
        t = truth["t"] // 1000
        with h5py.File(tmp_path / "s" / "events" / camera / "events.h5") as file:
            slicer = EventSlicer(file)
            for start, end in ((0, 10_000), (12_345, 54_321), (99_999, 133_333)):
                got, part = slicer.get_events(start, end), (t >= start) & (t < end)
                assert np.array_equal(got["t"], t[part]) and np.array_equal(got["x"], truth["x"][part])


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
