"""Holds how an engine takes its steps."""

from __future__ import annotations

from dataclasses import dataclass

from nodes.physics.precision.tolerance import Tolerance


@dataclass(frozen=True)
class Stepping:
    """Holds length and tolerance of an engine's steps, and the speed at which an environment has diverged.

    timestep: sub-step [s], at most 1 ms; None = the model's own, cut into equal parts of at most 1 ms. speed_limit:
    speed [m/s] of a body beyond which an environment has diverged. tolerance: for which steps are taken in parts; None
    = all steps are whole.
    """

    timestep: float | None = None
    speed_limit: float = 1000.0
    tolerance: Tolerance | None = None
