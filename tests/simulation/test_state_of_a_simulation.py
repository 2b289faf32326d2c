"""`Simulation.state` and `restore`: the bytes of the first time after any actions and resets; what is refused."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import evis
from evis.simulation.errors import Diverged, SimulationError
from evis.simulation.step import Step
from nodes.physics.node import PhysicsNode

SIZE = {"width": 40, "height": 30}
IMAGES = ["events", "frames", "keyframe", "depth", "motion", "ids", "normal", "labels", "state"]
FALL = """
<mujoco><option timestep="0.001" gravity="0 0 -3000"/><worldbody><body name="rock" pos="0 0 0.5">
<joint name="j" type="slide" axis="0 0 -1"/><geom type="box" size="0.4 0.4 0.4" mass="1"/></body></worldbody></mujoco>
"""
FALLING = """
args: {start: {default: {from: 0, to: 900}, help: speed at the start}}
mjcf: fall.xml
initial_joints: {j: {velocity: "${start}"}}
cameras: {cam0: {position: [0, -3, 1], look_at: [0, 0, 0.5], fov: 50 deg}}
environment: 0.5
"""
"""A fall that passes the speed limit every few gaps."""
NOISE = {"preset": "dvs128", "threshold": 0.2}


def content(step: Step) -> dict[str, Any]:
    """Gives all that a step has, but for the numbers of its messages, which go on."""
    found: dict[str, Any] = {"stamp": step.stamp_ns, "over": step.over, "episodes": step.episodes.tolist()}

    def add(name: str, value: Any) -> None:
        if isinstance(value, np.ndarray):
            found[name] = value.dtype.str, value.shape, value.tobytes()
        elif hasattr(value, "header"):
            header = value.header
            found[name] = header.stamp_ns, header.episode, repr(value.scalars())
            for field, array in value.arrays().items():
                add(f"{name}.{field}", array)
        elif isinstance(value, tuple):
            for number, one in enumerate(value):
                add(f"{name}[{number}]", one)

    for camera, outputs in step.cameras.items():
        for name, value in vars(outputs).items():
            add(f"{camera}.{name}", value)
    for name in ("state", "physics_error"):
        add(name, vars(step).get(name))
    return found


def course_of(sim: evis.Simulation, rng: np.random.Generator, count: int) -> list[tuple[Any, ...]]:
    """Draws steps, with actions where there are actuators, and resets of some environments."""
    low, high = (np.array([np.clip(getattr(a, end), -1, 1) for a in sim.actuators]) for end in ("low", "high"))
    course: list[tuple[Any, ...]] = []
    for _ in range(count):
        if sim.envs > 1 and rng.random() < 0.3:
            chosen = np.sort(rng.choice(sim.envs, rng.integers(1, sim.envs), replace=False)).tolist()
            seeds = rng.integers(0, 1000, len(chosen)).tolist() if rng.random() < 0.5 else None
            course.append((chosen, seeds))
        else:
            act = len(low) and rng.random() < 0.7
            course.append((rng.uniform(low, high, (sim.envs, len(low))) if act else None,))
    return course


def gone(sim: evis.Simulation, course: list[tuple[Any, ...]]) -> list[dict[str, Any]]:
    steps = []
    for entry in course:
        try:
            steps.append(sim.step(entry[0]) if len(entry) == 1 else sim.reset(envs=entry[0], seed=entry[1]))
        except Diverged as error:
            steps.append(error.step)
    return [content(step) for step in steps]


def assert_same(found: list[dict[str, Any]], expected: list[dict[str, Any]]) -> None:
    for k, (one, other) in enumerate(zip(found, expected, strict=True)):
        assert set(one) == set(other)
        assert [name for name in one if one[name] != other[name]] == [], k


def counted(sim: evis.Simulation) -> dict[str, Any]:
    return {name: (told["counters"], told["events"], told["published"]) for name, told in sim.summary().items()}


def check(scene: str, seed: int, outputs: list[str], count: int = 8, **arguments: Any) -> None:
    """Goes on from a state as the first time: in the same simulation, after something else, and in another one."""
    rng = np.random.default_rng(seed)
    arguments = {**SIZE, "outputs": outputs, "seed": 3, **arguments}
    with warnings.catch_warnings(), evis.Simulation(scene, **arguments) as sim:
        warnings.simplefilter("ignore")
        course, cut = course_of(sim, rng, count), int(rng.integers(1, count - 1))
        sim.reset(seed=3)
        gone(sim, course[:cut])
        state = sim.state()
        expected = [*gone(sim, course[cut:]), content(sim.finish())]
        counts = counted(sim)
        assert sum(len(step[name][2]) for step in expected for name in step if name.endswith("events.t")) > 8 * 20

        sim.restore(state)
        assert_same([*gone(sim, course[cut:]), content(sim.finish())], expected)
        assert counted(sim) == counts
        sim.reset(seed=8)
        gone(sim, course[:2])
        sim.restore(state)
        assert_same(gone(sim, course[cut:]), expected[:-1])
        with evis.Simulation(scene, **arguments) as other:
            assert other.restore(state).stamp_ns == state.stamp_ns
            assert_same(gone(other, course[cut:]), expected[:-1])


@pytest.mark.parametrize("envs", [1, 3])
@pytest.mark.parametrize("scene", ["spinning_disk", "cart_pole", "robot_arm", "falling_objects"])
@pytest.mark.parametrize("more", [{}, {"time_tolerance": 0.001, **NOISE}], ids=["frames", "samples"])
def test_the_same_actions_give_the_same_bytes(scene: str, envs: int, more: dict[str, Any]) -> None:
    check(scene, 3 * envs + len(more), IMAGES, envs=envs, **more)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))])
@pytest.mark.parametrize("scene", ["cart_pole", "robot_arm", "falling_objects"])
def test_any_course_of_actions_and_resets(scene: str, seed: int) -> None:
    check(scene, seed, ["events", "state"], 12, envs=3, **NOISE)


OTHERS: list[tuple[str, list[str], dict[str, Any]]] = [
    ("robot_arm", ["events", "keyframe"], {"interpolator": "splat", "envs": 2, **NOISE}),
    ("spinning_disk", ["events", "keyframe"], {"interpolator": "splat-quadratic"}),
    ("spinning_disk", ["events"], {"interpolator": "none", "envs": 2, "preset": "davis346", "crossing": "cubic"}),
    ("robot_arm", ["events", "image"], {"envs": 2, "preset": "davis346"}),
    ("robot_arm", ["events", "labels.events", "labels.forward_flow"], {"envs": 2, "crossing": "cubic", **NOISE}),
    ("robot_arm", ["events", "physics_error"], {"joints": True}),
    ("stereo_room", ["events", "keyframe"], {"camera_rate": "right=10", **NOISE}),
    ("stereo_room", ["events"], {"camera_rate": "right=10", "interpolator": "splat"}),
    ("flying_shapes", ["events", "labels"], {"envs": 2}),
    ("robot_arm", ["events"], {"model": "v2e", "leak_rate": 5.0, "shot_rate": 5.0, "envs": 2}),
    ("robot_arm", ["events"], {"each": [{"shot_rate": 3}, {"threshold": 0.3, "seed": 55}, {"refractory_us": 900.0}]}),
    ("spinning_disk", ["events"], {"colour": True, **NOISE}),
]  # fmt: skip


@pytest.mark.parametrize(("scene", "outputs", "more"), OTHERS, ids=str)
def test_whatever_a_graph_is_made_of(scene: str, outputs: list[str], more: dict[str, Any]) -> None:
    check(scene, 5, outputs, 9, **more)


@pytest.mark.parametrize("envs", [1, 3])
def test_divergences_before_and_after(tmp_path: Path, envs: int) -> None:
    (tmp_path / "fall.xml").write_text(FALL)
    (tmp_path / "fall.yaml").write_text(FALLING)
    for seed in range(2):
        check(str(tmp_path / "fall.yaml"), seed, ["events", "state"], 14, envs=envs, **NOISE)


@pytest.mark.parametrize(
    ("scene", "more"),
    [("robot_arm", {"envs": 3}), ("falling_objects", {}), ("spinning_disk", {"interpolator": "splat", "envs": 2})],
)
def test_physics_that_cannot_be_copied_takes_its_steps_again(
    monkeypatch: pytest.MonkeyPatch, scene: str, more: dict[str, Any]
) -> None:
    monkeypatch.setattr(PhysicsNode, "kept", lambda self: None)
    check(scene, 7, ["events", "state"], 10, **more, **NOISE)


def test_to_go_back_takes_no_steps_and_needs_no_history(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the run is: of one with more actions than are kept there is a state."""
    monkeypatch.setattr("evis.simulation.run.MOST_KEPT", 10)
    actions = [[0.5], [-0.5], [0.2], [0.1]]
    with evis.Simulation("cart_pole", **SIZE, outputs=["events", "state"]) as sim:
        sim.reset()
        gone(sim, [(action,) for action in actions])
        state = sim.state()
        expected = gone(sim, [(action,) for action in actions])
        with monkeypatch.context() as patch:
            patch.delattr(PhysicsNode, "step")
            sim.restore(state)
        assert_same(gone(sim, [(action,) for action in actions]), expected)
        with pytest.raises(SimulationError, match="more actions than are kept for `save`"):
            sim.save("run.mcap")


def test_steps_that_are_taken_again_need_all_actions(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the keyframe before does, which `splat` looks back to."""
    monkeypatch.setattr("evis.simulation.run.MOST_KEPT", 10)
    with evis.Simulation("cart_pole", **SIZE, interpolator="splat") as sim:
        sim.reset()
        gone(sim, [([0.5],), ([-0.5],)])
        with pytest.raises(SimulationError, match="more actions than are kept for a state"):
            sim.state()


def test_a_reset_right_behind_a_state() -> None:
    """Motion of those that go on is that since the keyframe before, which a reset at the stamp of the last needs."""
    with evis.Simulation("spinning_disk", **SIZE, envs=2, outputs=IMAGES) as sim:
        sim.reset()
        sim.step()
        moved = sim.step().motion
        state = sim.state()
        expected = sim.reset(envs=[1])
        assert moved[0].any() and np.array_equal(expected.motion[0], moved[0]) and not expected.motion[1].any()
        for kept in (state, copy.deepcopy(state), copy.copy(state)):
            sim.restore(kept)
            assert_same([content(sim.reset(envs=[1]))], [content(expected)])


def test_biases_of_an_inertial_unit_walk_on(tmp_path: Path) -> None:
    launch = tmp_path / "unit.yaml"
    launch.write_text(
        "nodes:\n  physics: {type: physics, params: {scene: drone}}\n"
        "  imu: {type: imu, params: {accel_bias: 0.5, gyro_bias: 0.5, accel_noise: 0.002, seed: 3}}\n"
    )
    with evis.Simulation(launch, outputs=["imu"]) as sim:
        sim.run(0.2)
        state = sim.state()
        expected = [content(sim.step()) for _ in range(3)]
        sim.restore(state)
        assert_same([content(sim.step()) for _ in range(3)], expected)
        assert expected[0]["cam0.imu.acceleration"][1][0] > 20


def test_an_action_that_is_held_goes_on() -> None:
    """Of a controller slower than the keyframes, and of one that gives none any more."""
    with evis.Simulation("cart_pole", **SIZE, action_rate=10.0, outputs=["state"]) as sim:
        sim.reset()
        sim.step([0.5])
        state = sim.state()
        expected = [content(sim.step()) for _ in range(2)] + [content(sim.step([-0.5]))]
        sim.restore(state)
        with pytest.raises(SimulationError, match="next is due at keyframe 3"):
            sim.step([0.1])
        assert_same([content(sim.step()) for _ in range(2)] + [content(sim.step([-0.5]))], expected)


def test_a_broken_run_and_an_ended_one_are_left_behind(tmp_path: Path) -> None:
    launch = tmp_path / "physics.yaml"
    launch.write_text("nodes:\n  physics: {type: physics, params: {scene: spinning_disk, duration: 0.2}}\n")
    with evis.Simulation(launch, outputs=["state"]) as sim:
        sim.reset()
        sim.step()
        state = sim.state()
        expected = [content(step) for step in sim.run(1.0)]
        assert expected[-1]["over"] and len(expected) == 5
        ended = sim.state()
        sim.restore(state)
        assert_same([content(step) for step in sim.run(1.0)], expected)
        sim.restore(state)
        assert sim.restore(ended).over
        with pytest.raises(SimulationError, match="has ended"):
            sim.step()
        sim.finish()
        with pytest.raises(SimulationError, match=r"the run has ended; reset\(\) first"):
            sim.state()
        sim.restore(state)
        sim._run.broken = "as a node that failed leaves it"
        with pytest.raises(SimulationError, match="as a node that failed"):
            sim.state()
        sim.restore(state)
        assert_same([content(step) for step in sim.run(1.0)], expected)


def test_what_was_done_before_a_state_is_in_the_bag(tmp_path: Path) -> None:
    with evis.Simulation("cart_pole", **SIZE, envs=2) as sim:
        sim.reset()
        first = sim.step([[0.5], [0.1]])
        state = sim.state()
        sim.step([[-0.5], [0.1]])
        sim.restore(state)
        second = sim.step([[0.2], [0.3]])
        sim.save(tmp_path / "run.mcap")
    events = evis.open(tmp_path / "run.mcap", topic="/env0/cam0/events").numpy()["t"]
    made = [step.events.t[: step.events.env_offsets[1]] for step in (first, second)]
    assert np.array_equal(events, np.concatenate(made))


OWN_NODES = """
import numpy as np

from evis.runtime.node import Input, Node, Output
from msgs.camera import Depth
from msgs.header import Header
from msgs.world import Action


class Sum(Node):
    INPUTS = {"depth": Input("/cam0/depth")}
    OUTPUTS = {"motion": Output("/sum/depth")}
    total = 0.0

    def update(self, inputs):
        self.total += float(inputs["depth"].depth.sum())
        self.publish("motion", Depth(Header(inputs["depth"].header.stamp_ns), np.full((1, 1, 1), self.total, "f4")))


class KeptSum(Sum):
    def state(self):
        return self.total

    def restore(self, state):
        self.total = state


class Swing(Node):
    INPUTS = {"state": Input("/state")}
    OUTPUTS = {"action": Output("/action")}

    def update(self, inputs):
        self.publish("action", Action(Header(inputs["state"].header.stamp_ns), np.zeros((1, 6))))
"""


def test_what_has_no_state_is_refused(tmp_path: Path) -> None:
    with evis.Simulation("spinning_disk", **SIZE) as sim:
        with pytest.raises(SimulationError, match=r"nothing has run yet; reset\(\) first"):
            sim.state()
        for given in (None, {}):
            with pytest.raises(SimulationError, match=r"restore takes what sim.state\(\) gave"):
                sim.restore(given)  # type: ignore[arg-type]
    with evis.Simulation("spinning_disk", **SIZE, outputs=["events", "audit"]) as sim:
        sim.reset()
        with pytest.raises(SimulationError, match="leave audit out of the outputs"):
            sim.state()
        sim.step()  # and it goes on


@pytest.mark.parametrize("seconds", [0.1, 0.2])
def test_a_node_of_ones_own_says_what_it_goes_on_from(tmp_path: Path, seconds: float) -> None:
    """Without `state` it is refused by its name; with it, it goes on, also where it is not rewound but made anew."""
    (tmp_path / "sum_nodes.py").write_text(OWN_NODES)
    launch = tmp_path / "own.yaml"
    graph = "include: {{file: simulator, args: {{scene: {}}}}}\nnodes:\n  own: {{type: sum_nodes:{}}}\n"
    launch.write_text(graph.format("spinning_disk", "Sum"))
    with evis.Simulation(launch, **SIZE, outputs=["events", "sum.depth"]) as sim:
        sim.reset()
        with pytest.raises(SimulationError, match=r"own \(Sum\) does not tell what it goes on from; leave it out, or"):
            sim.state()
    launch.write_text(graph.format("spinning_disk", "KeptSum"))
    with evis.Simulation(launch, **SIZE, outputs=["events", "sum.depth"]) as sim:
        sim.run(seconds)
        state = sim.state()
        expected = [content(sim.step()) for _ in range(2)]
        sim.restore(state)
        assert_same([content(sim.step()) for _ in range(2)], expected)
        assert "sum.depth" in expected[0]
    launch.write_text(graph.format("robot_arm", "Swing"))
    with evis.Simulation(launch, **SIZE) as sim:
        sim.reset()
        with pytest.raises(SimulationError, match=r"is driven by node own, .*give the actions to step"):
            sim.state()


def test_a_state_of_another_simulation_is_refused_and_nothing_happens() -> None:
    with evis.Simulation("spinning_disk", **SIZE) as sim, evis.Simulation("spinning_disk", **SIZE) as alike:
        sim.reset()
        alike.reset()
        cases: list[tuple[dict[str, Any], str]] = [
            ({"omega": 20}, "with scene_args="),
            ({"threshold": 0.3}, "with threshold=0.3 of event_sensor, and this one has None"),
            ({"outputs": ["events", "labels"]}, "with a node labeler, and this one is without"),
            ({"envs": 2}, "with envs=2 of physics, and this one has 1"),
        ]
        for more, text in cases:
            with evis.Simulation("spinning_disk", **{**SIZE, **more}) as other:
                other.reset()
                with pytest.raises(SimulationError, match=text) as error:
                    sim.restore(other.state())
                assert str(error.value).endswith("make one by the same arguments and outputs")
        assert_same([content(sim.step())], [content(alike.step())])
