"""Labels of whole graphs, out of their bags: aligned with the events, which are those of a graph without labels."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys

import numpy as np
import pytest

from evis.bag.export.topics import export
from evis.bag.reader import BagReader
from evis.geometry import pinhole, se3
from evis.launch.planner import Options, plan_target
from evis.runtime.executor import Executor
from evis.runtime.plan import COMPOSED
from evis.scene.load import load_scene
from evis.supervisor.run_directory import RunDirectory


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs a scene composed in this process; gives its bag."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    number = iter(range(9))

    def launch(scene, **arguments):
        bag = tmp_path / f"{next(number)}.mcap"
        given = {"width": 48, "height": 36, "audit": 0, "seed": 5, **arguments}
        plan = plan_target(scene, given, Options(0.1, str(bag), view=False, grouping="compose"))
        directory = RunDirectory()
        plan.run_id, plan.directory = directory.run_id, str(directory.path)
        executor = Executor(plan, COMPOSED)
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                executor.setup()
                executor.run()
        finally:
            executor.close()
            directory.close()
        return bag

    return launch


def archive(bag, topic):
    out = bag.with_suffix(".npz")
    export(bag, topic, out)
    with np.load(out) as found:
        return {name: found[name] for name in found}


def packets(bag, topic="/cam0/events"):
    with BagReader(bag) as reader:
        return [message for _, message in reader.messages([topic])]


def flow_on_disk(x, y):
    """The flow px/s of the points of the disk's plane that pixels see, at 30 rad/s about the disk's axis."""
    scene = load_scene("spinning_disk", {"width": 48, "height": 36, "omega": 30}, textures=False)
    disk, eye = (scene.bodies[scene.body_index(n)].trajectory.pose(np.zeros(1, np.int64))[0] for n in ("disk", "cam0"))
    k, into = scene.cameras[0].k, se3.inverse(eye)
    rays = pinhole.unproject(k, np.stack((x, y), -1).astype(float), np.ones(len(x)))
    centre, axis = se3.transform(into, disk[:3]), se3.rotate(into[3:], se3.rotate(disk[3:], np.array([0, 0, 1.0])))
    points = rays * (centre @ axis / (rays @ axis))[:, None]
    step = 1e-6 * se3.cross(30.0 * np.broadcast_to(axis, points.shape), points - centre)
    return (pinhole.project(k, points + step) - pinhole.project(k, points - step)) / 2e-6


@pytest.mark.parametrize("crossing", ["linear", "cubic"])
def test_events_of_a_scene_are_labelled_where_they_are(run, crossing):
    """Two environments, noise, a margin and a sensor that looks ahead, whose last packet has the stamp of the one
    before; the disk turns at 30 rad/s in its plane, and the camera is still: flow is that of omega x r."""
    words = {"envs": 2, "crossing": crossing, "margin": 3, "omega": 30}
    words |= {"shot_rate": 20.0, "leak_rate": 1.0} if crossing == "linear" else {}
    labelled, plain = run("spinning_disk", labels="events", **words), run("spinning_disk", **words)
    whole = packets(labelled)
    for one, other in zip(whole, packets(plain), strict=True):
        assert all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in "txyp")
    assert len(whole) == (4 if crossing == "linear" else 5)
    for env in (0, 1):
        found = archive(labelled, f"/env{env}/cam0/labels")
        cut = [slice(*m.env_offsets[env : env + 2]) for m in whole]
        for name in "txyp":
            expected = np.concatenate([getattr(m, name)[part] for m, part in zip(whole, cut)])
            assert found[f"event_{name}"].tobytes() == expected.tobytes()
        assert found["event_offsets"].tolist()[-1] == len(found["event_t"]) > 500
        assert found["event_signal"].dtype == np.uint8 and 0.5 < found["event_signal"].mean() <= 1
        assert found["event_signal"].all() == (crossing == "cubic")
        with BagReader(labelled) as reader:
            info = next(m for _, m in reader.messages(["/cam0/info"]))
        on_disk = found["event_instance"] == info.instances.index("disk")
        assert on_disk.sum() > 300 and set(np.unique(found["event_instance"])) <= set(range(len(info.instances)))
        flow = flow_on_disk(found["event_x"][on_disk], found["event_y"][on_disk])
        assert np.abs(flow).max() > 50
        assert np.abs(found["event_flow"][on_disk] - flow).max() < 1e-5 * np.abs(flow).max()
        still = found["event_instance"] == info.instances.index("wall")
        assert not found["event_flow"][still].any()


def test_every_camera_labels_its_own_events(run):
    bag = run("stereo_room", labels="events,boxes3d,boxes")
    for camera in ("left", "right"):
        found = archive(bag, f"/{camera}/labels")
        assert (
            len(found["event_t"])
            == sum(len(m.t) for m in packets(bag, f"/{camera}/events"))
            == len(found["event_flow"])
        )
        assert found["event_signal"].all() and (found["event_instance"] > 0).mean() > 0.9
        # What is seen in 2-D has a box in 3-D; that in the camera's frame is the same box.
        assert set(found["box_id"]) <= set(found["box3d_id"])
        assert (found["box3d_in_camera"][found["box3d_id"] == found["box_id"][0], 2] > 0).any()


def test_joints_and_accelerations_of_a_robot(run):
    """As arguments of the launch file; joints stand in /state at every sub-step and in the labels at the stamp."""
    bag = run("robot_arm", labels="joints,accelerations,forward_flow", joints=True, flow_from=0.25, flow_to=0.75)
    found = archive(bag, "/cam0/labels")
    states = packets(bag, "/state")
    assert [s.qpos.shape[1] == len(s.t) for s in states] == [True] * 4
    assert np.array_equal(found["qpos"], [s.qpos[0, -1] for s in states])
    assert np.array_equal(found["qvel"], [s.qvel[0, -1] for s in states])
    assert found["acceleration"].shape == (4, len(found["names"]), 6) and np.abs(found["acceleration"]).max() > 0.1
    gap = np.array([[s.t[0], s.t[-1]] for s in states])
    assert np.array_equal(found["flow_t"], gap[:, :1] + np.round(np.diff(gap) * [0.25, 0.75]).astype(np.int64))
    assert found["forward_flow"].shape == (4, 36, 48, 2) and found["forward_valid"].mean() > 0.5
    assert "backward_flow" not in found
    assert np.isfinite(found["acceleration"]).all()


@pytest.mark.gpu
@pytest.mark.parametrize("scene, envs", [("drone", 1), ("spinning_disk", 3)])
def test_labels_of_a_gpu_are_those_of_a_cpu(run, scene, envs):
    """Where both see the same instance: silhouettes differ by rounding in a few pixels of a thousand."""
    given = {"labels": ["flow", "depth", "segmentation", "semantic", "boxes"], "envs": envs}
    topic = "/env2/cam0/labels" if envs > 1 else "/cam0/labels"
    there, here = (archive(run(scene, device=device, **given), topic) for device in ("cuda", "cpu"))
    assert there.keys() == here.keys() and len(here["flow"]) == 4
    same = there["segmentation"] == here["segmentation"]
    assert same.mean() > 0.99
    assert np.array_equal(there["semantic"][same], here["semantic"][same])
    # The two rasters round depths in float32 each in its own way.
    np.testing.assert_allclose(there["depth"][same], here["depth"][same], rtol=1e-3)
    assert np.array_equal(np.isnan(there["flow"][same]), np.isnan(here["flow"][same]))
    known = same & np.isfinite(here["flow"]).all(-1)
    assert known.mean() > 0.05
    close = np.isclose(there["flow"][known], here["flow"][known], rtol=1e-3, atol=0.05)
    assert close.mean() > 0.99


@pytest.mark.gpu
@pytest.mark.parametrize("scene", ["falling_objects", "pong"])
def test_flow_has_the_same_bits_wherever_images_come_from(tmp_path, scene):
    """Recorded, they come to a process of its own on the host, where products and sums are rounded otherwise."""
    command = [sys.executable, "-m", "evis", "launch", scene, "device:=cuda", "width:=33", "height:=50", "audit:=0"]
    command += ["--duration", "0.2", "--no-view", "--record-topics", "*"]
    flows = []
    for how in ("--compose", "--split"):
        bag = tmp_path / f"{how}.mcap"
        subprocess.run([*command, how, "--record", bag], check=True, timeout=300)
        flows.append([message.flow.tobytes() for message in packets(bag, "/cam0/labels")])
    assert flows[0] == flows[1] and len(flows[0]) > 3
