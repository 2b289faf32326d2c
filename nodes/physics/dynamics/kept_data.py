"""Holds copies of environments of a model, from which they go on as if nothing had happened since."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import mujoco

from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.dynamics.saved_state import SavedState
from nodes.physics.dynamics.sleep import is_slow


@dataclass(frozen=True)
class TakenSteps:
    """Holds steps of an environment that were taken before anybody knew that they will be wanted.

    before: where it was before them. found: its states after each.
    """

    before: SavedState
    found: SteppedStates


@dataclass(frozen=True)
class KeptData:
    """Holds where an environment is.

    saved: its state, where nothing of it sleeps or is slow. data: MjData otherwise, which holds that too. taken: the
    steps that lead to `data`, where these are the ones that come next.
    """

    saved: SavedState | None = None
    data: Any = None
    taken: TakenSteps | None = None

    @classmethod
    def of(cls, model: Any, data: Any) -> KeptData:
        """Copies where an MjData is. What MuJoCo computes of its state it computes again, and need not be kept."""
        if is_slow(model, data):
            return cls(data=copy.copy(data))
        return cls(SavedState(model, data))

    def write(self, model: Any, data: Any) -> None:
        """Writes it into an MjData."""
        if self.saved is not None:
            mujoco.mj_resetData(model, data)
            self.saved.restore(model, data)
        else:
            mujoco.mj_copyData(data, model, self.data)
