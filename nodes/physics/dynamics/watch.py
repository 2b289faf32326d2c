"""Tells of many environments at once whether anything in their states needs a closer look."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np

from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.dynamics.states import State
from nodes.physics.mujoco_warnings import BAD, LOST
from nodes.physics.stiffness import FOLLOWED
from nodes.physics.watchdog import Limits, Watchdog

_BAD, _LOST = ([int(warning) for warning in which] for which in (BAD, LOST))


class Watch:
    """Holds the watchdog of each environment of a model, in `dogs`."""

    def __init__(self, limits: Limits, envs: int) -> None:
        self._limits, self._rows = limits, np.arange(envs)
        self._counts = np.zeros((envs, len(BAD)), np.int64)
        self._spins = np.zeros((envs, limits.model.nbody))
        self.dogs = [Watchdog(limits, *rows) for rows in zip(self._counts, self._spins)]

    def of(self, envs: Sequence[int]) -> Watch:
        """Makes the Watch of some environments, in this order."""
        part = copy.copy(self)
        part._rows, part.dogs = self._rows[list(envs)], [self.dogs[env] for env in envs]
        return part

    def quiet(
        self, envs: np.ndarray, found: SteppedStates, speed: np.ndarray, twist: np.ndarray, part: slice = slice(None)
    ) -> np.ndarray:
        """Says of which of m environments a watchdog would have nothing to tell after any of their steps, bool [m].

        found: their states, or those of more, of which they are a part. speed: [m], the greatest of any point of a body
        [m/s], not finite where anything is not. twist: [m, bodies without the world, 6], after the last step.
        """
        rows, nearest, warnings = self._rows[envs], found.nearest[part], found.warnings[part]
        # A counter that rose stays risen.
        quiet = (warnings[:, _BAD] == self._counts[rows]).all(axis=1) & ~warnings[:, _LOST].any(axis=1)
        quiet &= ~found.lost[part]
        limits = self._limits
        # Most are far from every limit.
        calm = np.isfinite(speed) & (nearest > -0.5 * limits.thickness)
        calm &= speed <= min(limits.speed_limit, 0.5 * limits.thickness / limits.model.opt.timestep)
        for k in np.flatnonzero(quiet & ~calm).tolist():
            n = k + (part.start or 0)
            own = {name: values[0] for name, values in found.part(slice(n, n + 1)).items()}
            quiet[k] = self.dogs[envs[k]].unremarkable(own, float(nearest[k]))
        spins = self._spins[rows, 1:]
        slow = (spins * limits.model.opt.timestep <= FOLLOWED) & quiet[:, None]
        self._spins[rows, 1:] = np.where(slow, np.linalg.norm(twist[..., 3:], axis=-1), spins)
        return quiet

    def speed(self, state: State) -> np.ndarray:
        """Computes the greatest speed [m/s] of any point of a body in the states [m, n, ...] of environments, float64
        [m], not finite where anything is not."""
        twist = state["twist"]
        # A sum is finite only if everything in it is.
        sums = sum(values.reshape(len(values), -1).sum(axis=1) for values in (state["qpos"], state["qvel"], twist))
        v, omega = (np.sqrt((twist[..., part] ** 2).sum(axis=-1)) for part in (slice(0, 3), slice(3, 6)))
        points = (v + omega * self._limits.reach.of_body[1:]).max(axis=(1, 2), initial=0.0)
        return np.where(np.isfinite(sums), points, np.nan)
