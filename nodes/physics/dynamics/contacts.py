"""Finds the contacts of a MuJoCo state, with their forces."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.sleep import wake
from nodes.physics.dynamics.touching import touching_bodies
from nodes.physics.interval import Contacts


def contacts_of(model: Any, data: Any, scratch: Any) -> Contacts:
    """Finds the contacts of `data` at its present state, env = 0 throughout.

    The forces are worked out on `scratch`, another MjData of the model: asking for contacts must not change the course
    of the simulation (the solver starts from its last solution). Those of bodies that sleep are among them.
    """
    mujoco.mj_copyData(scratch, model, data)
    wake(model, scratch)
    mujoco.mj_forward(model, scratch)
    active = [i for i in range(scratch.ncon) if scratch.contact[i].efc_address >= 0]
    force = np.zeros((len(active), 3))
    result = np.zeros(6)
    for row, i in enumerate(active):
        mujoco.mj_contactForce(model, scratch, i, result)
        # rows of frame: normal from the first to the second geom, then two tangents
        force[row] = scratch.contact[i].frame.reshape(3, 3).T @ result[:3]
    contact = scratch.contact
    return Contacts(
        env=np.zeros(len(active), np.int32),
        body=(touching_bodies(model, scratch)[active] - 1).astype(np.int32).reshape(-1, 2),
        position=np.array(contact.pos, np.float64).reshape(-1, 3)[active],
        normal=np.array(contact.frame, np.float64).reshape(-1, 9)[active][:, :3].copy(),
        force=force,
        distance=np.array(contact.dist, np.float64).reshape(-1)[active],
    )
