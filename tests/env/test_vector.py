"""Environments of one simulation against as many simulations of one: Gymnasium's SyncVectorEnv is the truth."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import evis.env

SIZE = {"width": 32, "height": 32, "seconds": 0.3}
N = 3


def vector(mode: str, **options: Any) -> evis.env.EventVectorEnv:
    return gymnasium.make_vec("evis/CartPole-v0", num_envs=N, autoreset_mode=mode, **SIZE, **options)


def singles(mode: str) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: evis.env.EventEnv("CartPole", **SIZE)] * N, autoreset_mode=mode)


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


def test_seeds_of_their_own() -> None:
    env = vector("SameStep")
    a, _ = env.reset(seed=[4, 9, 4])
    for _ in range(5):
        a, *_ = env.step(np.zeros((N, 1)))
    assert (a[0] == a[2]).all() and (a[0] != a[1]).any()
    for seeds, message in (([1, 2], "2 seeds for 3"), ([1, None, 2], "None for all")):
        with pytest.raises(ValueError, match=message):
            env.reset(seed=seeds)
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
