"""Rewards and ends in closed form, tasks of one's own, and the controllers of examples/."""

import sys
from pathlib import Path

import numpy as np
import pytest

import evis
import evis.env
from evis.env.state import State
from evis.env.tasks.cart_pole import CartPole
from evis.env.tasks.pan_tilt import PanTilt
from evis.env.tasks.pong import Pong
from msgs.header import Header
from msgs.world import WorldState

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "tasks"


def state(names: list[str], pose: list, start: list | None = None, end: list | None = None) -> State:
    """One environment; pose by body, and the velocities of the last body at start and end of the step."""
    poses = np.zeros((1, 2, len(names), 7))
    poses[..., 6] = 1
    twist = np.zeros((1, 2, len(names), 6))
    for n, values in enumerate(pose):
        poses[0, :, n, : len(values)] = values
    if start is not None and end is not None:
        twist[0, 0, -1, :3], twist[0, 1, -1, :3] = start, end
    t = np.array([0, 20_000_000])
    message = WorldState.dense(Header(20_000_000), t, poses, twist, np.zeros(1, np.int32), names=names)
    return State(message, np.array([0.02]), np.zeros((1, 1)))


@pytest.mark.parametrize(
    ("degrees", "place", "reward", "ends"),
    [
        (0, 0, 1, False),
        (7.5, 0, 0.75, False),
        (-7.5, 0.425, 0.5, False),
        (16, 0, 0.466667, True),
        (0, -0.9, 0.4706, True),
    ],
)
def test_a_pole(degrees: float, place: float, reward: float, ends: bool) -> None:
    half = np.radians(degrees) / 2
    now = state(["cart", "pole"], [[place], [place, 0, 0, 0, np.sin(half), 0, np.cos(half)]])
    task = CartPole()
    assert np.isclose(task.reward(now), reward, atol=1e-3) and task.terminated(now) == ends
    assert np.isclose(task.info(now)["angle"], np.radians(degrees))


@pytest.mark.parametrize(
    ("ball", "offset", "ends"),
    [([1.5, 0, 0], 0.0, False), ([1, np.tan(0.2), 0], 0.2, False), ([1, 0, 1], np.pi / 4, True)],
)
def test_a_ball_in_view(ball: list, offset: float, ends: bool) -> None:
    now = state(["head", "ball"], [[0, 0, 0], ball])
    task = PanTilt()
    assert np.isclose(task.info(now)["offset"], offset) and task.terminated(now) == ends
    assert np.isclose(task.reward(now), max(0, 1 - offset / np.radians(25)))


def test_a_head_that_looks_at_the_ball_has_it_in_the_middle() -> None:
    turned = [0, 0, 0, 0, 0, np.sin(0.2), np.cos(0.2)]
    now = state(["head", "ball"], [turned, [np.cos(0.4), np.sin(0.4), 0]])
    assert np.isclose(PanTilt().info(now)["offset"], 0)


def test_the_offset_of_a_ball_in_a_corner_is_the_angle_to_the_optical_axis() -> None:
    """By the scalar product of both directions; at 20 degrees either way it is 27.2 degrees, not 20 times sqrt(2)."""
    ball = np.array([1, np.tan(np.radians(20)), np.tan(np.radians(20))])
    now = state(["head", "ball"], [[0, 0, 0], ball.tolist()])
    assert np.isclose(PanTilt().info(now)["offset"], np.arccos(ball[0] / np.linalg.norm(ball)))


@pytest.mark.parametrize(
    ("x", "before", "after", "reward", "ends"),
    [(0.1, -3, 3, 1, False), (0.1, -3, -3, 0, False), (1.9, 3, -3, 0, False), (-0.1, -3, -3, -1, True)],
)
def test_a_return(x: float, before: float, after: float, reward: float, ends: bool) -> None:
    now = state(["paddle", "ball"], [[0, 0.3], [x, 0.1, 0]], [before, 0, 0], [after, 0, 0])
    assert Pong().reward(now) == reward and Pong().terminated(now) == ends
    assert np.isclose(Pong().info(now)["across"], -0.2)


def test_a_task_of_ones_own_by_functions() -> None:
    """Rewarded for the first joint's position, ended by the time since the reset."""
    task = evis.env.Task(
        "robot_arm", {"counts": evis.env.CountImage(), "joints": evis.env.Joints()},
        reward=lambda state: state.joints[0][:, 0], terminated=lambda state: state.seconds > 0.09,
        arguments={"width": 32, "height": 32, "keyframe_rate": 50.0, "upsampling": 1, "interpolator": "none"},
    )  # fmt: skip
    env = evis.env.EventEnv(task, normalise=False)
    observed, _ = env.reset(seed=0)
    assert observed["counts"].shape == (2, 32, 32)
    ends = []
    for _ in range(5):
        observed, reward, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape))
        ends.append(terminated)
        assert np.isclose(reward, observed["joints"][0]) and not truncated
    assert ends == [False] * 4 + [True]
    env.close()


@pytest.mark.parametrize(
    ("name", "task"), [("cart_pole", CartPole()), ("pan_tilt", PanTilt()), ("pong", Pong())], ids=lambda v: str(v)[:9]
)
def test_the_controller_as_a_node_closes_the_loop(name: str, task: evis.env.Task) -> None:
    """The launch file of the examples, stepped here for 3 s: nothing that would end an episode happens."""
    with evis.Simulation(str(EXAMPLES / f"{name}.yaml"), outputs=("events", "state"), seed=2) as simulation:
        steps = simulation.run(3.0)
    states = [State(step.state, np.full(1, step.stamp_ns * 1e-9), np.zeros((1, 1))) for step in steps]
    assert len(states) == 151 and not any(task.terminated(now)[0] for now in states)
    assert sum(len(step.events.t) for step in steps) > 1000


@pytest.fixture
def score(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))
    import score

    yield score
    for name in ("score", "cart_pole", "pan_tilt", "pong", "changed_pixels"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("task", list(evis.env.TASKS))
def test_the_controller_of_the_examples_does_what_doing_nothing_does_not(task: str, score) -> None:
    """For 3 s, of two seeds."""
    seeds = range(2)
    with_it = score.play(task, "controller", seeds, seconds=3.0)
    without = score.play(task, "nobody", seeds, seconds=3.0)
    assert (with_it[:, 1] == 150).all(), with_it
    assert with_it[:, 0].mean() > 1.5 * max(without[:, 0].mean(), 0)


@pytest.mark.parametrize(
    ("arguments", "said"), [(["--seeds", "0"], "--seeds is 0; it must be 1 or more"), (["--tasks", "pong"], "'Pong'")]
)
def test_a_table_of_nothing_is_refused(
    arguments: list[str], said: str, score, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(sys, "argv", ["score.py", *arguments])
    with pytest.raises(SystemExit):
        score.main()
    told = capsys.readouterr()
    assert said in told.err and not told.out


@pytest.mark.slow
@pytest.mark.parametrize("task", list(evis.env.TASKS))
def test_the_controllers_do_whole_episodes(task: str, score) -> None:
    found = score.play(task, "controller", range(100, 110))
    assert (found[:, 1] == 500).mean() >= 0.9, found
