"""Loaders of DSEC, DSEC-Det and MVSEC, of their own authors, open what is written and find the truth.

EVIS_PEERS names a folder with checkouts of uzh-rpg/DSEC, uzh-rpg/dsec-det and daniilidis-group/EV-FlowNet.
"""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import known_motion
import numpy as np
import pytest
import yaml
from sequences import events_of, framed, frames_of, labels_of, simulated, written

from evis.events.arrays import Events
from evis.events.files.hdf5.dsec_events import EventFile

pytestmark = pytest.mark.extras


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports a module of a checkout, or skips the test and says which checkout there is not.

    stands_for: packages that the module imports and the test has no use of, if they are not installed.
    """

    def load(checkout: str, folder: str, module: str, **stands_for: ModuleType) -> Any:
        place = Path(os.environ.get("EVIS_PEERS", "")) / checkout / folder
        if not os.environ.get("EVIS_PEERS") or not place.is_dir():
            pytest.skip(f"EVIS_PEERS names no folder with a checkout in {checkout}/")
        for package in ("torch", "cv2", "numba"):
            pytest.importorskip(package, reason=f"{package} is not installed: make test-extras")
        for name, thing in stands_for.items():
            monkeypatch.setitem(sys.modules, name, thing)
        monkeypatch.syspath_prepend(str(place))
        for name in [n for n in sys.modules if n.partition(".")[0] in ("dataset", "utils", "dsec_det", "eval_utils")]:
            monkeypatch.delitem(sys.modules, name)
        return importlib.import_module(module)

    return load


def test_dsec_reads_disparity_and_voxels_of_a_stereo_pair(peer: Any, tmp_path: Path) -> None:
    """Sequence of scripts/dataset/sequence.py, at its sensor's 640 x 480."""
    sequences = peer("DSEC", "scripts", "dataset.sequence")
    about, steps = simulated("stereo_room", "depth", width=640, height=480)
    written("dsec", tmp_path / "s", about, steps)
    sequence = sequences.Sequence(tmp_path / "s", "train", 20, 15)
    stamps, depths = labels_of(steps, "left", "depth")
    assert len(sequence) == len(stamps) - 1  # it leaves the first out, before which there are no events
    focal_baseline = about.cameras["left"].k[0, 0] * about.cameras["right"].baseline
    for k in range(len(sequence)):
        item = sequence[k]
        want = focal_baseline / depths[k + 1][0]
        assert np.abs(item["disparity_gt"] - want)[want >= 1 / 256].max() <= 0.5 / 256 + 1e-5
        assert item["representation"]["left"].shape == (15, 480, 640) and bool(item["representation"]["left"].any())
    for camera in ("left", "right"):
        truth = events_of(steps, camera)
        t = truth["t"] // 1000
        with h5py.File(tmp_path / "s" / "events" / camera / "events.h5") as file:
            slicer = sequences.EventSlicer(file)
            for start, end in ((0, 10_000), (12_345, 54_321), (99_999, 133_333), (50_000, 50_001)):
                got, part = slicer.get_events(start, end), (t >= start) & (t < end)
                assert np.array_equal(got["t"], t[part]) and np.array_equal(got["x"], truth["x"][part])


@pytest.mark.parametrize("start_us", [0, 1_700_123])
def test_dsec_slices_sparse_events(peer: Any, tmp_path: Path, start_us: int) -> None:
    """Windows of events that are milliseconds apart, from an offset; it needs an event in each, between whole ms."""
    slicing = peer("DSEC", "scripts", "utils.eventslicer")
    t = np.array([0, 500, 2100, 5000, 5000, 7100, 7200, 7200, 8100, 9000]) + start_us
    n = np.arange(len(t))
    file = EventFile(tmp_path / "events.h5", start_us)
    file.add(Events(t * 1000, n.astype(np.uint16), n.astype(np.uint16), (n % 2).astype(np.uint8)))
    file.finish((start_us + 12_000) * 1000)
    with h5py.File(tmp_path / "events.h5") as read:
        slicer = slicing.EventSlicer(read)
        # The example of its own comment.
        assert slicer.ms_to_idx[:10].tolist() == [0, 2, 2, 3, 3, 3, 5, 5, 8, 9]
        assert (slicer.get_start_time_us(), slicer.get_final_time_us()) == (start_us, start_us + 9000)
        for first, end in ((0, 12_000), (100, 2200), (2000, 5001), (4999, 7200), (5000, 5001), (7050, 9000)):
            got = slicer.get_events(start_us + first, start_us + end)
            part = (t >= start_us + first) & (t < start_us + end)
            assert got["t"].tolist() == t[part].tolist() and got["x"].tolist() == n[part].tolist()
        assert slicer.get_events(start_us, start_us + 13_000) is None  # beyond the sequence


def test_dsec_reads_flow_of_a_known_motion(peer: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its conversion of the 16 bit PNG, of what the closed form says."""
    imageio: Any = pytest.importorskip("imageio", reason="imageio is not installed: make test-extras")
    monkeypatch.setattr(imageio.plugins.freeimage, "download", lambda: None, raising=False)
    checking = peer("DSEC", "scripts", "check_optical_flow_submission")
    import cv2

    about, steps = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    written("dsec", tmp_path / "s", about, steps)
    for way in ("forward", "backward"):
        spans = np.loadtxt(tmp_path / f"s/flow/{way}_timestamps.txt", np.int64, delimiter=",")
        for k, (start, end) in enumerate((spans * 1000).tolist()):
            codes = cv2.imread(str(tmp_path / f"s/flow/{way}/{k:06d}.png"), cv2.IMREAD_UNCHANGED)
            flow, valid = checking.flow_16bit_to_float(np.flip(codes, -1), valid_in_3rd_channel=True)
            want, card = known_motion.flow(start, end, 64, 48)
            assert np.abs(flow - want)[valid].max() <= 0.5 / 128 + 1e-3 and valid[card].all()


def test_dsec_det_reads_frames_events_and_boxes(peer: Any, tmp_path: Path) -> None:
    """Its data set's samples: boxes of the frame's stamp as the closed form has them; and what it draws of them."""
    colours = ModuleType("seaborn")
    colours.color_palette = lambda *_: [(0.5, 0.5, 0.5)] * 8  # type: ignore[attr-defined]
    detection = peer("dsec-det", "src", "dsec_det.dataset", seaborn=colours)
    about, plain = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    steps = framed(plain)
    written("dsec", tmp_path / "train" / "s", about, steps)
    found, frames = detection.DSECDet(tmp_path, "train", sync="back", debug=True), frames_of(steps, "cam0")
    stamps, truth = labels_of(steps, "cam0", "box")[0] // 1000, events_of(steps, "cam0")
    assert len(found) == len(frames) - 1 == 4
    for k in range(len(found)):
        item = found[k]
        assert np.array_equal(item["image"], np.repeat(frames[k], 3, -1))
        (card,) = item["tracks"][item["tracks"]["class_id"] == known_motion.CAR - 1]
        x0, y0, x1, y1 = known_motion.box(int(stamps[k]) * 1000, 64, 48)
        assert [card[n] for n in "txywh"] == [stamps[k], x0, y0, x1 - x0 + 1, y1 - y0 + 1]
        start, end = (stamps[[k, k + 1]] // 1000).tolist()  # it cuts at whole milliseconds
        part = (truth["t"] >= start * 1_000_000) & (truth["t"] < end * 1_000_000)
        assert np.array_equal(item["events"]["t"], truth["t"][part] // 1000) and part.sum() > 50
        assert item["debug"].shape == (48, 64, 3) and not np.array_equal(item["debug"], item["image"])


def test_dsec_det_maps_rectified_frames_to_the_sensor(peer: Any, tmp_path: Path) -> None:
    """By our calibration, it finds the map of rectified positions that we wrote."""
    remapping = peer("dsec-det", "src", "dsec_det.remapping")
    about, steps = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    written("dsec", tmp_path / "s", about, steps)
    calibration = yaml.safe_load((tmp_path / "s/calibration/cam_to_cam.yaml").read_text())
    with h5py.File(tmp_path / "s/events/left/rectify_map.h5") as file:
        rectified = file["rectify_map"][:]
    assert np.abs(remapping.compute_remapping(calibration, {"rectify_map": rectified}) - rectified).max() < 1e-3


def test_ev_flownet_reads_the_flow_of_mvsec(peer: Any, tmp_path: Path) -> None:
    """Between any two times: within an interval in proportion, over several from pixel to pixel; its error is small."""
    evaluation = peer("EV-FlowNet", "src", "eval_utils", tensorflow=ModuleType("tensorflow"))
    about, steps = simulated(known_motion.SCENE, "forward_flow", "backward_flow", "boxes")
    written("mvsec", tmp_path / "s", about, steps)
    with np.load(tmp_path / "s/a_gt_flow_dist.npz") as archive:
        x, y, t = (archive[name] for name in ("x_flow_dist", "y_flow_dist", "timestamps"))
    for start, end, tolerance in ((t[1], (t[1] + t[2]) / 2, 0.05), (t[1], t[3] - 1e-9, 0.2)):
        got = np.stack(evaluation.estimate_corresponding_gt_flow(x, y, t, start, end), -1)
        want, card = known_motion.flow(round(start * 1e9), round(end * 1e9), 64, 48)
        # A displacement over part of an interval is not quite in proportion; over two it is that of the nearest pixel.
        left, top, right, bottom = known_motion.edges(round(start * 1e9), 64, 48)
        rows, columns = np.mgrid[:48, :64]
        seen = card & (columns > left + 1) & (columns < right - 1) & (rows > top + 1) & (rows < bottom - 1)
        assert np.abs(got - want)[seen].max() < tolerance and np.hypot(*want[seen].T).min() > 1
        error, within_3px, count = evaluation.flow_error_dense(got, want, seen.astype(np.uint8))
        assert error < tolerance and within_3px > 0.99 and count == seen.sum()
