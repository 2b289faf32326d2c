"""Environments of one simulation against as many simulations of one: Gymnasium's SyncVectorEnv is the truth."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import evis.env
from evis.env import CountImage, Frames, Joints, LastAction, RawEvents, TimeSurface, VoxelGrid
from evis.env.observation import Moment, Setting

SMALL = {"width": 32, "height": 32}
SIZE = {**SMALL, "seconds": 0.3}
N = 3


def vector(mode: str, **options: Any) -> evis.env.EventVectorEnv:
    return gymnasium.make_vec("evis/CartPole-v0", num_envs=N, autoreset_mode=mode, **{**SIZE, **options})


def singles(mode: str, **options: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: evis.env.EventEnv("CartPole", **{**SIZE, **options})] * N, autoreset_mode=mode)


class Steps(evis.env.Observation):
    """Counts steps in which there were events: an observation that keeps something that each step changes."""

    def begin(self, setting: Setting) -> gymnasium.spaces.Box:
        self.kept = np.zeros((setting.envs, 2), np.float32)
        return gymnasium.spaces.Box(0, np.inf, (2,), np.float32)

    def forget(self, envs: np.ndarray) -> None:
        self.kept[envs] = 0

    def values(self, moment: Moment) -> np.ndarray:
        events = np.diff(moment.step.events.env_offsets)
        self.kept[moment.fresh] += np.stack((np.ones(len(events)), events > 0), axis=1)[moment.fresh]
        return self.kept.copy()


SEEN = {
    "counts": CountImage(),
    "voxels": VoxelGrid(3),
    "raw": RawEvents(200),
    "surface": TimeSurface(pool=2),
    "frame": Frames(),
    "joints": Joints(),
    "did": LastAction(),
    "steps": Steps(),
}


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_it_does_what_single_environments_do(mode: str) -> None:
    """Observations to the bit, over episodes that end by falling and by time at different steps."""
    one, many = vector(mode), singles(mode)
    assert one.single_observation_space == many.single_observation_space
    assert one.single_action_space == many.single_action_space and one.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert (one.reset(seed=7)[0] == many.reset(seed=7)[0]).all()
    one.action_space.seed(1)
    ends = np.zeros(N, int)
    for _ in range(40):
        # Pushed to different sides, they fall at different times.
        action = np.clip(one.action_space.sample() + np.array([[1], [0], [-1]], np.float32), -1, 1)
        got, want = one.step(action), many.step(action)
        for name, a, b in zip(("observation", "reward", "terminated", "truncated"), got, want):
            np.testing.assert_array_equal(a, b, name)
        ended = got[2] | got[3]
        ends += ended
        if mode == "SameStep" and ended.any():
            assert (got[4]["_final_obs"] == want[4]["_final_obs"]).all()
            for env in np.flatnonzero(ended):
                np.testing.assert_array_equal(got[4]["final_obs"][env], want[4]["final_obs"][env])
        there = want[4].get("_angle", np.zeros(N, bool))  # missing where all have begun anew
        np.testing.assert_array_equal(got[4]["_angle"], there)
        if there.any():
            np.testing.assert_array_equal(got[4]["angle"][there], want[4]["angle"][there])
    assert (ends >= 2).all(), ends
    one.close()
    many.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_others_see_the_same_when_one_is_reset(mode: str) -> None:
    """To the bit, of all that can be seen and of pictures: the events of a step in which another one ends, too.

    A time surface alone does not show it, which outlasts the step.
    """
    options: dict[str, Any] = {"observation": SEEN, "render_mode": "rgb_array"}
    one, many = vector(mode, **options), singles(mode, **options)

    def compare(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
        for name in SEEN:
            np.testing.assert_array_equal(a[name], b[name], name)
        np.testing.assert_array_equal(one.render(), many.render())

    compare(one.reset(seed=3)[0], many.reset(seed=3)[0])
    one.action_space.seed(1)
    alone = 0
    for _ in range(30):
        action = np.clip(one.action_space.sample() + np.array([[1], [0], [-1]], np.float32), -1, 1)
        got, want = one.step(action), many.step(action)
        compare(got[0], want[0])
        ended = got[2] | got[3]
        alone += ended.any() and not ended.all() and bool(got[0]["counts"][~ended].any())
        if mode == "SameStep":
            for env in np.flatnonzero(ended):
                for name in SEEN:
                    np.testing.assert_array_equal(got[4]["final_obs"][env][name], want[4]["final_obs"][env][name], name)
        if mode == "Disabled" and ended.any():
            # One after the other, and what the caller does with the arrays it was given is its own affair.
            for env in np.flatnonzero(ended):
                got[0]["counts"][:] = 9
                mask = {"reset_mask": np.arange(N) == env}
                compare((got := one.reset(options=dict(mask)))[0], many.reset(options=dict(mask))[0])
    assert alone >= 2
    one.close()
    many.close()


def test_seeds_of_their_own() -> None:
    env = vector("SameStep")
    a, _ = env.reset(seed=[4, 9, 4])
    for _ in range(5):
        a, *_ = env.step(np.zeros((N, 1)))
    assert (a[0] == a[2]).all() and (a[0] != a[1]).any()
    env.reset(seed=4)
    after = env.reset()[0]
    env.reset(seed=4)
    whole = "it takes whole numbers, 0 to"
    for seeds, message in (
        ([1, 2], "2 seeds for 3"),
        ([1, None, 2], "None for all"),
        ([1.5, 2, 3], f"1.5 for a seed; {whole}"),
        ([-1, 2, 3], f"-1 for a seed; {whole}"),
        ([2**64, 2, 3], whole),
        (1.5, whole),
        (-1, whole),
        (2**63 - 1, whole),
    ):
        with pytest.raises(ValueError, match=message):
            env.reset(seed=seeds)
    assert (env.reset()[0] == after).all(), "a reset that is refused leaves the seeds as they were"
    env.close()


def test_the_action_of_one_that_has_ended_may_be_anything() -> None:
    """With NextStep the step after the end ignores it; of one that goes on it is looked at."""
    env = vector("NextStep", seconds=0.1)
    env.reset(seed=3)
    for _ in range(5):
        *_, truncated, _ = env.step(np.zeros((N, 1)))
    assert truncated.all()
    seen, reward, *_ = env.step(np.full((N, 1), np.nan))
    assert (reward == 0).all() and np.isfinite(seen).all()
    with pytest.raises(ValueError, match="nan for actuator push"):
        env.step(np.full((N, 1), np.nan))
    env.close()


@pytest.mark.parametrize("name", ["reward", "terminated"])
def test_a_task_says_one_value_of_each_environment(name: str) -> None:
    """[E, 1] beside [E] would become [E, E] by numpy's rules."""
    task = evis.env.Task("cart_pole", Joints(), **{name: lambda state: state.pose("cart")[:, :1] > 0}, arguments=SMALL)
    env = evis.env.EventVectorEnv(task, N)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=rf"{name} of the task has shape \[3, 1\]; it must be \[3\]"):
        env.step(np.zeros((N, 1)))
    env.close()


class Telling(evis.env.Task):
    """A task whose `info` and reward are given."""

    def __init__(self, told: Any, reward: Any = 0.0) -> None:
        super().__init__("cart_pole", LastAction(), reward=lambda state: reward, arguments=SMALL)
        self.told = told

    def info(self, state: Any) -> dict[str, Any]:
        return {"told": self.told}


def test_what_a_task_tells_is_of_each_environment() -> None:
    """Also of a single one, where a plain number had no axis to take it from."""
    single = evis.env.EventEnv(Telling(3.0))
    single.reset(seed=1)
    assert single.step(np.zeros(1))[4]["told"] == 3.0
    single.close()
    for told, reward, says in (
        (np.zeros(3), 0.0, r"info told of the task has shape \[3\]; its first axis must be 2"),
        (0.0, None, r"reward of the task is None; it must be numbers \[2\]"),
    ):
        envs = evis.env.EventVectorEnv(Telling(told, reward), 2)
        envs.reset(seed=1)
        with pytest.raises(ValueError, match=says):
            envs.step(np.zeros((2, 1)))
        envs.close()


def test_an_action_beyond_the_range_by_a_rounding_is_seen_within_the_space() -> None:
    env = evis.env.EventEnv(Telling(0.0))
    env.reset(seed=1)
    seen = env.step(np.array([1 + 5e-7]))[0]
    assert seen == 1.0 and env.observation_space.contains(seen)
    env.close()


def test_some_are_reset_by_a_mask() -> None:
    """Those that are not masked go on; without a reset, one that has ended cannot be stepped."""
    env = vector("Disabled")
    with pytest.raises(ValueError, match="first reset is of all"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    env.reset(seed=3)
    for _ in range(15):
        _, _, terminated, truncated, info = env.step(np.zeros((N, 1)))
    assert (terminated | truncated).all()
    with pytest.raises(ValueError, match="environment 0 has ended"):
        env.step(np.zeros((N, 1)))
    env.reset(seed=3)
    _, _, _, _, info = env.step(np.zeros((N, 1)))
    env.reset(seed=[50, 51, 52], options={"reset_mask": np.array([False, True, False])})
    _, _, _, _, later = env.step(np.zeros((N, 1)))
    assert (np.abs(later["angle"] - info["angle"])[[0, 2]] < 0.01).all()
    single = evis.env.EventEnv("CartPole", **SIZE)
    single.reset(seed=51)
    assert later["angle"][1] == single.step(np.zeros(1))[4]["angle"]
    with pytest.raises(ValueError, match=r"bool \[3\]"):
        env.reset(options={"reset_mask": np.zeros(2)})
    env.close()
    single.close()


def test_every_environment_is_rendered() -> None:
    env = vector("SameStep", render_mode="rgb_array")
    env.reset(seed=[1, 1, 2])
    pictures = env.render()
    assert len(pictures) == N and (pictures[0] == pictures[1]).all() and (pictures[0] != pictures[2]).any()
    env.close()


def test_a_mode_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match="autoreset_mode is 'Same'; it must be NextStep, SameStep or Disabled"):
        vector("Same")


@pytest.mark.parametrize(("steps", "seconds"), [(4, 0), (4, 0.06), (4, 1.0), (-1, 0.1)])
def test_gymnasiums_limit_of_steps_is_that_of_its_wrapper(steps: int, seconds: float) -> None:
    """Registered with it or made with it; a task's own time holds where it is shorter."""
    made = {"num_envs": 2, "seconds": seconds, **SMALL}
    own = gymnasium.make_vec("evis/CartPole-v0", max_episode_steps=steps, **made)
    wrapped = gymnasium.make_vec("evis/CartPole-v0", max_episode_steps=steps, vectorization_mode="sync", **made)
    for envs in (own, wrapped):
        envs.reset(seed=1)
    for _ in range(12):
        mine, theirs = (envs.step(np.zeros((2, 1), np.float32)) for envs in (own, wrapped))
        np.testing.assert_array_equal(mine[0], theirs[0])
        np.testing.assert_array_equal(mine[3], theirs[3])
    own.close()
    wrapped.close()


def test_an_environment_that_is_registered_with_a_limit_of_steps() -> None:
    gymnasium.register(
        "tests/Limited-v0",
        vector_entry_point="evis.env:EventVectorEnv",
        kwargs={"task": "CartPole", **SMALL},
        max_episode_steps=2,
    )
    envs = gymnasium.make_vec("tests/Limited-v0", num_envs=2)
    envs.reset(seed=1)
    assert [envs.step(np.zeros((2, 1), np.float32))[3].tolist() for _ in range(2)] == [[False] * 2, [True] * 2]
    envs.close()


def test_a_number_of_environments_of_any_whole_type() -> None:
    for several in (2.0, np.int64(2), "2"):
        envs = evis.env.EventVectorEnv("CartPole", several, **SMALL)  # type: ignore[arg-type]
        assert envs.num_envs == 2 and envs.reset(seed=1)[0].shape == (2, 2, 32, 32)
        envs.close()


def test_bounds_of_the_space_are_within_it(tmp_path: Path) -> None:
    """As float32 those of a narrow range far from zero lie outside it by more than a millionth of the range."""
    (tmp_path / "hover.xml").write_text(
        "<mujoco><option gravity='0 0 -9.81'/><worldbody><body name='b'><joint name='j' type='slide' axis='0 0 1'/>"
        "<geom size='0.1' mass='101.95'/></body><camera name='c' pos='0 -2 0' xyaxes='1 0 0 0 0 1'/></worldbody>"
        "<actuator><motor joint='j' ctrlrange='1000.1 1000.2' ctrllimited='true'/></actuator></mujoco>"
    )
    bounds = np.array([1000.1, 1000.2])
    assert (np.abs(bounds.astype(np.float32) - bounds) > 1e-7).all()
    task = evis.env.Task(str(tmp_path / "hover.xml"), evis.env.Joints(), arguments=SMALL)
    env = evis.env.EventEnv(task, normalise=False)
    for bound, exact in zip((env.action_space.low, env.action_space.high), bounds):
        env.reset(seed=0)
        velocity = env.step(bound)[0][1]
        assert velocity == pytest.approx((exact / 101.95 - 9.81) * 1 / env.unwrapped.simulation.keyframe_rate, rel=1e-3)
    with pytest.raises(ValueError, match=r"it must be from 1000\.1 to 1000\.2"):
        env.step(np.nextafter(np.nextafter(env.action_space.high, np.float32(2e3)), np.float32(2e3)))
    env.close()
