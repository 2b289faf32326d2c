"""A step that an error of the task or Ctrl-C ends: environments that nothing disturbed are the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box

import evis
from evis.env import EventEnv, EventVectorEnv, Observation, State, Task, TimeSurface, VoxelGrid
from evis.env.observation import Moment, Setting
from evis.env.task import SMALL
from evis.scene import load_scene

SIZE = {**SMALL, "width": 32, "height": 32}
PUSH = np.array([[0.4], [-0.3]], np.float32)


class Trap(Observation):
    """Observes nothing, and raises what it is told to."""

    def __init__(self, raises: list[BaseException]) -> None:
        self.raises = raises

    def __deepcopy__(self, _memo: Any) -> Trap:
        return self

    def begin(self, setting: Setting) -> Box:
        return Box(0, 1, (1,), np.float32)

    def state(self) -> None: ...

    def restore(self, state: Any) -> None: ...

    def values(self, moment: Moment) -> np.ndarray:
        if self.raises:
            raise self.raises.pop()
        return np.zeros((len(moment.fresh), 1), np.float32)


def environments(in_reward: list[BaseException], in_values: list[BaseException], mode: str) -> EventVectorEnv:
    def reward(state: State) -> np.ndarray:
        if in_reward:
            raise in_reward.pop()
        return state.twist("cart")[:, 0]

    # The trap comes last: what is before it has had the step when it raises.
    parts = {"surface": TimeSurface(), "voxels": VoxelGrid(2), "trap": Trap(in_values)}
    task = Task("cart_pole", parts, reward=reward, arguments=SIZE, seconds=0.1)
    return EventVectorEnv(task, 2, autoreset_mode=mode)


def steps(envs: EventVectorEnv, n: int) -> list[bytes]:
    made = []
    for _ in range(n):
        observed, *rest = envs.step(PUSH)
        made += [observed["surface"].tobytes(), observed["voxels"].tobytes(), *(value.tobytes() for value in rest[:3])]
    return made


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_what_was_left_in_the_middle_goes_on_by_a_reset_or_a_state_alone(mode: str) -> None:
    in_reward: list[BaseException] = []
    in_values: list[BaseException] = []
    envs = environments(in_reward, in_values, mode)
    envs.reset(seed=3)
    with pytest.raises(ValueError, match="nan for actuator push"):  # nothing has begun, and the first step follows
        envs.step(PUSH * np.nan)
    before = steps(envs, 3)
    state = envs.state()
    later = steps(envs, 9)  # over an end
    for trap, error in (
        (in_reward, RuntimeError("a bug")),
        (in_values, KeyboardInterrupt()),
        (in_reward, KeyboardInterrupt()),
    ):
        envs.reset(seed=3)
        assert steps(envs, 3) == before
        trap.append(error)
        with pytest.raises(type(error)):
            envs.step(PUSH)
        told = "RuntimeError: a bug" if isinstance(error, RuntimeError) else "KeyboardInterrupt"
        says = rf"a step or reset was left in the middle \({told}\); reset\(\) begins anew"
        for refused in (
            lambda: envs.step(PUSH),
            envs.state,
            lambda: envs.reset(options={"reset_mask": np.array([True, False])}),
        ):
            with pytest.raises(ValueError, match=says):
                refused()
        envs.restore(state)
        assert steps(envs, 9) == later
    envs.reset(seed=3)
    in_values.append(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        envs.reset()
    with pytest.raises(ValueError, match="left in the middle"):
        envs.step(PUSH)
    envs.reset(seed=3)
    assert steps(envs, 3) == before
    envs.close()


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Task, list[int], list[int]]:
    """A task whose seeds draw the event model, and seeds that draw the one and the other."""
    folder: Path = tmp_path_factory.mktemp("drawn")
    (folder / "slide.xml").write_text(
        "<mujoco><worldbody><body name='b'><joint name='j' type='slide'/><geom size='0.1'/></body></worldbody>"
        "<actuator><motor joint='j' ctrlrange='-1 1' ctrllimited='true'/></actuator></mujoco>"
    )
    scene = folder / "drawn.yaml"
    scene.write_text(
        "mjcf: slide.xml\nargs: {drawn: {default: {from: 0, to: 2}, help: which sensor}}\nenvironment: 0.3\n"
        "initial_joints: {j: {velocity: [1, 1]}}\n"
        "cameras: {cam0: {position: [0, 1, 0], look_at: [0, 0, 0], fov: 50 deg}}\n"
        "sensor: {model: \"${'evis' if drawn < 1 else 'evis-paper'}\"}\n"
    )
    models = [load_scene(str(scene), seed=seed).sensor["model"] for seed in range(12)]
    own, other = ([k for k, model in enumerate(models) if (model == models[0]) is same] for same in (True, False))
    arguments = {"width": 32, "height": 24, "upsampling": 4}
    return Task(str(scene), TimeSurface(), arguments=arguments), own, other


def test_a_reset_of_some_that_is_refused_changes_nothing(drawn: tuple[Task, list[int], list[int]]) -> None:
    """Neither what goes on, nor who has ended, nor which episode comes next."""
    task, own, other = drawn
    disturbed, undisturbed = (EventVectorEnv(task, 2, autoreset_mode="Disabled", seconds=0.1) for _ in range(2))
    for envs in (disturbed, undisturbed):
        envs.reset(seed=own[:2])
        for _ in range(2):
            envs.step(np.zeros((2, 1)))
    only_first = {"reset_mask": np.array([True, False])}
    with pytest.raises(evis.SimulationError):
        disturbed.reset(seed=[other[0], own[1]], options=only_first)
    for envs in (disturbed, undisturbed):
        assert envs.step(np.zeros((2, 1)))[3].all()
    with pytest.raises(evis.SimulationError):
        disturbed.reset(seed=[other[0], own[1]], options=only_first)
    with pytest.raises(ValueError, match="environment 0 has ended"):
        disturbed.step(np.zeros((2, 1)))
    assert disturbed._batch._seeds.tolist() == own[:2] and not disturbed._batch._episodes.any()
    disturbed.close()
    undisturbed.close()


def test_a_refused_beginning_is_none(drawn: tuple[Task, list[int], list[int]]) -> None:
    """Two that cannot go together are not begun, and the run before has ended with that."""
    task, own, other = drawn
    envs = EventVectorEnv(task, 2)
    envs.reset(seed=own[:2])
    expected = envs.step(np.zeros((2, 1)))[0]
    with pytest.raises(evis.SimulationError):
        envs.reset(seed=[own[0], other[0]])
    with pytest.raises(ValueError, match=r"left in the middle .*; reset\(\) begins anew"):
        envs.step(np.zeros((2, 1)))
    envs.reset(seed=own[:2])
    np.testing.assert_array_equal(envs.step(np.zeros((2, 1)))[0], expected)
    envs.close()


def test_a_single_environment_too() -> None:
    env = EventEnv("CartPole", **SIZE)
    env.reset(seed=1)
    env.step(PUSH[0])
    expected = env.step(PUSH[0])[0]
    env.reset(seed=1)
    task = env._batch.task
    task.info = lambda state: {"wrong": np.zeros(5)}  # type: ignore[method-assign]
    with pytest.raises(ValueError, match="info wrong of the task has shape"):
        env.step(PUSH[0])
    del task.info  # type: ignore[method-assign]
    with pytest.raises(ValueError, match=r"left in the middle \(info wrong of the task"):
        env.step(PUSH[0])
    env.reset(seed=1)
    env.step(PUSH[0])
    np.testing.assert_array_equal(env.step(PUSH[0])[0], expected)
    env.close()
