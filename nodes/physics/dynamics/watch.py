"""Tells of many environments at once whether anything in their states needs a closer look."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from nodes.physics.dynamics.states import State
from nodes.physics.stiffness import FOLLOWED
from nodes.physics.watchdog import BAD, LOST, Limits, Watchdog

_BAD, _LOST = ([int(warning) for warning in which] for which in (BAD, LOST))


class Watch:
    """Holds the watchdog of each environment of a model, in `dogs`."""

    def __init__(self, limits: Limits, envs: int) -> None:
        self._limits, self._rows = limits, np.arange(envs)
        self._counts = np.zeros((envs, len(BAD)), np.int64)
        self._spins = np.zeros((envs, limits.model.nbody))
        self.dogs = [Watchdog(limits, *rows) for rows in zip(self._counts, self._spins)]

    def of(self, envs: Sequence[int]) -> Watch:
        """Gives that of some environments, in this order."""
        part = copy.copy(self)
        part._rows, part.dogs = self._rows[list(envs)], [self.dogs[env] for env in envs]
        return part

    def quiet(self, envs: np.ndarray, state: State, nearest: np.ndarray, warnings: np.ndarray) -> np.ndarray:
        """Says of which of m environments a watchdog would have nothing to tell after any of n steps, bool [m].

        state: [m, n, ...] after each of them. nearest, warnings: as of SteppedStates.
        """
        rows, twist = self._rows[envs], state["twist"]
        # A counter that rose stays risen.
        quiet = (warnings[:, _BAD] == self._counts[rows]).all(axis=1) & ~warnings[:, _LOST].any(axis=1)
        for k in np.flatnonzero(quiet & ~self._calm(state, nearest)).tolist():
            own = {name: values[k] for name, values in state.items()}
            quiet[k] = self.dogs[envs[k]].unremarkable(own, float(nearest[k]))
        if twist.shape[1]:
            spins = self._spins[rows, 1:]
            slow = (spins * self._limits.model.opt.timestep <= FOLLOWED) & quiet[:, None]
            self._spins[rows, 1:] = np.where(slow, np.linalg.norm(twist[:, -1, :, 3:], axis=-1), spins)
        return quiet

    def _calm(self, state: State, nearest: np.ndarray) -> np.ndarray:
        """Tells of which environments all states are far from every limit, bool [m]: most, and found quickly."""
        limits, twist = self._limits, state["twist"]
        # A sum is finite only if everything in it is.
        sums = (values.reshape(len(values), -1).sum(axis=1) for values in (state["qpos"], state["qvel"], twist))
        v, omega = (np.sqrt((twist[..., part] ** 2).sum(axis=-1)) for part in (slice(0, 3), slice(3, 6)))
        points = (v + omega * limits.reach.of_body[1:]).max(axis=(1, 2), initial=0.0)
        slow = points <= min(limits.speed_limit, 0.5 * limits.thickness / limits.model.opt.timestep)
        return np.isfinite(sum(sums)) & slow & (nearest > -0.5 * limits.thickness)
