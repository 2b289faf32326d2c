"""`state` and `restore` of environments: a branch is what an uninterrupted episode is."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box

import evis.env
from evis.env import EventEnv, EventVectorEnv, Frames, Joints, LastAction, TimeSurface, VoxelGrid
from evis.env.observation import Moment, Setting

SMALL: dict[str, Any] = {"width": 32, "height": 32, "preset": "dvs128"}
SEEN = {"surface": TimeSurface(), "picture": Frames(), "action": LastAction(), "joints": Joints()}


def gone(env: EventVectorEnv, actions: np.ndarray) -> list[bytes]:
    """Gives all that steps return, and a picture."""
    found = []
    for action in actions:
        observed, *rest, info = env.step(action)
        told = [info["diverged"], *(info[name] for name in sorted(info) if name == "_final_obs")]
        found.append(b"".join(np.asarray(a).tobytes() for a in (*observed.values(), *rest, *told, *env.render())))
    return found


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
@pytest.mark.parametrize("task", ["CartPole", "PanTilt"])
def test_a_branch_is_the_uninterrupted_run(task: str, mode: str) -> None:
    """Episodes end and begin anew before and after the state, each environment by itself."""
    options: dict[str, Any] = {"autoreset_mode": mode, "seconds": 0.2, "observation": SEEN, **SMALL}
    rng = np.random.default_rng(5)
    with_pictures = {**options, "render_mode": "rgb_array"}
    env, other = (EventVectorEnv(task, 3, **with_pictures) for _ in range(2))
    actions = rng.uniform(-1, 1, (32, *env.action_space.shape)).astype(np.float32)
    env.reset(seed=3)
    gone(env, actions[:13])
    state, picture = env.state(), env.render()[1].tobytes()
    observed = {name: values.copy() for name, values in env.step(actions[13])[0].items()}
    env.restore(state)
    expected = gone(env, actions[13:])
    for branch in (env, other):
        seen, info = branch.restore(state)
        assert info == {} and branch.render()[1].tobytes() == picture
        seen["surface"][:] = -1  # the arrays are the caller's own
        again = branch.step(actions[13])[0]
        assert all(np.array_equal(again[name], observed[name]) for name in observed)
        branch.restore(state)
        assert gone(branch, actions[13:]) == expected
        branch.restore(state)
    env.close()
    other.close()


def test_a_single_environment_looks_ahead() -> None:
    """What `gymnasium.make` wraps is asked itself; the state is restored as often as there are branches."""
    made = gymnasium.make("evis/CartPole-v0", **SMALL)
    env = made.unwrapped
    assert isinstance(env, EventEnv)
    with pytest.raises(ValueError, match=r"nothing has begun; reset\(\) first"):
        env.state()
    made.reset(seed=1)
    for _ in range(4):
        seen = made.step(np.zeros(1, np.float32))[0]
    state, branches = env.state(), []
    for push in (-1.0, 1.0, -1.0):
        restored, _ = env.restore(state)
        assert np.array_equal(restored, seen)
        branches.append([env.step(np.array([push], np.float32)) for _ in range(5)])
    left, right, again = ([step[0].tobytes() for step in branch] for branch in branches)
    assert left == again != right
    assert [step[1] for step in branches[0]] == [step[1] for step in branches[2]]
    made.close()


class Counted(evis.env.Observation):
    """Shows how many steps there were; keeps something that cannot be copied, where it is asked to."""

    def __init__(self, kept: Any = None) -> None:
        self.kept = kept

    def begin(self, setting: Setting) -> Box:
        self.steps = np.zeros((setting.envs, 1), np.float32)
        return Box(0, np.inf, (1,), np.float32)

    def values(self, moment: Moment) -> np.ndarray:
        self.steps[moment.fresh] += 1
        return self.steps.copy()


def test_observations_of_ones_own() -> None:
    """All attributes go with the state, unless the class says which."""
    with_task = {"seconds": 0, **SMALL}
    env = EventVectorEnv("CartPole", 2, observation=Counted(), **with_task)
    env.reset(seed=1)
    zero = np.zeros((2, 1), np.float32)
    env.step(zero)
    state = env.state()
    env.step(zero)
    assert env.restore(state)[0].tolist() == [[2], [2]]
    assert env.step(zero)[0].tolist() == [[3], [3]]
    env.close()
    generator = (number for number in range(3))
    env = EventVectorEnv("CartPole", 2, observation=Counted([]), **with_task)
    env._batch._parts[""].kept = generator  # type: ignore[attr-defined]
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"an observation keeps what cannot be copied, and has no state\(\)"):
        env.state()
    env.close()


def test_a_state_of_other_environments_is_refused() -> None:
    env = EventVectorEnv("CartPole", 2, **SMALL)
    env.reset(seed=1)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"num_envs": 3}, "with envs=3 of "),
        ({"observation": VoxelGrid(3)}, "observe something else"),
        ({"threshold": 0.35}, "with threshold=0.35 of event_sensor"),
    ]
    for more, text in cases:
        other = EventVectorEnv("CartPole", **{"num_envs": 2, **SMALL, **more})
        other.reset(seed=1)
        with pytest.raises(ValueError, match=text):
            env.restore(other.state())
        other.close()
    with pytest.raises(ValueError, match=r"restore takes what state\(\) gave, not None"):
        env.restore(None)  # type: ignore[arg-type]
    env.step(np.zeros((2, 1), np.float32))
    env.close()
