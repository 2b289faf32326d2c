"""Turns an agent's action into the controls of a model's actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from evis.events.representations.columns import check_flag
from nodes.physics.actuators import NO_ACTUATORS

SLACK = 1e-6
"""By how much of its range a float32 may lie outside it, from rounding."""


class Actions:
    """Converts actions [E, nu] to controls. normalise: -1 to 1 stands for the whole range of each actuator."""

    def __init__(self, actuators: Sequence[Any], normalise: bool) -> None:
        """Takes the actuators of a model. actuators: with name, low, high. Raises ValueError for a model that has none,
        or none with a range."""
        check_flag("normalise", normalise)
        if not actuators:
            raise ValueError(f"the scene {NO_ACTUATORS}, so that there is nothing to act on")
        self.names = [actuator.name for actuator in actuators]
        self.low, self.high = (np.array([getattr(a, end) for a in actuators], np.float64) for end in ("low", "high"))
        self.normalise = normalise
        free = ~np.isfinite(self.low) | ~np.isfinite(self.high)
        if normalise and free.any():
            name = self.names[int(np.argmax(free))]
            raise ValueError(f"actuator {name} has no range (ctrlrange) to normalise; give it one, or normalise=False")
        ones = np.ones_like(self.high)
        self._least, self._most = (-ones, ones) if normalise else (self.low, self.high)
        with np.errstate(over="ignore"):  # a bound too large for a float32 is none
            self._space_low, self._space_high = self._least.astype(np.float32), self._most.astype(np.float32)

    def space(self) -> Box:
        """Returns the space of one environment."""
        return Box(self._space_low, self._space_high, dtype=np.float32)

    def controls(self, actions: Any, envs: int, ignored: np.ndarray | None = None) -> np.ndarray:
        """Computes controls float64 [E, nu] of actions [E, nu]. Raises ValueError for what is not in the space.

        ignored: bool [E], environments whose rows may hold anything; their controls are those nearest to zero.
        """
        try:
            if np.iscomplexobj(actions):
                raise TypeError
            values = np.array(actions, np.float64)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"an action is {len(self.low)} real number(s), and not {actions!r:.60}") from None
        if values.shape != (envs, len(self.low)):
            raise ValueError(f"the action has shape {list(values.shape)}; it must be {[envs, len(self.low)]}")
        low, high = self._least, self._most
        if ignored is not None:
            values[ignored] = np.clip(0.0, low, high)
        slack = SLACK * np.where(np.isfinite(high - low), high - low, 0.0)
        # Of a narrow range far from zero a bound of the space, a float32, may lie outside by more than the slack.
        least, most = np.minimum(low - slack, self._space_low), np.maximum(high + slack, self._space_high)
        wrong = ~((values >= least) & (values <= most) & np.isfinite(values))
        if wrong.any():
            env, unit = np.argwhere(wrong)[0]
            raise ValueError(
                f"the action is {values[env, unit]:g} for actuator {self.names[unit]} of environment {env}; "
                f"it must be from {low[unit]:g} to {high[unit]:g}"
            )
        values = np.clip(values, low, high)
        return self.low + (values + 1) / 2 * (self.high - self.low) if self.normalise else values
