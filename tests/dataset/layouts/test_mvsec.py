"""MVSEC's layout against the simulator's truth, by h5py and numpy alone; the facts are those of its own converter."""

from __future__ import annotations

from pathlib import Path

import h5py
import known_motion
import numpy as np
from sequences import events_of, labels_of, simulated, written

import evis
from evis.dataset.layouts import reader_of, writer_of
from evis.geometry import se3
from msgs.camera import Image
from msgs.header import Header


def test_a_sequence_as_mvsec_has_it(tmp_path: Path) -> None:
    """Events, depth, pose and flow, each with its times in seconds."""
    about, steps = simulated()
    written("mvsec", tmp_path / "s", about, steps)
    want = events_of(steps, "cam0")
    with h5py.File(tmp_path / "s/a_data.hdf5") as file:
        rows = file["davis/left/events"][:]
    assert rows.dtype == np.float64 and np.array_equal(rows[:, :2], np.stack((want["x"], want["y"]), 1))
    assert np.array_equal(np.rint(rows[:, 2] * 1e9), want["t"])
    assert np.array_equal(rows[:, 3], np.where(want["p"] > 0, 1, -1))
    stamps, depths = labels_of(steps, "cam0", "depth")
    _, poses = labels_of(steps, "cam0", "pose")
    with h5py.File(tmp_path / "s/a_gt.hdf5") as file:
        group = file["davis/left"]
        assert np.array_equal(np.rint(group["depth_image_raw_ts"][:] * 1e9), stamps)
        got, depth = group["depth_image_raw"][:], np.concatenate(depths)
        assert np.array_equal(np.nan_to_num(got, nan=np.inf), depth)
        assert np.array_equal(group["depth_image_rect"][:], got, equal_nan=True)  # of a lens without distortion
        assert np.array_equal(group["depth_image_rect_ts"][:], group["depth_image_raw_ts"][:])
        matrices = group["pose"][:]
    names = steps[2].labels.names if steps[2].labels is not None else []
    point = np.array([0.3, -0.2, 1.7])
    for pose, made in zip(poses, matrices):
        assert np.allclose((made @ [*point, 1])[:3], se3.transform(pose[0][names.index("cam0")], point), atol=1e-12)
    with np.load(tmp_path / "s/a_gt_flow_dist.npz") as flow:
        assert np.array_equal(np.rint(flow["timestamps"] * 1e9), stamps)
        _, flows = labels_of(steps, "cam0", "forward_flow")
        _, valid = labels_of(steps, "cam0", "forward_valid")
        for k in range(4):
            for axis, name in enumerate(("x_flow_dist", "y_flow_dist")):
                known = valid[k + 1][0] > 0
                assert np.array_equal(flow[name][k][known], flows[k + 1][0][known][:, axis]) and known.any()
                assert not flow[name][k][~known].any()
        assert not flow["x_flow_dist"][4].any() and flow["y_flow_dist"].dtype == np.float64
        whole = np.stack((flow["x_flow_dist"], flow["y_flow_dist"]), 1)
    with h5py.File(tmp_path / "s/a_gt.hdf5") as file:
        assert np.array_equal(file["davis/left/flow_dist"][:], whole)  # [T, 2, H, W]
        assert np.array_equal(np.rint(file["davis/left/flow_dist_ts"][:] * 1e9), stamps)


def test_flow_is_0_where_it_is_not_known(tmp_path: Path) -> None:
    """What is covered or leaves the image; and what stands still, which is said."""
    about, steps = simulated(known_motion.SCENE, "forward_flow", "boxes")
    notes = written("mvsec", tmp_path / "s", about, steps).notes
    assert notes == [
        "MVSEC has no boxes: it is left out",
        "MVSEC's flow is 0 where it is unknown: what stands still is not told from it",
    ]
    _, valid = labels_of(steps, "cam0", "forward_valid")
    _, flows = labels_of(steps, "cam0", "forward_flow")
    got = reader_of("mvsec")(tmp_path / "s").labels("forward_flow", 0, 10**12)
    for k, (start, end) in enumerate(got["flow_t"].tolist()):
        want, card = known_motion.flow(start, end, 64, 48)
        seen = valid[k + 1][0] > 0
        assert np.abs(got["forward_flow"][k] - want)[seen].max() < 1e-4 and (seen & card).sum() > 100
        assert not got["forward_flow"][k][~seen].any() and (~seen).sum() > 20
        moves = flows[k + 1][0].any(-1)
        assert np.array_equal(got["forward_valid"][k] > 0, seen & moves) and (seen & ~moves).any()


def test_images_know_the_event_before_them(tmp_path: Path) -> None:
    """Its number is searchsorted - 1, as the converter finds it, also for frames exposed long before their step."""
    about, steps = simulated(known_motion.SCENE, "forward_flow", "boxes")
    stamps = [-5_000_000, 20_000_000, 33_333_333, 66_000_000, 70_123_456]
    writer = writer_of("mvsec")(tmp_path / "s", about)
    for step, stamp in zip(steps, stamps):
        image = Image(Header(stamp), np.full((48, 64, 1), 9, np.uint8), "mono8", 1_000_000)
        outputs = {"cam0": {**vars(step.cameras["cam0"]), "image": image}}
        writer.add(type(step)(step.stamp_ns, step.episodes, outputs, {}, step.over))
    writer.close()
    with h5py.File(tmp_path / "s/a_data.hdf5") as file:
        group = file["davis/left"]
        times, inds = group["events"][:, 2], group["image_raw_event_inds"]
        assert (
            inds.dtype == np.int64 and group["image_raw"].dtype == np.uint8 and group["image_raw"].shape == (5, 48, 64)
        )
        want = np.searchsorted(times, np.array(stamps) * 1e-9) - 1
        assert want[0] == -1 and len(set(want.tolist())) == 5  # none before the first: it has the first event
        assert inds[:].tolist() == np.maximum(want, 0).tolist()


def test_its_reader_and_evis_open_read_it(tmp_path: Path) -> None:
    """Labels in part of the time; and the events as of any recording."""
    about, steps = simulated()
    written("mvsec", tmp_path / "s", about, steps)
    reader, (stamps, depths) = reader_of("mvsec")(tmp_path / "s"), labels_of(steps, "cam0", "depth")
    got = reader.labels("depth", int(stamps[1]), int(stamps[3]))
    assert np.array_equal(got["depth"], np.concatenate(depths[1:3])) and np.array_equal(got["t"], stamps[1:3])
    assert np.array_equal(evis.open(tmp_path / "s/a_data.hdf5").numpy()["t"], events_of(steps, "cam0")["t"])
    flow = reader.labels("forward_flow", 0, int(stamps[2]) + 1)
    assert np.array_equal(flow["flow_t"], [stamps[:2], stamps[1:3]])
