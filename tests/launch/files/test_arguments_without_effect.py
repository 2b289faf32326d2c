"""An argument that changes nothing is refused with the reason; whether it changes nothing is tried out."""

import numpy as np
import pytest

from evis.bag.writer import BagWriter
from evis.config.expression import names_in
from evis.config.params import Param
from evis.config.paths import find_launch
from evis.launch.arguments import ArgumentError
from evis.launch.files import load
from evis.launch.planner import Options, plan_launch
from evis.launch.unused_arguments import check_parameters
from msgs.camera import Keyframe
from msgs.header import Header
from nodes.camera.node import CameraNode
from nodes.event_sensor.effects import without_effect
from nodes.event_sensor.make import make_sensor
from nodes.event_sensor.parameters import SENSOR, resolve_sensor


def plan(name, held=None, **given):
    path, preset = find_launch(name)
    return plan_launch(load(path), {**preset, **given}, Options(view=False), held)


@pytest.mark.parametrize(
    "given, why",
    [
        ({"interpolator": "none", "tolerance": 0.1}, "tolerance:=0.1 has no effect: interpolator is left out, for"),
        ({"upsampling": 1, "tolerance": 0.2}, "tolerance:=0.2 has no effect: interpolator is left out"),
        ({"interpolator": "splat", "tolerance": 0.2}, "tolerance:=0.2 has no effect: method splat shades nothing anew"),
        ({"interpolator": "splat", "time_tolerance": 1e-4}, "time_tolerance:=0.0001 has no effect: method splat"),
        ({"upsampling": 1, "time_tolerance": 1e-4}, "time_tolerance:=0.0001 has no effect: interpolator is left out"),
        ({"upsampling": 1, "interpolator": "splat"}, "interpolator:=splat has no effect: interpolator is left out"),
        ({"path_samples": 64}, "path_samples:=64 has no effect: no light comes by paths"),
        ({"model": "evis-paper", "crossing": "linear"}, "crossing:=linear has no effect: event model evis-paper"),
        ({"model": "esim", "leak_rate": 1}, "leak_rate:=1.0 has no effect: event model esim has none; it has"),
        ({"model": "evis-paper", "shot_rate": 5, "shot_on_share": 0.9}, "shot_on_share:=0.9 has no effect: event"),
        ({"bandwidth_hz": 9, "bandwidth_exponent": 0, "bandwidth_level": 2}, "bandwidth_level:=2.0 has no effect: ban"),
        ({"photoreceptor_noise_level": 5}, "photoreceptor_noise_level:=5.0 has no effect: photoreceptor_noise is 0"),
        ({"hot_pixel_rate": 5}, "hot_pixel_rate:=5.0 has no effect: hot_pixel_fraction is 0"),
        ({"threshold": 0.2, "threshold_on": 0.1, "threshold_off": 0.3}, "threshold:=0.2 has no effect: threshold_on"),
    ],
)  # fmt: skip
def test_what_changes_nothing_is_refused(given, why):
    with pytest.raises(ArgumentError) as caught:
        plan("spinning_disk", **given)
    assert str(caught.value).startswith(why) and str(caught.value).endswith("; leave it out")
    plan("spinning_disk", held=(), **given)


@pytest.mark.parametrize(
    "given",
    [
        {"interpolator": "none", "upsampling": 4},
        {"tolerance": 0.1, "bounces": 1, "path_samples": 64},
        {"interpolator": "splat", "bounces": 1, "path_samples": 64},
        {"model": "evis-paper", "crossing": "frame", "leak_rate": 1},
        {"leak_rate": 1, "leak_jitter": 0.2, "leak_model": "drift", "preset": "davis346"},
        {"time_tolerance": 1e-4, "bounces": 1},
        {"leak_jitter": 0, "omega": 20, "seed": 3, "envs": 2, "colour": True},
        {"threshold_on": 0.1, "threshold": 0.3, "labels": "flow", "imu": True},
    ],
)
def test_what_changes_something_is_taken(given):
    plan("spinning_disk", **given)


def test_an_argument_is_held_against_the_default_of_the_file_that_hands_it_on(tmp_path):
    """Of a file that includes the simulator without an interpolator, another method interpolates nothing."""
    own = tmp_path / "own.yaml"
    own.write_text("args: {upsampling: {default: 1}, interpolator: {default: none}}\ninclude: simulator\n")
    scene = {"scene": "spinning_disk"}
    with pytest.raises(ArgumentError, match=r"interpolator:=splat has no effect: .*interpolator is left out"):
        plan_launch(load(own), {"interpolator": "splat", **scene}, Options(view=False))
    made = plan_launch(load(own), {"interpolator": "rigid", "upsampling": 4, **scene}, Options(view=False))
    assert made.nodes["interpolator"].params["upsampling"] == 4
    plan_launch(load(own), {"upsampling": 4, **scene}, Options(view=False))  # dense rendering, at four times the rate


@pytest.mark.parametrize("options, what", [({"duration_s": 0.5}, "--duration 0.5"), ({"record": "a.mcap"}, "--record")])
def test_an_option_that_no_file_hands_on_is_refused(options, what, tmp_path):
    """It would run without end, or record nothing, and say nothing of either."""
    own = tmp_path / "own.yaml"
    own.write_text("nodes:\n  eye: {type: physics, keep: [state], params: {scene: spinning_disk}}\n")
    with pytest.raises(ArgumentError) as caught:
        plan_launch(load(own), {}, Options(view=False, **options))
    assert str(caught.value).startswith(what) and "own.yaml gives it to no node" in str(caught.value)
    own.write_text("include: simulator\n")  # which hands both on
    plan_launch(load(own), {"scene": "spinning_disk"}, Options(view=False, **options))


@pytest.mark.parametrize(
    "given",
    [{"upsampling": 4}, {"interpolator": "splat"}, {"upsampling": 1, "interpolator": "none"}, {"upsampling": 1}],
)
def test_frames_of_a_replay_are_made_anew_or_refused(given, tmp_path):
    """Their arguments stand in the interpolator's condition too, which alone brings nothing about."""
    bag = str(tmp_path / "run.mcap")
    with BagWriter(bag) as writer:
        writer.write("/cam0/keyframe", Keyframe(Header(0), np.zeros(1, np.int32), np.ones((1, 4, 4, 3), np.float32)))
    with pytest.raises(ArgumentError) as caught:
        plan("replay", bag=bag, **given)
    name, value = next(iter(given.items()))
    assert f"{name}:={value} has no effect" in str(caught.value) and "regenerate:=true" in str(caught.value)
    if given.get("upsampling") == 1:
        made = plan("replay", bag=bag, regenerate="true", **given)
        assert made.nodes["event_sensor"].params["source"] == "keyframe"


LAUNCH = """
args: {{a: {{default: 0}}, b: {{default: 0}}, c: {{default: 0}}, on: {{default: true}}, free: {{default: 1}}}}
include: {{file: inner.yaml, if: "${{on}}", args: {{packet: "${{a or 5}}"}}}}
nodes:
  other:
    type: camera
    if: "${{not on}}"
    otherwise: not while it is on
    params: {{file: {file}, packet_ms: "${{b}}"}}
"""
INNER = """
args: {{packet: {{default: 1}}, c: {{default: 1}}}}
nodes:
  eye:
    type: camera
    keep: [events]
    params: {{camera: eye, file: {file}, packet_ms: "${{packet}}", faults: "${{c}}"}}
"""


def test_arguments_are_followed_through_includes(tmp_path):
    recording = tmp_path / "r.raw"
    recording.write_bytes(b"")
    (tmp_path / "inner.yaml").write_text(INNER.format(file=recording))
    (tmp_path / "outer.yaml").write_text(LAUNCH.format(file=recording))
    launch = load(tmp_path / "outer.yaml")
    plan_launch(launch, {"a": 3, "on": True, "free": 2}, Options(view=False))
    with pytest.raises(ArgumentError, match=r"^b:=3 has no effect: other is left out, for not while it is on; leave"):
        plan_launch(launch, {"b": 3}, Options(view=False))
    with pytest.raises(ArgumentError, match=r"^c:=3 has no effect: it is for an emulated camera"):
        plan_launch(launch, {"c": 3}, Options(view=False))


def test_names_are_found_wherever_they_stand():
    assert names_in({"a": ["x ${b + c}", "${d if e else 'f'}"], "g": 3, "h": "${env:HOME}", "i": "${j +"}) == set(
        "bcde"
    )


def test_a_node_by_hand_is_held_to_the_same():
    with pytest.raises(ArgumentError, match=r"^faults:=stall_every=5 has no effect"):
        check_parameters(CameraNode, "camera", {"file": "a.raw", "faults": "stall_every=5"})
    check_parameters(CameraNode, "camera", {"file": "a.raw", "pace": "2"})
    check_parameters(CameraNode, "camera", {"emulate": "evk4", "file": "a.raw", "faults": "stall_every=5"})


def frames():
    rng = np.random.default_rng(0)
    wave = np.exp(np.cumsum(rng.normal(size=(40, 6, 7)) * 0.4, axis=0)).astype(np.float32)
    return [(k * 10_000_000, image) for k, image in enumerate(wave)]


def events(given):
    """What a sensor of these parameters makes, made as a node does: what Python refuses is compared here."""
    t, images = (np.array(column) for column in zip(*frames(), strict=True))
    resolved = resolve_sensor("sensor", "ideal", given)
    sensor = make_sensor(resolved, images.shape[1:], colour=False, device="cpu", seed=1)
    made = [sensor.process(images[None].astype(np.float32), t, np.zeros(1, np.int32)), sensor.flush()]
    return [np.concatenate([getattr(m, name) for m in made]).tolist() for name in "txyp"]


def another(name: str, param: Param, now):
    """A value that differs from the one now, and that the other rules allow."""
    if param.choices:
        return next(c for c in param.choices if c != now and c != "hermite")
    most = param.maximum if param.maximum is not None else 1e3
    value = (0.9 if now is None else now + 0.25) if most >= 0.5 else most
    return param.type(min(value if param.type is float else (now or 0) + 1, most))


@pytest.mark.parametrize(
    "base",
    [
        {},
        {"threshold_on": 0.2, "threshold_off": 0.3},
        {"model": "evis-paper", "crossing": "linear", "leak_rate": 5},
        {"shot_rate": 20.0, "leak_rate": 5, "hot_pixel_fraction": 0.3},
        {"bandwidth_hz": 20.0, "bandwidth_exponent": 0.0, "bandwidth_level": 1.0},
    ],
)
def test_what_is_said_to_have_no_effect_has_none(base):
    """Every parameter that is named, set to something else, gives the same events."""
    idle = without_effect(resolve_sensor("sensor", "ideal", base))
    assert idle
    before = resolve_sensor("sensor", "ideal", base)
    same = events(base)
    assert len(same[0]) > 500
    for name in idle:
        if name == "crossing":
            continue  # the sensor refuses all but those two for evis-paper
        if name in ("hot_pixel_fraction", "hot_pixel_rate") and before["shot_rate"]:
            continue  # another stream of random numbers
        assert events({**base, name: another(name, SENSOR[name], before[name])}) == same, name
    if "crossing" in idle:
        assert events({**base, "crossing": "frame"}) == same


def test_what_has_an_effect_is_not_named():
    base = {"leak_rate": 50.0, "threshold_mismatch": 0.1, "bandwidth_hz": 20.0}
    idle = without_effect(resolve_sensor("sensor", "ideal", base))
    same = events(base)
    for name, value in {
        "leak_jitter": 0.5, "threshold_floor": 0.19, "bandwidth_poles": 2, "threshold": 0.3, "bandwidth_level": 1.0,
    }.items():  # fmt: skip
        assert name not in idle and events({**base, name: value}) != same, name
