"""Steps of physics that are taken before the caller asks for them: only as long as nothing new is done, and unseen."""

import numpy as np
import pytest

import evis
from nodes.physics.dynamics.batch.mujoco_threads import MujocoThreads


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows by one whenever steps are begun ahead."""
    count: list[int] = []
    begin = MujocoThreads.begin
    monkeypatch.setattr(MujocoThreads, "begin", lambda self, keep=False: (count.append(1), begin(self, keep))[1])
    return count


def ends(actions: list[np.ndarray | None], envs: int) -> np.ndarray:
    with evis.Simulation("cart_pole", envs=envs, width=16, height=12, outputs=["state"]) as simulation:
        simulation.reset(seed=5)
        return np.array([simulation.step(action).state.end_pose[0] for action in actions])


def test_they_are_those_that_come_of_the_actions(begun: list[int]) -> None:
    """An environment among three, of which steps are begun ahead, and the same one alone, of which none are."""
    low, high = np.full(1, -1.0), np.full(1, 1.0)
    actions = [None, None, None, low, low, None, high, low, None]
    together = ends([None if a is None else np.tile(a, (3, 1)) for a in actions], 3)
    # Before the first action and until one differs from the one before.
    assert 3 <= len(begun) <= 6
    begun.clear()
    assert ends(actions, 1).tobytes() == together.tobytes() and not begun
