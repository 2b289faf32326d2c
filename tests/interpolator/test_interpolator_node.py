"""The node and its pure part: episodes, stamps, what is asked for, kept and given back."""

import contextlib

import numpy as np
import pytest

import evis
from evis.config.params import ParamError
from evis.simulation.errors import SimulationError
from msgs.camera import Depth, Frames, Keyframe, Motion
from msgs.header import Header
from msgs.world import WorldState
from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.node import InterpolatorNode

H, W = 8, 10


class Bus:
    """Stands for the executor: takes what is published, counts, and poisons a loan that is written no more."""

    def __init__(self):
        self.sent, self.counted, self.said = [], {}, []
        self.wanted = "frames"

    def loan(self, node, port, arrays):
        return {name: np.full(shape, np.nan, dtype) for name, (shape, dtype) in arrays.items()}

    def lending(self, node, port):
        return contextlib.nullcontext()

    def publish(self, node, port, message):
        message.check()
        self.sent.append(message)

    def diagnose(self, node, level, text):
        self.said.append((level, text))

    def wants(self, node, port, array=""):
        return port == self.wanted

    def count(self, node, name, amount):
        self.counted[name] = self.counted.get(name, 0) + amount


class Slot:
    """Stands for shared memory: the arrays are overwritten as soon as nobody pins them."""

    def __init__(self, arrays):
        self.pins, self.arrays = 1, arrays

    def pin(self):
        self.pins += 1

    def unpin(self):
        self.pins -= 1
        if self.pins == 0:
            for array in self.arrays:
                array.flags.writeable = True
                array[...] = np.nan


def start(**params):
    node = InterpolatorNode("interpolator", {"method": "splat", **params})
    node.runtime = Bus()
    node.runtime.wanted = "samples" if node.params["time_tolerance"] else "frames"
    node.setup()
    return node


def inputs(k, rng, episodes=(0,), dtype=np.float32, margin=0, speed=2):
    header = Header(k * 33_333_333, clock="sim", episode=int(max(episodes)))
    envs = len(episodes)
    motion = rng.uniform(-speed, speed, (envs, H, W, 2))
    messages = {
        "keyframe": Keyframe(
            header, np.array(episodes, np.int32), rng.uniform(0.1, 2, (envs, H, W, 3)).astype(dtype), margin=margin
        ),
        "depth": Depth(header, rng.uniform(1, 3, (envs, H, W)).astype(np.float32), margin),
        "motion": Motion(header, motion.astype(np.float32), margin),
    }
    for message in messages.values():
        arrays = [a for n, a in message.arrays().items() if n != "episodes"]
        for array in arrays:
            array.flags.writeable = False
        message._slot = Slot(arrays)
    return messages


def deliver(node, messages):
    node.update(messages)
    for message in messages.values():
        message._slot.unpin()


def luminance(message, env=slice(None)):
    return message.radiance[env].astype(np.float64) @ [0.2126, 0.7152, 0.0722]


def test_first_keyframe_stands_alone_and_then_k_frames_end_with_the_keyframe():
    rng = np.random.default_rng(1)
    node = start(upsampling=4)
    first, second = inputs(0, rng), inputs(1, rng)
    expected = [luminance(m["keyframe"]) for m in (first, second)]
    deliver(node, first)
    deliver(node, second)
    one, four = node.runtime.sent
    assert one.luminance.shape == (1, 1, H, W) and one.t.tolist() == [0]
    np.testing.assert_allclose(one.luminance[:, 0], expected[0], rtol=3e-7)
    assert four.luminance.shape == (1, 4, H, W)
    assert four.t.tolist() == [8_333_333, 16_666_667, 25_000_000, 33_333_333]
    np.testing.assert_allclose(four.luminance[:, -1], expected[1], rtol=3e-7)
    assert np.isfinite(four.luminance).all()
    assert (four.header.stamp_ns, four.header.clock) == (33_333_333, "sim")


def test_the_last_keyframe_is_kept_and_the_one_before_given_back():
    rng = np.random.default_rng(1)
    node = start(upsampling=4)
    sent = [inputs(k, rng) for k in range(3)]
    for messages in sent:
        deliver(node, messages)
    assert [m._slot.pins for messages in sent for m in messages.values()] == [0] * 6 + [1] * 3
    assert all(np.isfinite(f.luminance).all() for f in node.runtime.sent)
    node.close()
    assert all(m._slot.pins == 0 for m in sent[2].values())


def test_a_new_episode_does_not_see_the_old_one():
    rng = np.random.default_rng(1)
    node = start(upsampling=4)
    deliver(node, inputs(0, rng, (0, 0)))
    both = inputs(1, rng, (0, 1))
    expected = luminance(both["keyframe"], 1)
    deliver(node, both)
    held = node.runtime.sent[-1]
    np.testing.assert_allclose(held.luminance[1], np.broadcast_to(expected, (4, H, W)), rtol=3e-7)
    assert np.abs(np.diff(held.luminance[0], axis=0)).max() > 0.01
    deliver(node, inputs(2, rng, (1, 2)))
    assert node.runtime.sent[-1].luminance.shape[1] == 1
    assert node.runtime.sent[-1].episodes.tolist() == [1, 2]


def test_method_none_passes_keyframes_on_and_asks_for_nothing_else():
    rng = np.random.default_rng(1)
    node = start(method="none", upsampling=8)
    assert InterpolatorNode.needs(node.params, frozenset({"frames"})) == {"keyframe"}
    for k in range(3):
        messages = inputs(k, rng, dtype=np.float16, margin=2)
        expected = luminance(messages["keyframe"])[:, None, 2:-2, 2:-2]
        deliver(node, {"keyframe": messages["keyframe"]})
        frames = node.runtime.sent[-1]
        assert isinstance(frames, Frames) and frames.t.tolist() == [k * 33_333_333]
        # Keyframes of float16 have luminance of float16, rounded to the nearest.
        np.testing.assert_allclose(frames.luminance, expected, rtol=2.0**-11 + 3e-7)


def test_colour_frames_carry_rgb():
    rng = np.random.default_rng(1)
    node = start(colour=True, upsampling=2)
    deliver(node, inputs(0, rng))
    second = inputs(1, rng, speed=0)
    radiance = second["keyframe"].radiance.copy()
    deliver(node, second)
    frames = node.runtime.sent[-1]
    assert frames.luminance is None
    assert (frames.rgb[:, -1] == radiance).all()


def test_fills_are_counted():
    rng = np.random.default_rng(1)
    node = start(upsampling=4)
    for k in range(2):
        deliver(node, inputs(k, rng, speed=30))
    assert node.runtime.counted["filled_pixels"] == node.runtime.sent[-1].filled > 0


def test_misuse_has_one_clear_line():
    interpolator = Interpolator("splat", 4)
    radiance, episodes = np.ones((1, H, W, 3), np.float32), np.zeros(1, np.int32)
    depth, motion = np.ones((1, H, W), np.float32), np.zeros((1, H, W, 2), np.float32)
    with pytest.raises(ValueError, match="needs depth"):
        interpolator.push(0, episodes, radiance, None, motion)
    with pytest.raises(ValueError, match="no larger than its margin of 4 px"):
        interpolator.push(0, episodes, radiance, depth, motion, 4)
    interpolator = Interpolator("splat", 4)
    interpolator.push(50, episodes, radiance, depth, motion)
    with pytest.raises(ValueError, match="49 ns came after the one at 50 ns"):
        interpolator.push(49, episodes, radiance, depth, motion)
    with pytest.raises(ValueError, match="before it was"):
        interpolator.push(60, episodes, radiance[:, :4], depth[:, :4], motion[:, :4])
    with pytest.raises(ValueError, match="no device 'gpu' here; there is cpu"):
        Interpolator("splat", 4, device="gpu")
    with pytest.raises(ParamError, match="did you mean 'splat'"):
        InterpolatorNode("interpolator", {"method": "splatt"})
    with pytest.raises(ValueError, match="no interpolation method 'splatt'; did you mean 'splat'"):
        Interpolator("splatt", 4)
    with pytest.raises(ValueError, match="upsampling is 0; it must be 1 or more"):
        Interpolator("splat", 0)


def test_node_module_is_light():
    """The planner imports it for its parameters alone."""
    import subprocess
    import sys

    code = "import sys, nodes.interpolator.node, nodes.event_sensor.node; sys.exit('warp' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=600).returncode == 0


def test_each_method_asks_for_what_it_reads():
    frames = frozenset({"frames"})
    asked = lambda **given: InterpolatorNode.needs({"method": "rigid", "scene": None, **given}, frames)
    assert asked(scene="spinning_disk") == {"keyframe", "state"}
    assert asked(method="splat", scene="spinning_disk") == {"keyframe", "depth", "motion"}
    assert asked(method="splat-quadratic", scene="spinning_disk") == {"keyframe", "depth", "motion"}
    assert asked(method="none") == {"keyframe"}
    assert asked() == {"keyframe", "depth", "motion"}, "without a scene there is only splat"


def test_rigid_without_a_scene_says_that_it_is_splat():
    rng = np.random.default_rng(1)
    node = start(method="rigid", upsampling=4)
    assert node.runtime.said == [
        ("warning", "method rigid needs the scene that was rendered (scene:=NAME); splat is used instead")
    ]
    for k in range(2):
        deliver(node, inputs(k, rng))
    assert node.runtime.sent[-1].luminance.shape == (1, 4, H, W)


def test_rigid_from_keyframes_and_states_alone():
    """The disk of the scene, rendered here; what is shaded anew is counted, and a foreign state is refused."""
    from evis.scene import load_scene
    from nodes.renderer.renderer import Renderer

    scene = load_scene("spinning_disk", {"width": 64, "height": 48})
    names = [body.name for body in scene.bodies]
    renderer = Renderer(scene, scene.camera("cam0"))
    node = start(method="rigid", upsampling=4, scene="spinning_disk", width=64, height=48)
    for k in range(2):
        t = np.arange(max(k - 1, 0) * 10, k * 10 + 1) * 1_000_000
        pose = np.stack([body.trajectory.pose(t) for body in scene.bodies], 1)[None]
        twist = np.stack([body.trajectory.twist(t) for body in scene.bodies], 1)[None]
        header = Header(k * 10_000_000, clock="sim")
        radiance = renderer.render(pose[:, -1])["radiance"].copy()
        state = WorldState.dense(header, t, pose, twist, np.zeros(1, np.int32), names=names)
        messages = {"keyframe": Keyframe(header, np.zeros(1, np.int32), radiance), "state": state}
        for message in messages.values():
            message._slot = Slot([])
        deliver(node, messages)
    frames = node.runtime.sent[-1]
    assert frames.luminance.shape == (1, 4, 48, 64) and frames.t.tolist() == [2500000, 5000000, 7500000, 10000000]
    assert node.runtime.counted["reshaded_pixels"] == frames.reshaded > 0 == frames.filled
    np.testing.assert_allclose(frames.luminance[:, -1], radiance @ [0.2126, 0.7152, 0.0722], rtol=1e-6)
    messages["state"].names = ["moon", "cam0"]
    with pytest.raises(ValueError, match="/state has bodies moon, cam0, the scene has"):
        node.update(messages)


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"bounces": 1}, "by paths"),
        ({"bounces": 1, "supersampling": 2}, "by paths"),
        ({"keyframe_rate": 0.46}, "2.174 s apart"),
    ],
)
def test_pixels_that_go_by_frames_alone_are_told_and_counted(params, why):
    """Foreseen for --explain, warned of at the start, and counted for the summary; not without a tolerance."""
    scene = {"method": "rigid", "scene": "spinning_disk", "width": 8, "height": 6, "upsampling": 4, **params}
    given = {name: param.default for name, param in InterpolatorNode.PARAMS.items()} | scene
    assert InterpolatorNode.foreseen(given) == ()
    (told,) = InterpolatorNode.foreseen(given | {"time_tolerance": 1e-4})
    assert "all 8x6 pixels go by frames alone" in told and why in told
    node = start(**scene, time_tolerance=1e-4)
    assert [text for _, text in node.runtime.said] == [told]
    n = params.get("supersampling", 1)
    for k in range(3):
        t = np.arange(max(k - 1, 0) * 10, k * 10 + 1) * 1_000_000
        pose = np.tile([0.0, 0, 0, 0, 0, 0, 1], (1, len(t), len(node._names), 1))
        header = Header(k * 10_000_000, clock="sim")
        still, episodes = np.zeros((*pose.shape[:3], 6)), np.zeros(1, np.int32)
        state = WorldState.dense(header, t, pose, still, episodes, names=node._names)
        key = Keyframe(header, episodes, np.ones((1, 6 * n, 8 * n, 3), np.float32))
        messages = {"keyframe": key, "state": state}
        for message in messages.values():
            message._slot = Slot([])
        deliver(node, messages)
    assert node.runtime.counted["pixels_by_frames_alone"] == 2 * 8 * 6


def test_supersampled_pixels_do_not_go_by_frames_alone():
    scene = {"method": "rigid", "scene": "spinning_disk", "width": 8, "height": 6, "supersampling": 2}
    given = {name: param.default for name, param in InterpolatorNode.PARAMS.items()} | scene
    assert InterpolatorNode.foreseen(given | {"time_tolerance": 1e-4}) == ()
    assert start(**scene, time_tolerance=1e-4).runtime.said == []


def test_an_error_of_another_node_is_not_hidden_by_its_end():
    """The sensor is set up first."""
    with pytest.raises(SimulationError, match="there is no device 'cuda:99' here"):
        evis.Simulation("spinning_disk", device="cuda:99", width=32, height=24)


def test_samples_without_a_tolerance_of_time_are_refused_in_words():
    """Nothing would come on the topic: a recording that named it had none, and a sensor that reads it waited."""
    node = InterpolatorNode("interpolator", {"method": "rigid", "camera": "left"})
    node.runtime = Bus()
    node.runtime.wanted = "samples"
    with pytest.raises(ValueError, match=r"/left/samples is read, and without a time_tolerance there are none"):
        node.setup()
