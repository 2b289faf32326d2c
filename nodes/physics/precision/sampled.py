"""Estimates the error of large models, whose steps are most of a run: a few of its keyframes are followed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nodes.physics.precision.errors import Errors
from nodes.physics.precision.shadow import Shadow

MANY = 100
"""Degrees of freedom beyond which a model is large."""
EVERY = 20
"""Of so many keyframes one is followed."""


def shadow_of(model: Any, errors: Errors) -> Shadow | SampledShadow:
    """Makes the error estimator of an environment, which follows every keyframe, or a few where the model is large."""
    return SampledShadow(model, errors) if model.nv > MANY else Shadow(model, errors)


class SampledShadow:
    """Estimates the error of an environment from one keyframe interval in EVERY, and counts what it finds EVERY times.

    The errors of the intervals are added up as if all pointed the same way; what the dynamics make of them is left out.
    """

    def __init__(self, model: Any, errors: Errors) -> None:
        self._errors, self._own = errors, Errors()
        self._shadow = Shadow(model, self._own)
        errors.erased = self._own.erased

    def begin(self, data: Any) -> None:
        """Starts the second simulation from the present state of the environment."""
        self._position = self._rotation = np.zeros(1)
        self._start(data)

    def state(self) -> dict[str, Any]:
        """Gives where the estimate is, as copies."""
        own = {"position": self._position, "rotation": self._rotation, "count": self._count}
        return own | {"errors": self._own.snapshot(), "shadow": self._shadow.state()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from what `state` gave."""
        self._position, self._rotation, self._count = (state[name] for name in ("position", "rotation", "count"))
        self._own.restore(state["errors"])
        self._shadow.restore(state["shadow"])

    def follow(
        self,
        data: Any,
        steps: int,
        before: np.ndarray,
        now: np.ndarray,
        constrained: bool,
        parts: Sequence[int] | None = None,
    ) -> None:
        """Follows some steps, or lets them pass; arguments as of Shadow.follow."""
        if not steps:
            return
        if self._count == 0:
            self._shadow.follow(data, steps, before, now, constrained, parts)
            position, rotation, _reach = self._own.snapshot()
            if len(position):
                self._position = self._position + EVERY * position
                self._rotation = np.minimum(self._rotation + EVERY * rotation, np.pi)
                self._errors.take(self._position, self._rotation, self._shadow.reach)
        self._count += 1
        if self._count == EVERY:
            self._start(data)

    def _start(self, data: Any) -> None:
        self._count = 0
        self._own.clear()
        self._shadow.begin(data)
