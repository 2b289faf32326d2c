"""Wrong use of a Simulation gets one line that names the thing and the remedy, and the simulation can go on."""

from __future__ import annotations

import copy
import math
import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.client.resets import seeds_of

SIZE = {"width": 32, "height": 24}


@pytest.fixture(scope="module")
def arm() -> Iterator[evis.Simulation]:
    with evis.Simulation("robot_arm", envs=2, **SIZE) as sim:
        yield sim


@pytest.mark.parametrize(
    ("target", "arguments", "says"),
    [
        ("spining_disk", {}, "did you mean 'spinning_disk'"),
        ("spinning_disk", {"omga": 3}, "did you mean 'omega'"),
        ("spinning_disk", {"omega": "fast"}, "omega"),
        ("spinning_disk", {"outputs": ["event"]}, "no output 'event'; did you mean 'events'"),
        (
            "spinning_disk",
            {"outputs": ["cam1.events"]},
            r"no output events of camera cam1; it has cam0; where the scene has it, cameras=\['cam0', 'cam1'\] adds it",
        ),
        ("spinning_disk", {"outputs": ["labels.flw"]}, "no label 'flw'"),
        ("spinning_disk", {"outputs": ["flow"]}, r"no output 'flow'; did you mean 'labels\.flow'\?"),
        ("spinning_disk", {"outputs": ["label.flw"]}, r"no output 'label\.flw'; did you mean 'labels\.flow'\?"),
        ("stereo_room", {"outputs": ["left.boxs"]}, r"no output 'left\.boxs'; did you mean 'left\.labels\.boxes'\?"),
        ("spinning_disk", {"outputs": []}, "no output"),
        ("spinning_disk", {"outputs": ["frames"], "upsampling": 1}, "the graph has no output frames"),
        ("spinning_disk", {"outputs": ["samples"]}, "no samples .* without time_tolerance; give it"),
        ("spinning_disk", {"outputs": ["imu"], "envs": 2}, "no output imu: an Imu message holds one environment"),
        ("spinning_disk", {"envs": 3, "each": [{}, {}]}, "envs is 3, and each is of 2 environments; leave envs out"),
        ("spinning_disk", {"each": {"omega": 3}}, "each is {'omega': 3}; it must be a list with a mapping for each"),
        ("spinning_disk", {"each": ["a"]}, r"each is \['a'\]; it must be a list with a mapping for each"),
        ("spinning_disk", {"outputs": None}, r"outputs is None; it must be a list of names"),
        ("spinning_disk", {"each": [{"image": True}, {}]}, "environment 0 has image of its own; .*outputs=.*'image'"),
        ("spinning_disk", {"each": [{}, {"labels": "flow"}]}, "environment 1 has labels of its own; .*'labels.flow'"),
        ("spinning_disk", {"each": [{}, {"envs": 3}]}, "environment 1 has envs of its own; .* leave it out"),
        ("spinning_disk", {"each": [{}, {"seed": 1.5}]}, "environment 1: seed is 1.5, must be a whole number"),
    ],
)
def test_what_cannot_be_made(target: str, arguments: dict[str, Any], says: str) -> None:
    with pytest.raises(evis.SimulationError, match=says):
        evis.Simulation(target, **arguments)


def test_a_live_graph_is_for_evis_launch(tmp_path: Path) -> None:
    path = tmp_path / "live.yaml"
    path.write_text("mode: live\ninclude: {file: simulator, args: {scene: spinning_disk}}\n")
    with pytest.raises(evis.SimulationError, match="live is live: a camera does not wait"):
        evis.Simulation(path, **SIZE)


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (np.zeros((2, 5)), r"controls \[2, 5\], the model takes \[2, 6\].*yaw, shoulder"),
        (np.zeros(6), r"controls \[6\], the model takes \[2, 6\]"),
        (np.full((2, 6), np.nan), "nan for actuator 'yaw' of environment 0; it must be finite"),
        (np.array([[0.0] * 6, [0.0, 9.0, 0, 0, 0, 0]]), "9 for actuator 'shoulder' of environment 1; its range is"),
        ("left", "no array of numbers"),
        ([10**400], "no array of numbers: int too large"),
        (np.full((2, 6), 0.1 + 0.1j), "no array of numbers: it has complex ones"),
    ],
)
def test_a_wrong_action_changes_nothing(arm: evis.Simulation, action: Any, says: str) -> None:
    before = arm.reset()
    with pytest.raises(evis.SimulationError, match=says):
        arm.step(action)
    assert arm.stamp_ns == before.stamp_ns
    assert arm.step(np.zeros((2, 6))).stamp_ns > before.stamp_ns


@pytest.mark.parametrize(
    ("envs", "seed", "says"),
    [
        ([2], None, "no environment 2; there are environments 0 to 1"),
        ([], None, "at least one"),
        ([0], [1, 2], "2 seeds for 1"),
        ([1, 0], [1], "1 seeds for 2"),
        ([True, False], None, r"no mask; np.flatnonzero\(mask\) gives them"),
        (np.array([True, True]), None, "no mask"),
        ([0.7], None, "0.7 for envs; it takes whole numbers"),
        ([-1], None, "-1 for envs; it takes whole numbers"),
        ("a", None, "'a' for envs"),
        ([0], [-5], "-5 for seeds; it takes whole numbers"),
        (None, [1, -5], "-5 for seeds; it takes whole numbers"),
        ([1], 2**63 - 1, "9223372036854775807 for a seed"),
        ([0], -1, "-1 for a seed"),
        *(
            (envs, seed, "for a seed; it takes whole")
            for envs in (None, [0])
            for seed in ("a", np.nan, 1.5, True, 2**64)
        ),
        (None, [[1], [2, 3]], "for seeds; it takes whole"),
    ],
)
def test_a_reset_of_what_is_not_there(arm: evis.Simulation, envs: Any, seed: Any, says: str) -> None:
    """The run goes on from where it was."""
    arm.reset()
    before = arm.step().stamp_ns
    with pytest.raises(evis.SimulationError, match=says) as caught:
        arm.reset(seed=seed, envs=envs)
    assert "\n" not in str(caught.value)
    assert arm.stamp_ns == before and arm.step().stamp_ns > before


@pytest.mark.parametrize("seed", [7, np.int32(7), np.array(7), [7, 8], np.array([7, 8], np.uint8), (7, 8)])
def test_seeds_of_any_whole_type_are_the_same(seed: Any) -> None:
    assert seeds_of(seed, [0, 1]) == [7, 8]


def test_a_reset_that_names_every_environment_is_one_of_all(arm: evis.Simulation) -> None:
    """Time starts again."""
    arm.reset()
    arm.step()
    assert arm.reset(envs=[1, 0]).stamp_ns == arm.stamp_ns == 0
    assert arm.step().stamp_ns == 33_333_333


def test_a_scene_without_actuators_takes_no_action() -> None:
    with evis.Simulation("spinning_disk", **SIZE) as sim, pytest.raises(evis.SimulationError, match="no actuators"):
        sim.step([0.0])


@pytest.mark.parametrize("outputs", [["state"], ["imu", "state"]])
def test_an_argument_that_is_given_its_default_counts_where_it_is_used(outputs: list[str]) -> None:
    """Physics steps by keyframe_rate where nothing is rendered, too."""
    for rate, stamp in ((30, 33_333_333), (60, 16_666_667)):
        with evis.Simulation("spinning_disk", outputs=outputs, keyframe_rate=rate) as sim:
            assert sim.step().stamp_ns == stamp


def test_an_action_at_a_keyframe_where_none_is_due() -> None:
    with evis.Simulation("robot_arm", action_rate=15, **SIZE) as sim:
        sim.reset()
        sim.step(np.zeros(6))
        with pytest.raises(evis.SimulationError, match="due at keyframe 2, this is keyframe 1"):
            sim.step(np.ones(6))
        sim.step()
        sim.step(np.ones(6))


def test_a_closed_simulation_says_so() -> None:
    sim = evis.Simulation("spinning_disk", **SIZE)
    sim.close()
    sim.close()
    for call in (sim.step, sim.reset, lambda: sim.run(1.0), lambda: sim.save("a.mcap"), sim.show, sim.finish):
        with pytest.raises(evis.SimulationError, match="is closed"):
            call()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda sim: sim.run(math.inf), "finite time longer than 0 s, not inf"),
        (lambda sim: sim.run("1"), "finite time longer than 0 s, not '1'"),
        (lambda sim: sim.run(None), "finite time longer than 0 s, not None"),
        (lambda sim: sim.show("left"), "no environment 'left'; there are environments 0 to 1"),
        (lambda sim: sim.save(None), "save takes the path of a bag, as 'run.mcap', not None"),
        (lambda sim: sim.save(""), "save takes the path of a bag"),
        (lambda sim: sim.alone(None, 0), "alone takes a step, as .* not None"),
        (lambda sim: sim.alone(sim.step(), 0.5), "no environment 0.5; there are environments 0 to 1"),
        (copy.copy, "cannot be copied or pickled; make one"),
        (pickle.dumps, "cannot be copied or pickled; make one"),
        (lambda sim: pickle.dumps(sim.state()), "a state is not for files and other processes, and cannot be pickled"),
    ],
)
def test_what_cannot_be_asked_for(arm: evis.Simulation, call: Any, says: str) -> None:
    arm.reset()
    with pytest.raises(evis.SimulationError, match=says):
        call(arm)


RANGED = """\
<mujoco><worldbody><light pos="0 0 3"/><body><joint name="x" type="slide"/><geom size="0.2"/></body></worldbody>
<actuator><motor joint="x" ctrllimited="true" ctrlrange="-0.62 0.62"/></actuator></mujoco>"""


def test_a_bound_in_float32_is_within_the_range(tmp_path: Path) -> None:
    """float32(0.62) is above 0.62, which is what acts then; the next one above it is refused."""
    model, bound = tmp_path / "m.xml", np.float32(0.62)
    model.write_text(RANGED)
    assert float(bound) > 0.62
    with evis.Simulation(model, outputs=["state"], **SIZE) as sim:
        for sign in (np.float32(1), np.float32(-1)):
            sim.reset()
            by_rounded = sim.step([sign * bound]).state.end_pose
            sim.reset()
            np.testing.assert_array_equal(by_rounded, sim.step([float(sign) * 0.62]).state.end_pose)
            with pytest.raises(evis.SimulationError, match=r"its range is -0\.62 to 0\.62"):
                sim.step([sign * np.nextafter(bound, np.float32(1))])


FALLING = """\
<mujoco><option timestep="0.001" integrator="Euler"/>
<worldbody><light pos="0 0 3"/><camera name="cam0" pos="0 -2 1" xyaxes="1 0 0 0 .4 1"/>
<body name="bob" pos="0 0 1"><joint name="x" type="slide" axis="1 0 0" stiffness="{stiffness}"/>
<geom size="0.2" mass="1"/></body></worldbody>
<actuator><motor name="push" joint="x" ctrllimited="true" ctrlrange="-1e9 1e9"/></actuator></mujoco>"""


def test_a_model_that_diverges_is_named_and_goes_on(tmp_path: Path) -> None:
    """A huge push takes the body past the speed limit: it begins its next episode, and the run goes on."""
    model = tmp_path / "bob.xml"
    model.write_text(FALLING.format(stiffness=1))
    with evis.Simulation(model, **SIZE) as sim:
        sim.reset()
        with pytest.raises(evis.Diverged, match="bob") as failure:
            sim.step([1e8])
        assert failure.value.envs == [0] and failure.value.step.episodes.tolist() == [1]
        assert sim.step([0.0]).episodes.tolist() == [1]
        assert sim.reset().episodes.tolist() == [0]


@pytest.mark.parametrize("ends", ["finish", "close"])
def test_what_is_known_at_the_end_of_a_run_is_told_then_and_once(tmp_path, ends):
    """A body that falls for a second is g dt t / 2 = 4.9 mm off in Euler's steps of 1 ms."""
    model = tmp_path / "rock.xml"
    model.write_text(
        "<mujoco><option timestep='.001' gravity='0 0 -9.81'/><worldbody><body name='rock' pos='0 0 9'><freejoint/>"
        "<geom size='.1'/></body></worldbody></mujoco>"
    )
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        sim = evis.Simulation(model, outputs=["state"], **SIZE)
        sim.run(1.0)
        before = [str(one.message) for one in said]
        getattr(sim, ends)()
        sim.close()
    (told,) = [str(one.message) for one in said if one.category is evis.SimulationWarning]
    assert told not in before
    assert "body 'rock' was up to 0.0049 m and 0 degrees" in told


def test_what_nodes_warn_of_comes_as_warnings(tmp_path: Path) -> None:
    """A spring that the integrator cannot follow is told when the simulation is made or first steps."""
    model = tmp_path / "stiff.xml"
    model.write_text(FALLING.format(stiffness=1e9))
    with pytest.warns(evis.SimulationWarning, match="physics: .*expect it to diverge") as told:
        with evis.Simulation(model) as sim:
            sim.reset()
    assert {warning.filename for warning in told} == {__file__}  # where a reader finds the line that it is about


TELLER = """
from evis.runtime.node import Input, Node


class Teller(Node):
    INPUTS = {"state": Input("/state")}

    def update(self, inputs):
        if stamp := inputs["state"].header.stamp_ns:
            self.warn(f"it is {stamp} ns")
"""


def test_what_another_node_warns_of_is_told_where_an_environment_diverges(tmp_path: Path) -> None:
    """The error has what physics said; the warning of the same step comes with it."""
    (tmp_path / "bob.xml").write_text(FALLING.format(stiffness=1))
    (tmp_path / "teller_node.py").write_text(TELLER)
    path = tmp_path / "teller.yaml"
    nodes = 'nodes:\n  teller: {type: "teller_node:Teller"}\n'
    path.write_text(f"include: {{file: simulator, args: {{scene: {tmp_path}/bob.xml}}}}\n{nodes}")
    with evis.Simulation(path, **SIZE) as sim:
        sim.reset()
        with pytest.warns(evis.SimulationWarning) as told, pytest.raises(evis.Diverged, match="bob"):
            sim.step([1e8])
    assert [str(warning.message) for warning in told] == ["teller: it is 33333333 ns"]


BROKEN = """
from evis.runtime.node import Input, Node


class Picky(Node):
    INPUTS = {"events": Input("/cam0/events")}

    def update(self, inputs):
        if inputs["events"].header.stamp_ns > 50_000_000:
            raise ValueError("too late for me")
"""


def test_a_node_that_fails_is_named_and_a_reset_begins_anew(tmp_path: Path) -> None:
    (tmp_path / "picky_node.py").write_text(BROKEN)
    path = tmp_path / "picky.yaml"
    nodes = 'nodes:\n  picky: {type: "picky_node:Picky"}\n'
    path.write_text(f"include: {{file: simulator, args: {{scene: spinning_disk}}}}\n{nodes}")
    with evis.Simulation(path, **SIZE) as sim, warnings.catch_warnings():
        sim.reset()
        first = sim.step()
        with pytest.raises(evis.SimulationError, match=r"picky: too late for me; reset\(\) begins anew"):
            sim.step()
        with pytest.raises(evis.SimulationError, match="has stopped"):
            sim.step()
        sim.reset()
        assert sim.step().events.t.tobytes() == first.events.t.tobytes()
