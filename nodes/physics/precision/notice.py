"""Words the warning of an error of physics that can be seen."""

from __future__ import annotations

import math

from nodes.physics.precision.errors import Estimate
from nodes.physics.precision.tolerance import Tolerance

POSITION_M, ROTATION_RAD = 1e-3, math.radians(0.1)
"""Errors from which on a run warns, if no tolerance says otherwise."""


def notice(worst: Estimate, body: str, tolerance: Tolerance | None, seconds: float, missed: int) -> str:
    """Writes the warning about the body that is furthest off, "" where there is no need of one.

    tolerance: what was asked for. seconds: that the run took. missed: steps that were not as exact.
    """
    position, rotation = POSITION_M, ROTATION_RAD
    if tolerance is not None:
        position, rotation = (max(seconds, 1.0) * most for most in (tolerance.position, tolerance.rotation))
    if worst.position <= position and worst.rotation <= rotation:
        return ""
    off = f"{worst.position:.2g} m and {math.degrees(worst.rotation):.2g} degrees"
    what = f"body '{body}' was up to {off} from where the model's own equations have it"
    if tolerance is None:
        return (
            f"the steps of physics are too long to be exact: {what}; "
            "physics_tolerance:=METRES,RADIANS takes shorter ones where they are needed"
        )
    why = f"{missed} steps would have needed still shorter parts" if missed else "the motion makes small errors larger"
    return f"physics_tolerance is not kept: {what}; {why}"
