"""What a user is told of an error of physics that can be seen."""

from __future__ import annotations

import math

from nodes.physics.precision.errors import Estimate

POSITION_M, ROTATION_RAD = 1e-3, math.radians(0.1)
"""Errors from which on a run warns, if no tolerance says otherwise."""


def notice(worst: Estimate, body: str) -> str:
    """Writes the warning about the body that is furthest off, "" where there is no need of one."""
    if worst.position <= POSITION_M and worst.rotation <= ROTATION_RAD:
        return ""
    off = f"{worst.position:.2g} m and {math.degrees(worst.rotation):.2g} degrees"
    return (
        f"the steps of physics are too long to be exact: body '{body}' was up to {off} from where the model's own "
        'equations have it; a shorter timestep of the model brings it nearer, as does integrator="RK4" in free motion'
    )
