"""A state with only the bodies that move against all sub-steps of all bodies."""

import numpy as np
import pytest

from msgs.codec import contents
from msgs.fields import MessageError
from msgs.header import Header
from msgs.world import WorldState, moving_bodies

E, S, N = 2, 4, 5
T = np.arange(S) * 1_000_000


def moved(pose_of=(), twist_of=()):
    """Poses and twists of bodies that stand, but for changes (environment, sub-step, body) in one number each."""
    rng = np.random.default_rng(1)
    pose = np.repeat(rng.normal(size=(E, 1, N, 7)), S, axis=1)
    twist = np.zeros((E, S, N, 6))
    for index in pose_of:
        pose[index][4] += 1e-16 + abs(pose[index][4]) * 1e-15
    for index in twist_of:
        twist[index][1] = 1e-300
    return pose, twist


@pytest.mark.parametrize(
    "changes, expected",
    [
        ({}, []),
        ({"pose_of": [(1, 2, 3)]}, [3]),
        ({"pose_of": [(0, 3, 4), (0, 0, 0)]}, [0, 4]),
        ({"twist_of": [(0, 0, 2)], "pose_of": [(1, 0, 1)]}, [1, 2]),
        ({"pose_of": [(0, 1, n) for n in range(N)]}, [0, 1, 2, 3, 4]),
    ],
)
def test_what_is_left_out_comes_back_to_the_bit(changes, expected):
    """A change in the last bit, of one sub-step of one environment, makes a body one that moves."""
    pose, twist = moved(**changes)
    state = WorldState.dense(Header(int(T[-1])), T, pose, twist, np.zeros(E, np.int32))
    state.check()
    assert state.moving.tolist() == expected
    for got, sent in zip((*state.rows(), state.end_pose, state.end_twist()), (pose, twist, pose[:, -1], twist[:, -1])):
        assert got.shape == sent.shape and got.tobytes() == sent.tobytes()
    for chosen in ([3, 0], [4], [], [1, 1]):
        some = state.rows(chosen)
        assert np.array_equal(some[0], pose[:, :, chosen]) and np.array_equal(some[1], twist[:, :, chosen])
    assert (
        sum(a.nbytes for a in contents(state).values())
        == 8 * (S + E * N * 7 + E * S * len(expected) * 13) + 4 * len(expected) + 4 * E
    )


def test_signed_zeros_and_nan_are_told_apart():
    pose, twist = moved()
    twist[0, 1, 0, 0] = -0.0
    pose[:, :, 1] = np.nan
    assert moving_bodies(pose, twist).tolist() == [0]


@pytest.mark.parametrize("moving", [[-1], [N], [2, 1], [1, 1]])
def test_bodies_that_there_are_not_are_refused(moving):
    state = WorldState.dense(Header(0), T, *moved(), np.zeros(E, np.int32))
    state.moving = np.array(moving, np.int32)
    state.moving_pose = np.zeros((E, S, len(moving), 7))
    state.moving_twist = np.zeros((E, S, len(moving), 6))
    with pytest.raises(MessageError, match="ascending list of bodies 0 to 4"):
        state.check()
