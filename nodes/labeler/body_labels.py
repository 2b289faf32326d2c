"""Takes labels of bodies out of the state at a stamp: poses, velocities, accelerations, joints, contacts."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from msgs.camera import Labels
from msgs.world import WorldState


def add_body_labels(out: Labels, state: WorldState, kinds: Collection[str], owner: str) -> None:
    """Copies to `out` what labels of these kinds are at the end of a state.

    Raises ValueError, which names the labeler (owner), for what the state has not, with the parameter of physics that
    puts it there.
    """
    if "poses" in kinds:
        out.pose, out.names = np.array(state.end_pose), list(state.names)
    if "velocities" in kinds:
        out.velocity, out.names = state.end_twist(), list(state.names)
    if "accelerations" in kinds:
        if state.acceleration is None:
            raise ValueError(f"{owner}: /state has no accelerations; start physics with accelerations:=true")
        out.acceleration, out.names = np.array(state.acceleration), list(state.names)
    if "joints" in kinds:
        if state.qpos is None or state.qvel is None:
            raise ValueError(f"{owner}: /state has no joints; start physics with joints:=true")
        out.qpos, out.qvel = np.array(state.qpos[:, -1]), np.array(state.qvel[:, -1])
    if "contacts" in kinds:
        if state.contact_env is None:
            raise ValueError(f"{owner}: /state has no contacts; start physics with contacts:=true")
        for part in ("env", "body", "position", "force"):
            setattr(out, f"contact_{part}", np.array(getattr(state, f"contact_{part}")))
