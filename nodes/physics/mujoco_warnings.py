"""Names the warnings of MuJoCo by what they mean for a run."""

from __future__ import annotations

import mujoco

BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
"""The simulation has diverged: there is a number in its state that is not finite, or huge."""
LOST = {
    mujoco.mjtWarning.mjWARN_CONTACTFULL: "the contact buffer is full and contacts are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_CNSTRFULL: "the constraint buffer is full and constraints are lost; raise <size memory>",
    mujoco.mjtWarning.mjWARN_INERTIA: "the inertia matrix is nearly singular; give light bodies inertia or armature",
    mujoco.mjtWarning.mjWARN_BADCTRL: f"a control is not finite, or beyond {mujoco.mjMAXVAL:g}, and all controls were "
    "taken as zero; give smaller ones, and the actuator more gear",
}
"""Something of the scene is left out of account, and what helps."""
