"""Environments with arguments and seeds of their own give what each gives by itself, to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from msgs.header import Message

SIZE = {"width": 40, "height": 30}
CASES: dict[str, tuple[str, dict[str, Any], list[dict[str, Any]], list[str]]] = {
    "arguments, sensor, seeds": (
        "spinning_disk",
        {"shot_rate": 3.0, "threshold_mismatch": 0.03},
        [
            {"omega": 20.0, "texture": 1, "seed": 5},
            {"omega": 60.0, "defocus": 0.4, "centre": [0.1, -0.1], "seed": 77},
            {"threshold": 0.3, "standoff": 1.05, "seed": 5},
        ],
        ["events", "info", "keyframe", "depth", "state", "labels.forward_flow", "labels.boxes", "labels.poses"],
    ),
    "seeds alone, labels of events": (
        "spinning_disk",
        {"leak_rate": 1.0},
        [{"seed": 9}, {"seed": 3}],
        ["events", "info", "labels.events"],
    ),
    "noise of the photoreceptor": (
        "spinning_disk",
        {"bandwidth_hz": 40.0, "bandwidth_poles": 2},
        [
            {"photoreceptor_noise": 0.1, "seed": 9},
            {"photoreceptor_noise": 0.0, "seed": 3},
        ],
        ["events", "info"],
    ),
    "images of a frame sensor": (
        "spinning_disk",
        {"image": True, "image_rate": 70.0, "photon_noise": True, "read_noise": 20.0},
        [{"seed": 9}, {"seed": 3, "omega": 20.0}],
        ["events", "info", "image"],
    ),
    "worlds that are drawn, with an engine": (
        "falling_objects",
        {"vary": 1, "shot_rate": 2.0},
        [{"seed": 4}, {"seed": 40}],
        ["events", "info", "state", "labels.boxes3d", "labels.velocities"],
    ),
}


def same(a: Any, b: Any) -> None:
    """Two outputs, bit for bit."""
    if isinstance(a, Message):
        assert type(a) is type(b) and a.scalars() == b.scalars()
        mine, other = a.arrays(), b.arrays()
        assert mine.keys() == other.keys()
        for name in mine:
            same(mine[name], other[name])
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b):
            same(one, other)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    else:
        assert a == b


@pytest.mark.parametrize("case", CASES)
def test_environments_are_what_they_are_by_themselves(case: str) -> None:
    """At every step, from CameraInfo to what the sensor held back; also after a reset."""
    scene, shared, each, outputs = CASES[case]
    with evis.Simulation(scene, outputs=outputs, each=each, **SIZE, **shared) as sim:
        sim.run(0.05)
        steps = [sim.reset(), sim.step(), sim.step(), sim.finish()]
        for env, own in enumerate(each):
            with evis.Simulation(scene, outputs=outputs, **SIZE, **{**shared, **own}) as single:
                for step, expected in zip(steps, [single.reset(), single.step(), single.step(), single.finish()]):
                    part = sim.alone(step, env)
                    assert vars(part).keys() == vars(expected).keys() and part.stamp_ns == expected.stamp_ns
                    for name in outputs:
                        name = name.partition(".")[0]
                        same(getattr(part, name), getattr(expected, name))
                    same(vars(part).get("images"), vars(expected).get("images"))
        assert len({sim.alone(steps[2], env).events.t.tobytes() for env in range(len(each))}) == len(each)


def test_an_environment_of_which_nothing_was_held_back_has_no_last_packet() -> None:
    """As by itself; nor marks and labels of its events. Its neighbour, whose threshold is lower, has all of them."""
    outputs, given = ["events", "signal", "labels.events"], {"crossing": "monotone", "envs": None, **SIZE}
    each = [{"threshold": 0.2}, {"threshold": 5.0}]
    with evis.Simulation("spinning_disk", outputs=outputs, each=each, seed=3, **given) as sim:
        sim.run(0.07)
        last = sim.finish()
        for env, own in enumerate(each):
            with evis.Simulation("spinning_disk", outputs=outputs, seed=3 + env, **own, **given) as single:
                single.run(0.07)
                expected, part = single.finish(), sim.alone(last, env)
            for name in ("events", "signal", "labels"):
                same(getattr(part, name), getattr(expected, name))
                assert (getattr(part, name) is None) == (env == 1)


GLOSSY = """
args: {on: {type: str, default: slider, choices: [slider, turner], help: what carries the box}}
cameras: {cam0: {fov: 40 deg, position: [0, -1, 0], look_at: [0, 0, 0]}}
lights: {lamp: {kind: point, position: [0.3, -1, 0.6], intensity: 3}}
environment: 0.2
materials: {gloss: {albedo: 0.2, roughness: 0.1}}
bodies:
  slider: {motion: [{kind: sinusoid, amplitude: [0.05, 0, 0], frequency: 12}]}
  turner: {motion: [{kind: spin, axis: [0, 0, 1], rate: 60}]}
  box: {parent: "${on}", shapes: [{shape: box, size: [0.3, 0.3, 0.3], material: gloss}]}
"""


@pytest.mark.parametrize("carriers", [("slider", "turner"), ("turner", "slider")])
def test_a_highlight_is_looked_at_as_often_beside_what_does_not_turn(carriers: tuple[str, str], tmp_path: Path) -> None:
    """What is glossy and may turn is looked at more often than the tolerance asks for; all went by the first."""
    (tmp_path / "glossy.yaml").write_text(GLOSSY)
    scene, shared = str(tmp_path / "glossy.yaml"), {"time_tolerance": 1e-3, "outputs": ["events"], **SIZE}
    with evis.Simulation(scene, each=[{"on": name} for name in carriers], **shared) as sim:
        steps = [sim.reset(), sim.step(), sim.step()]
        for env, name in enumerate(carriers):
            with evis.Simulation(scene, on=name, **shared) as single:
                for step, expected in zip(steps, [single.reset(), single.step(), single.step()]):
                    same(sim.alone(step, env).events, expected.events)


def test_samples_and_marks_of_events_are_taken_apart() -> None:
    """Into whole messages, whose arrays are those that each gives by itself."""
    outputs, shared = ["samples", "signal", "events"], {"time_tolerance": 3e-4, "shot_rate": 9.0, **SIZE}
    each = [{"omega": 20.0, "seed": 5}, {"omega": 60.0, "seed": 8}]
    with evis.Simulation("spinning_disk", outputs=outputs, each=each, **shared) as sim:
        steps = [sim.reset(), sim.step(), sim.step()]
        for env, own in enumerate(each):
            with evis.Simulation("spinning_disk", outputs=outputs, **shared, **own) as single:
                for step, expected in zip(steps, [single.reset(), single.step(), single.step()]):
                    part = sim.alone(step, env)
                    for name in outputs:
                        mine, other = getattr(part, name), getattr(expected, name)
                        if mine is None or other is None:
                            assert mine is other is None
                            continue
                        mine.check()
                        assert mine.arrays().keys() == other.arrays().keys()
                        for field, array in mine.arrays().items():
                            same(array, other.arrays()[field])
                assert len(part.signal.signal) == len(part.events.t) > 0 and len(part.samples.further) > 0


def test_a_single_environment_with_arguments_of_its_own_has_an_imu() -> None:
    given = {"outputs": ["imu"], **SIZE}
    with (
        evis.Simulation("robot_arm", each=[{"seed": 3}], **given) as sim,
        evis.Simulation("robot_arm", seed=3, **given) as single,
    ):
        for step, expected in zip([sim.reset(), sim.step()], [single.reset(), single.step()]):
            same(step.imu, expected.imu)


def test_an_array_of_numbers_is_an_argument_as_a_list_is() -> None:
    events = []
    for centre in (np.array([0.1, -0.1]), [0.1, -0.1]):
        for given in ({"centre": centre}, {"each": [{"centre": centre}]}):
            with evis.Simulation("spinning_disk", **SIZE, **given) as sim:
                events.append([step.events.t.tobytes() for step in sim.run(0.07)])
    assert events[0] == events[1] == events[2] == events[3]


def test_environments_of_one_seed_after_the_other_can_be_taken_apart_too() -> None:
    with evis.Simulation("spinning_disk", envs=2, seed=6, outputs=["events", "info"], shot_rate=9.0, **SIZE) as sim:
        steps = [sim.reset(), sim.step()]
        with evis.Simulation("spinning_disk", seed=7, outputs=["events", "info"], shot_rate=9.0, **SIZE) as single:
            for step, expected in zip(steps, [single.reset(), single.step()]):
                same(sim.alone(step, 1).events, expected.events)
                same(sim.alone(step, 1).info, expected.info)
        with pytest.raises(evis.SimulationError, match="no environment 2; there are environments 0 to 1"):
            sim.alone(steps[0], 2)


@pytest.mark.parametrize(
    ("each", "words"),
    [
        ([{"keyframe_rate": 30}, {"keyframe_rate": 60}], "environments have keyframe_rate of physics in common"),
        ([{"width": 40}, {"width": 50}], "environments have width of .* in common; environment 0 has 40"),
        ([{"omega": 20}, {"omga": 30}], "omga"),
        ([{}, {}, {"crossing": "cubic"}], "crossing is cubic in environment 2 and linear .* need the same$"),
        ([], "each is \\[\\]; it must be a list with a mapping for each environment"),
        ((), "each is \\(\\); it must be a list"),
    ],
)
def test_what_environments_have_in_common_is_named(each: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(evis.SimulationError, match=words) as told:
        evis.Simulation("spinning_disk", each=each, height=30)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("values", [(0.8, 0.0), (0.0, 0.8)])
def test_sensors_of_frames_and_of_samples_are_not_mixed(values: tuple[float, float]) -> None:
    """Each would have other events than by itself: both would read what environment 0 reads."""
    each = [{"defocus": value} for value in values]
    words = "event_sensor reads (frames|samples) in environment 1 and (frames|samples) in environment 0; simulate them"
    with pytest.raises(evis.SimulationError, match=words):
        evis.Simulation("spinning_disk", each=each, time_tolerance=0.0005, **SIZE)
    with evis.Simulation("spinning_disk", each=each, **SIZE) as sim:
        assert sim.envs == 2


RESET_ALONE: dict[str, tuple[str, dict[str, Any], list[dict[str, Any]]]] = {
    "motion": ("spinning_disk", {}, [{"omega": 20.0}, {"omega": 40.0}]),
    "sensor and seeds": ("falling_objects", {"shot_rate": 9.0}, [{"seed": 9}, {"threshold": 0.3, "seed": 5}]),
    "another model's sensor": ("falling_objects", {"model": "v2e"}, [{"threshold": 0.3}, {"threshold": 0.25}]),
}


@pytest.mark.parametrize("case", RESET_ALONE)
def test_one_that_is_reset_alone_is_what_it_is_by_itself(case: str) -> None:
    """From its reset on, in time of its own; with seeds for all of them too."""
    scene, shared, each = RESET_ALONE[case]
    given: dict[str, Any] = {"outputs": ["frames", "events", "info"], **SIZE, **shared}
    with evis.Simulation(scene, each=each, **given) as sim, evis.Simulation(scene, **given, **each[1]) as single:
        expected = [single.reset(seed=77), single.step(), single.step()]
        sim.run(0.1)
        for again in (lambda: sim.reset(envs=[1], seed=[77]), lambda: sim.reset(seed=[8, 77])):
            steps = [again(), sim.step(), sim.step()]
            for step, own in zip(steps, expected):
                part = sim.alone(step, 1)
                same(part.frames.luminance, own.frames.luminance)
                same(part.events.t - steps[0].stamp_ns, own.events.t)
                for name in "xyp":
                    same(getattr(part.events, name), getattr(own.events, name))
            assert sim.alone(steps[0], 1).info is None or sim.alone(steps[0], 1).info.sensor["seed"] == 77
        assert len(expected[-1].events.t) > 50


def test_a_bag_of_sensors_with_parameters_of_their_own_is_without_an_audit(tmp_path: Path) -> None:
    """The error that its audit cannot be had tells what helps, which does."""
    each, bag = [{"threshold": 0.2}, {"threshold": 0.4}], tmp_path / "run.mcap"
    with evis.Simulation("spinning_disk", each=each, **SIZE) as sim:
        sim.run(0.05)
        with pytest.raises(evis.SimulationError, match=r"threshold of audit in common.*; audit=0 leaves it out"):
            sim.save(bag)
    with evis.Simulation("spinning_disk", each=each, audit=0, **SIZE) as sim:
        steps = sim.run(0.05)
        sim.save(bag)
        for env in range(2):
            with evis.open(bag, topic=f"/env{env}/cam0/events") as recording:
                same(np.concatenate([p.t for p in recording]), sim.alone(steps[-1], env).events.t)
