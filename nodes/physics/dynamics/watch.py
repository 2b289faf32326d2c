"""Tells of many environments at once whether anything in their states needs a closer look."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from nodes.physics.dynamics.batch.stepped_states import SteppedStates
from nodes.physics.dynamics.states import State
from nodes.physics.mujoco_warnings import BAD, LOST
from nodes.physics.stiffness import FOLLOWED
from nodes.physics.watchdog import Limits, Watchdog

_LOOKED_AT = np.array([int(warning) for warning in (*BAD, *LOST)])


class Watch:
    """Holds the watchdog of each environment of a model, in `dogs`."""

    def __init__(self, limits: Limits, envs: int) -> None:
        self._limits = limits
        self._deep = -0.5 * limits.thickness
        self._fast = min(limits.speed_limit, 0.5 * limits.thickness / limits.model.opt.timestep)
        self._counts = np.zeros((envs, len(_LOOKED_AT)), np.int64)
        """How often MuJoCo had warned of BAD; of LOST it must not have."""
        self._spins = np.zeros((envs, limits.model.nbody))
        self.dogs = [Watchdog(limits, *rows) for rows in zip(self._counts[:, : len(BAD)], self._spins)]

    def of(self, envs: Sequence[int]) -> Watch:
        """Makes the Watch of some environments, in this order, which this one has nothing to do with any more."""
        part = copy.copy(self)
        part._counts, part._spins = self._counts[list(envs)], self._spins[list(envs)]
        part.dogs = [self.dogs[env] for env in envs]
        for dog, *rows in zip(part.dogs, part._counts[:, : len(BAD)], part._spins):
            dog.keep_in(*rows)
        return part

    def state(self) -> tuple[Any, ...]:
        """Gives what the watchdogs have seen and told, as copies."""
        return self._counts.copy(), self._spins.copy(), [dog.state() for dog in self.dogs]

    def restore(self, state: tuple[Any, ...]) -> None:
        """Goes on from what `state` gave."""
        # In place: the watchdogs write there.
        self._counts[:], self._spins[:], dogs = state
        for dog, own in zip(self.dogs, dogs, strict=True):
            dog.restore(own)

    def quiet(
        self, envs: np.ndarray, found: SteppedStates, speed: np.ndarray, twist: np.ndarray, part: slice = slice(None)
    ) -> np.ndarray:
        """Says of which of m environments a watchdog would have nothing to tell after any of their steps, bool [m].

        envs: ascending. found: their states, or those of more, of which they are a part. speed: [m], the greatest of
        any point of a body [m/s], not finite where anything is not. twist: [m, bodies without the world, 6], after the
        last step.
        """
        rows = slice(None) if len(envs) == len(self.dogs) else envs
        nearest = found.nearest[part]
        # A counter that rose stays risen.
        quiet = (found.warnings[part].take(_LOOKED_AT, axis=1) == self._counts[rows]).all(axis=1)
        quiet &= ~found.lost[part]
        # Most are far from every limit; what is not finite is within none.
        calm = (nearest > self._deep) & (np.abs(speed) <= self._fast)
        for k in np.flatnonzero(quiet & ~calm).tolist():
            n = k + (part.start or 0)
            own = {name: values[0] for name, values in found.part(slice(n, n + 1)).items()}
            quiet[k] = self.dogs[envs[k]].unremarkable(own, float(nearest[k]))
        spins = self._spins[rows, 1:]
        slow = (spins * self._limits.model.opt.timestep <= FOLLOWED) & quiet[:, None]
        omega = twist[..., 3:]
        spin = np.sqrt((omega * omega).sum(axis=-1))
        if slow.all():
            self._spins[rows, 1:] = spin
        else:
            self._spins[rows, 1:] = np.where(slow, spin, spins)
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
