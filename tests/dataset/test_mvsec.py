"""MVSEC's layout against the simulator's truth, by h5py and numpy alone."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
from sequences import events_of, labels_of, simulated, written

import evis
from evis.dataset.layouts import reader_of
from evis.geometry import se3


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
                assert np.isnan(flow[name][k][~known]).all()
        assert np.isnan(flow["x_flow_dist"][4]).all()


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
