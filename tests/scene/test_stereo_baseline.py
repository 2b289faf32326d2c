"""Which camera of a scene stands to the right of another one, and by how much."""

import numpy as np
import pytest

from evis.bag.ros import messages
from evis.bag.ros.cdr import CdrReader
from evis.launch.planner import Options, plan_target
from evis.scene.load import load_scene
from evis.scene.stereo import baseline
from nodes.event_sensor.parameters import SENSOR, resolve_sensor
from nodes.event_sensor.presets import PRESETS
from nodes.renderer.node import RendererNode

TURNING = "motion: [{kind: spin, axis: [0, 1, 1], rate: 2}, {kind: linear, velocity: [1, 2, 3]}]"


def baselines(tmp_path, cameras, motion=TURNING, origin=0.0):
    path = tmp_path / "rig.yaml"
    stand = f"position: [{1 + origin}, {2 - origin}, 3], look_at: [{4 + origin}, {4 - origin}, 3]"
    path.write_text(
        f"bodies:\n  rig: {{{stand}, {motion}}}\ncameras:\n"
        + "".join(f"  {name}: {{fov: 50 deg, {text}}}\n" for name, text in cameras.items())
    )
    scene = load_scene(str(path), {"width": 40, "height": 30})
    return {camera.name: baseline(scene, camera) for camera in scene.cameras}


def test_the_stereo_room():
    scene = load_scene("stereo_room", {"baseline": 0.11})
    assert [baseline(scene, scene.camera(name)) for name in ("left", "right")] == [0, pytest.approx(0.11, abs=1e-12)]


@pytest.mark.parametrize(
    ("right", "want"),
    [
        ("parent: rig, position: [0.2, 0, 0]", 0.2),
        ("parent: rig, position: [-0.2, 0, 0]", 0),  # it stands to the left; the other one is the right one
        ("parent: rig, position: [0.2, 0.01, 0]", 0),  # not along the rows
        ("parent: rig, position: [0.2, 0, 0.01]", 0),  # in front
        ("parent: rig, position: [0.2, 0, 0], rotation: {axis: [0, 1, 0], angle: 1 deg}", 0),  # converging
        ("parent: rig, position: [0.2, 0, 0], width: 41", 0),  # another sensor
        ("position: [1.2, 2, 3], look_at: [4, 4, 3]", 0),  # not on the rig, which moves
        ("parent: rig, position: [0.2, 0, 0], motion: [{kind: sinusoid, amplitude: [0.01, 0, 0], frequency: 1}]", 0),
    ],
)
def test_what_is_a_pair(tmp_path, right, want):
    found = baselines(tmp_path, {"a": "parent: rig, position: [0, 0, 0]", "b": right})
    assert found["b"] == pytest.approx(want, abs=1e-12)
    assert found["a"] == pytest.approx(0.2 if "[-0.2" in right else 0, abs=1e-12)


@pytest.mark.parametrize("origin", [1e7, 1e8])
def test_a_pair_far_from_the_origin_is_one(tmp_path, origin):
    """Coordinates of a map grid are millions of metres, of which float64 keeps 1 nm; what is off by more is no pair."""
    ulp = np.spacing(origin)
    for aside, want in ((0, 0.2), (100 * ulp, 0)):
        cameras = {"a": "parent: rig", "b": f"parent: rig, position: [0.2, {aside}, 0]"}
        found = baselines(tmp_path, cameras, origin=origin)
        assert found == {"a": 0, "b": pytest.approx(want, abs=4 * ulp)}


def test_a_row_of_three_counts_from_the_first(tmp_path):
    cameras = {n: f"parent: rig, position: [{x}, 0, 0]" for n, x in (("a", 0.0), ("b", 0.1), ("c", 0.3))}
    assert baselines(tmp_path, cameras) == {n: pytest.approx(x, abs=1e-12) for n, x in zip("abc", (0, 0.1, 0.3))}


def projection(message):
    """P [3, 4] of the recorded sensor_msgs/CameraInfo."""
    buffers = messages.camera_info(0, "cam", 30, 40, "plumb_bob", np.zeros(5), message.k, message.baseline)
    reader = CdrReader(memoryview(b"".join(map(bytes, buffers))), "x")
    reader.header()
    _ = reader.integer("I"), reader.integer("I"), reader.string(), reader.doubles(reader.integer("I"))
    _ = reader.doubles(9), reader.doubles(9)
    return reader.doubles(12).reshape(3, 4)


class Bus:
    """Takes what a renderer publishes at its start."""

    def __init__(self, plan):
        self.plan, self.sent = plan, {}

    def wants(self, node, port, array=""):
        return port == "keyframe"

    def publish(self, node, port, message):
        message.check()
        self.sent[port] = message


def info(name, camera="cam0", **given):
    """The CameraInfo of a camera of a launch file's plan."""
    plan = plan_target(name, {"width": 40, "height": 30, **given}, Options(view=False))
    node = next(n for n in plan.nodes.values() if n.target.endswith("RendererNode") and n.params["camera"] == camera)
    renderer = RendererNode(node.name, node.params)
    renderer.runtime = Bus(plan)
    renderer.setup()
    return renderer.runtime.sent["info"]


def test_the_right_cameras_projection_as_ros_has_it():
    """sensor_msgs/CameraInfo: P[3] of the right camera is -fx B; the left one's is 0."""
    left, right = (info("stereo_room", camera, baseline=0.1) for camera in ("left", "right"))
    assert not projection(left)[:, 3].any()
    assert projection(right)[0, 3] == pytest.approx(-right.k[0, 0] * 0.1, rel=1e-12) and right.k[0, 0] > 10
    assert not projection(right)[1:, 3].any() and np.array_equal(projection(right)[:, :3], right.k)


@pytest.mark.parametrize("preset", ["ideal", "davis346"])
def test_the_info_says_what_the_sensor_is(preset):
    """Every parameter as the event sensor resolves it, those of the preset too."""
    about = info("spinning_disk", preset=preset, leak_rate=0.3, seed=5).sensor
    assert about["sensor"] == PRESETS[preset].name and about["preset"] == preset and about["seed"] == 5
    want = resolve_sensor("it", preset, {"leak_rate": 0.3})
    assert {k: v for k, v in about.items() if k in SENSOR} == {k: v for k, v in want.items() if v is not None}
    assert about["leak_rate"] == 0.3 and about["threshold"] == want["threshold"] > 0


def test_environments_whose_rigs_are_drawn_have_a_baseline_each(tmp_path):
    """That between the poses of their cameras; a bag has the info of each, and joins them again."""
    from evis.bag import environments
    from evis.simulation.simulation import Simulation

    path = tmp_path / "drawn.yaml"
    path.write_text(
        "args: {b: {default: {from: 0.05, to: 0.2}, help: apart}}\nmaterials: {grey: {albedo: 0.5}}\n"
        "bodies: {rig: {shapes: [{shape: sphere, radius: 0.01, material: grey}]}}\n"
        "cameras:\n  left: {parent: rig, fov: 50 deg}\n  right: {parent: rig, fov: 50 deg, position: ['${b}', 0, 0]}\n"
    )
    with Simulation(str(path), envs=3, seed=4, width=16, height=12, outputs=["info", "state"]) as sim:
        step = sim.reset()
    pose = step.state.end_pose[:, [step.state.names.index(name) for name in ("left", "right")], :3]
    want = np.linalg.norm(pose[:, 1] - pose[:, 0], axis=1)
    assert len(set(want)) == 3
    info = step.cameras["right"].info
    alone = environments.split(info, 3)
    assert [one.baseline for one, _ in alone] == pytest.approx(want.tolist(), abs=1e-11)
    assert environments.join(alone).env_baseline == pytest.approx(want, abs=1e-11)
    assert step.cameras["left"].info.env_baseline is None
