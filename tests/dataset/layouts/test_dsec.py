"""DSEC's layout against the simulator's truth, read by h5py, ffmpeg, PIL and numpy alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml
from PIL import Image as PilImage
from sequences import DURATION_NS, events_of, labels_of, simulated, written

from evis.dataset.about import About
from evis.dataset.layouts import LayoutError, reader_of, writer_of
from evis.dataset.layouts.rectification import Rectification
from evis.files import hdf5_rows
from evis.geometry.distortion import Lens, project
from msgs.camera import CameraInfo, Image
from msgs.header import Header


def colour16(path: Path) -> np.ndarray:
    """A 16 bit colour image as ffmpeg reads it, uint16 [H, W, 3]; Pillow has 8 bits of it."""
    av: Any = pytest.importorskip("av")
    with av.open(str(path)) as file:
        frame = next(file.decode(video=0))
        assert frame.format.name == "rgb48be"
        return np.asarray(frame.to_ndarray(), np.uint16)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: Any) -> Path:
    about, steps = simulated()
    return Path(written("dsec", tmp_path_factory.mktemp("dsec") / "s", about, steps).directory)


def test_the_index_is_right_at_every_millisecond(folder: Path) -> None:
    """t[ms_to_idx[ms]] >= 1000 ms, t[ms_to_idx[ms] - 1] < 1000 ms, up to the sequence's end."""
    _, steps = simulated()
    want = events_of(steps, "cam0")
    with h5py.File(folder / "events/left/events.h5") as file:
        events = {name: file[f"events/{name}"][:] for name in "txyp"}
        index, offset = file["ms_to_idx"][:], file["t_offset"][()]
        filters = file["events/t"].id.get_create_plist().get_filter(0)
    assert filters[0] == 32001  # Blosc, as DSEC has it
    assert {n: a.dtype for n, a in events.items()} == {"t": "u4", "x": "u2", "y": "u2", "p": "u1"}
    assert index.dtype == np.uint64 and offset.dtype == np.int64 and offset == 0
    assert np.array_equal(events["t"], want["t"] // 1000)
    assert all(np.array_equal(events[name], want[name]) for name in "xyp")
    assert len(index) == -(-DURATION_NS // 1_000_000) + 1
    marks = np.arange(len(index)) * 1_000_000
    assert np.array_equal(index, [np.count_nonzero(want["t"] < mark) for mark in marks])


@pytest.mark.parametrize("kind", ["forward_flow", "backward_flow"])
def test_labels_of_an_interval_without_any_have_the_shape_of_others(folder: Path, kind: str) -> None:
    reader = reader_of("dsec")(folder)
    all_of_them = reader.labels(kind, 0, 2 * DURATION_NS)
    stamp = int(all_of_them["t"][-1])
    none = reader.labels(kind, stamp + 1, stamp + 2)
    assert len(all_of_them["t"]) and not len(none["t"])
    joined = {name: np.concatenate([none[name], array]) for name, array in all_of_them.items()}
    assert all(np.array_equal(joined[name], array, equal_nan=True) for name, array in all_of_them.items())
    assert all(joined[name].dtype == none[name].dtype == array.dtype for name, array in all_of_them.items())


@pytest.mark.parametrize("way", ["forward", "backward"])
def test_flow_is_that_of_the_labels(folder: Path, way: str) -> None:
    """Where it is valid, to half of 1/128 px; the times are those of its two ends."""
    _, steps = simulated()
    _, flows = labels_of(steps, "cam0", f"{way}_flow")
    _, valid = labels_of(steps, "cam0", f"{way}_valid")
    _, times = labels_of(steps, "cam0", "flow_t")
    assert np.array_equal(times[0], [0, 0])  # of keyframe 0, which ends no interval: DSEC has none of it
    flows, valid, times = flows[1:], valid[1:], times[1:]
    text = (folder / f"flow/{way}_timestamps.txt").read_text().splitlines()
    assert text[0] == "# from_timestamp_us, to_timestamp_us"
    order = slice(None, None, 1 if way == "forward" else -1)
    assert text[1:] == [f"{a // 1000}, {b // 1000}" for a, b in (t[order] for t in times)]
    files = sorted((folder / "flow" / way).iterdir())
    assert [f.name for f in files] == [f"{k:06d}.png" for k in range(4)]
    for path, flow, ok in zip(files, flows, valid):
        codes = colour16(path)
        got = (codes[..., :2].astype(float) - 2**15) / 128
        want = (ok[0] == 1) & np.isfinite(flow[0]).all(-1)
        assert np.array_equal(codes[..., 2], want) and want.sum() > 1000
        assert np.abs(got - flow[0])[want].max() <= 0.5 / 128
        assert np.abs(flow[0][want]).max() > 1


def test_boxes_are_those_of_the_labels(tmp_path: Path) -> None:
    """DSEC-Det's fields, classes and instances by number."""
    about, steps = simulated("warehouse", "boxes")
    written("dsec", tmp_path / "s", about, steps)
    rows = np.load(tmp_path / "s/object_detections/left/tracks.npy")
    assert set(rows.dtype.names) == {"t", "x", "y", "h", "w", "class_id", "class_confidence", "track_id"}
    stamps, boxes = labels_of(steps, "cam0", "box")
    _, ids = labels_of(steps, "cam0", "box_id")
    want, semantic = np.concatenate(boxes), about.cameras["cam0"].semantic
    assert semantic is not None and len(rows) == len(want) > 400
    assert np.array_equal(rows["t"], np.repeat(stamps // 1000, [len(b) for b in boxes]))
    assert np.array_equal(rows["track_id"], np.concatenate(ids))
    got = np.stack((rows["x"], rows["y"], rows["x"] + rows["w"] - 1, rows["y"] + rows["h"] - 1), 1)
    assert np.array_equal(got, want) and (rows["class_confidence"] == 1).all()
    assert np.array_equal(rows["class_id"], semantic[np.concatenate(ids)] - 1) and len(np.unique(rows["class_id"])) > 5
    read = reader_of("dsec")(tmp_path / "s").labels("boxes", 0, 10**12)
    assert np.array_equal(read["box"], want) and np.array_equal(np.diff(read["offsets"]), [len(b) for b in boxes])
    assert np.array_equal(read["t"], stamps // 1000 * 1000)


def test_a_stereo_pair_has_disparity_and_calibration(tmp_path: Path) -> None:
    """Disparity is f b / z; both cameras' events are there, and Q makes the depth of it again."""
    about, steps = simulated("stereo_room", "depth")
    written("dsec", tmp_path / "s", about, steps)
    stamps, depths = labels_of(steps, "left", "depth")
    info, b = about.cameras["left"], about.cameras["right"].baseline
    assert (tmp_path / "s/disparity/timestamps.txt").read_text().split() == [str(t // 1000) for t in stamps]
    calibration = yaml.safe_load((tmp_path / "s/calibration/cam_to_cam.yaml").read_text())
    q = np.array(calibration["disparity_to_depth"]["cams_03"])
    for k, depth in enumerate(depths):
        with PilImage.open(tmp_path / f"s/disparity/event/{k:06d}.png") as image:
            codes = np.asarray(image).astype(np.uint16)
        want = info.k[0, 0] * b / depth[0].astype(float)
        known = np.isfinite(depth[0]) & (want * 256 >= 0.5)
        assert np.array_equal(codes > 0, known) and known.all()
        assert np.abs(codes / 256 - want)[known].max() <= 0.5 / 256
        point = q @ [10.0, 20.0, codes[20, 10] / 256, 1.0]
        assert point[2] / point[3] == pytest.approx(info.k[0, 0] * b / (codes[20, 10] / 256))
    assert calibration["extrinsics"]["T_21"][0] == [1.0, 0.0, 0.0, -0.06]
    assert calibration["intrinsics"]["cam0"]["resolution"] == [64, 48]
    reader = reader_of("dsec")(tmp_path / "s")
    for camera in ("left", "right"):
        want_t = events_of(steps, camera)["t"] // 1000 * 1000
        assert np.array_equal(reader.events(0, 10**12, camera).t, want_t) and len(want_t) > 100
    assert reader.kinds("left") == ("disparity",) and reader.kinds("right") == ()


def lens_info(coefficients: tuple[float, ...] = (-0.3, 0.1, 0.002, -0.001)) -> CameraInfo:
    """A camera with distortion."""
    k = np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])
    return CameraInfo(Header(0), k, np.array(coefficients), width=64, height=48, distortion_model="plumb_bob")


def test_rectified_positions_lead_back_to_the_pixel() -> None:
    """Through the projection with distortion; flow follows two points, and an image is moved by the same map."""
    info = lens_info()
    rectified, lens = Rectification(info), Lens.of("plumb_bob", info.distortion.tolist())
    rays = np.concatenate(((rectified.map - info.k[:2, 2]) / 60.0, np.ones((48, 64, 1))), -1)
    y, x = np.mgrid[:48, :64]
    assert np.abs(project(info.k, lens, rays) - np.stack((x, y), -1)).max() < 1e-4
    assert np.abs(rectified.map - np.stack((x, y), -1)).max() > 2  # there is something to take out
    places = rectified.image(np.stack((x, y), -1).astype(float), np.nan)
    seen = np.isfinite(places).all(-1)
    own = project(info.k, lens, np.stack(((x - 31.5) / 60, (y - 23.5) / 60, np.ones_like(x)), -1))
    assert seen.sum() > 2000 and np.abs(places - own)[seen].max() <= 0.5
    flow = rectified.flow(np.broadcast_to([1.5, -0.5], (48, 64, 2)))
    middle = rectified.map[24, 33]
    moved = rectified.rectified(np.array([34.5, 23.5])) - middle
    assert np.abs(flow[round(float(middle[1])), round(float(middle[0]))] - moved).max() < 1e-5


def test_frames_have_their_exposures(tmp_path: Path) -> None:
    """An image is stamped with the middle of its exposure; PIL reads its pixels."""
    about, steps = simulated("spinning_disk", "boxes")
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 255, (48, 64, 1), np.uint8) for _ in range(3)]
    writer = writer_of("dsec")(tmp_path / "s", about)
    for k, step in enumerate(steps[:3]):
        copy = type(step)(step.stamp_ns, step.episodes, {"cam0": vars(step.cameras["cam0"])}, {}, step.over)
        picture = Image(Header(step.stamp_ns + 5_000_000), pictures[k], "mono8", 4_000_000)
        vars(copy.cameras["cam0"])["image"] = picture
        writer.add(copy)
    writer.close()
    images = tmp_path / "s/images"
    assert (images / "timestamps.txt").read_text().split() == ["5000", "38333", "71666"]
    spans = (images / "left/exposure_timestamps.txt").read_text().splitlines()
    assert spans[1:] == ["3000, 7000", "36333, 40333", "69666, 73666"]
    for k, pixels in enumerate(pictures):
        for folder in ("rectified", "distorted"):  # dsec-det's loader looks for the latter
            with PilImage.open(images / f"left/{folder}/{k:06d}.png") as image:
                assert np.array_equal(np.asarray(image), pixels[..., 0])
    got = reader_of("dsec")(tmp_path / "s").labels("image", 38_000_000, 80_000_000)
    assert got["t"].tolist() == [38_333_000, 71_666_000] and got["exposure_ns"].tolist() == [4_000_000] * 2
    assert np.array_equal(got["image"], pictures[1:])


def rows_of_frames(boxes_us: np.ndarray, frames_us: np.ndarray) -> list[tuple[int, int]]:
    """The rows of tracks.npy that DSEC-Det gives each frame: it adds up the boxes of the frames before it."""
    counts = [int((boxes_us == frame).sum()) for frame in frames_us]
    return [(sum(counts[:k]), sum(counts[: k + 1])) for k in range(len(counts))]


@pytest.mark.parametrize(("late_us", "says"), [(0, "those of other stamps are left out"), (584, "here none has one")])
def test_dsec_det_gives_frames_their_own_boxes(late_us: int, says: str, tmp_path: Path) -> None:
    """The first frame comes after the first boxes; where no frame has the stamp of a box all stay, and it is said."""
    about, steps = simulated("warehouse", "boxes")
    writer = writer_of("dsec")(tmp_path / "s", about)
    for k, step in enumerate(steps):
        copy = type(step)(step.stamp_ns, step.episodes, {"cam0": vars(step.cameras["cam0"])}, {}, step.over)
        if k not in (0, 2):
            stamp = Header(step.stamp_ns + late_us * 1000)
            vars(copy.cameras["cam0"])["image"] = Image(stamp, np.zeros((48, 64, 1), np.uint8), "mono8", 1_000_000)
        writer.add(copy)
    writer.close()
    rows = np.load(tmp_path / "s/object_detections/left/tracks.npy")
    frames = np.loadtxt(tmp_path / "s/images/timestamps.txt", np.int64)
    for frame, (first, end) in zip(frames, rows_of_frames(rows["t"].astype(np.int64), frames)):
        assert (rows["t"][first:end] == frame).all() and (end > first) == (late_us == 0)
    stamps, boxes = labels_of(steps, "cam0", "box")
    want = [box for stamp, box in zip(stamps // 1000, boxes) if late_us or stamp in frames]
    assert np.array_equal(np.stack((rows["x"], rows["y"]), 1), np.concatenate(want)[:, :2])
    assert len(writer.notes) == 1 and says in writer.notes[0]


def test_each_camera_of_a_pair_has_the_times_of_its_own_frames(tmp_path: Path) -> None:
    """With auto-exposure they differ, and at the end one camera may have a frame more."""
    about, steps = simulated("stereo_room", "depth")
    middles = {"left": [604_000, 33_938_000], "right": [615_000, 33_950_000, 67_300_000]}
    exposures = {"left": [1_208_000, 1_210_000], "right": [1_230_000, 1_234_000, 1_300_000]}
    writer = writer_of("dsec")(tmp_path / "s", about)
    for k, step in enumerate(steps[:3]):
        cameras = {name: dict(vars(outputs)) for name, outputs in step.cameras.items()}
        for name in cameras:
            if k < len(middles[name]):
                pixels = np.full((48, 64, 1), k, np.uint8)
                cameras[name]["image"] = Image(Header(middles[name][k]), pixels, "mono8", exposures[name][k])
        writer.add(type(step)(step.stamp_ns, step.episodes, cameras, {}, step.over))
    writer.close()
    reader = reader_of("dsec")(tmp_path / "s")
    for camera, stamps in middles.items():
        got = reader.labels("image", 0, 10**9, camera)
        assert got["t"].tolist() == stamps == reader.stamps("image", camera)[:, 0].tolist()
        assert got["exposure_ns"].tolist() == exposures[camera]
        assert got["image"][:, 0, 0, 0].tolist() == list(range(len(stamps)))
    assert reader.labels("image", 33_940_000, 60_000_000, "right")["t"].tolist() == [33_950_000]


def test_a_later_start_is_the_offset(tmp_path: Path) -> None:
    """Times on disk count from it, and the reader's do not."""
    about, steps = simulated()
    later = dataclasses.replace(about, start_ns=33_333_333, duration_ns=DURATION_NS - 33_333_333)
    written("dsec", tmp_path / "s", later, steps[2:])
    want = events_of(steps[2:], "cam0")["t"]
    with h5py.File(tmp_path / "s/events/left/events.h5") as file:
        assert file["t_offset"][()] == 33_333 and np.array_equal(file["events/t"][:], want // 1000 - 33_333)
        index = file["ms_to_idx"][:]
        assert index[5] == np.count_nonzero(want < 38_333_000)
    reader = reader_of("dsec")(tmp_path / "s")
    assert np.array_equal(reader.events(0, 10**12).t, want // 1000 * 1000)
    part = (want // 1000 >= 50_001) & (want // 1000 < 60_000)
    assert np.array_equal(reader.events(50_000_500, 60_000_000).t, want[part] // 1000 * 1000)


def test_what_dsec_does_not_hold_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kinds of labels in notes; cameras that are no stereo pair are refused; without Blosc it is gzip."""
    about, steps = simulated()
    notes = written("dsec", tmp_path / "a", about, steps).notes
    assert "DSEC has no segmentation: it is left out" in notes
    assert any("needs a stereo pair" in note for note in notes)
    two = {"cam0": about.cameras["cam0"], "hand": about.cameras["cam0"]}
    with pytest.raises(LayoutError, match=r"DSEC and MVSEC hold one camera.*; a has cam0, hand"):
        writer_of("dsec")(tmp_path / "b", dataclasses.replace(about, cameras=two))
    monkeypatch.setitem(__import__("sys").modules, "hdf5plugin", None)
    writer = written("dsec", tmp_path / "c", about, steps)
    assert hdf5_rows.NO_BLOSC in writer.notes
    with h5py.File(tmp_path / "c/events/left/events.h5") as file:
        assert file["events/t"].compression == "gzip"
    lens = dataclasses.replace(about, cameras={"cam0": lens_info((-0.3, 0.1, 0.0, 0.0, 0.01))})
    assert any("4 coefficients of distortion" in note for note in writer_of("dsec")(tmp_path / "e", lens).notes)
    long = About("a", "s", {}, 0, 1, 30.0, about.cameras, start_ns=-(1 << 32) * 1000)
    with pytest.raises(LayoutError, match="DSEC's times end after 71 minutes"):
        written("dsec", tmp_path / "d", long, steps)


@pytest.mark.parametrize("layout", ["dsec", "mvsec"])
def test_flow_at_an_instant_is_told_from_that_over_an_interval(layout: str, tmp_path: Path) -> None:
    """Both layouts hold flow: that they had none was said of labels in px/s."""
    notes = written(layout, tmp_path / "s", *simulated("spinning_disk", "flow")).notes
    said = f"{layout.upper()}'s flow is over an interval, labels forward_flow; flow, in px/s, is left out"
    assert said in notes and not any("has no flow" in note for note in notes)
