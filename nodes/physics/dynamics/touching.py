"""Finds the bodies that touch in contacts of MuJoCo's, of geoms and of parts of a flex."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np


def touching_bodies(model: Any, data: Any) -> np.ndarray:
    """Finds the two bodies of every contact of `data`, MuJoCo's numbers int64 [ncon, 2].

    Of a flex it is the body that carries the point of it, a vertex or a node of its grid, that is nearest to the
    contact among those that the touching element hangs on.
    """
    geoms = np.asarray(data.contact.geom, np.int64).reshape(-1, 2)
    bodies = np.where(geoms >= 0, np.append(model.geom_bodyid, 0)[geoms], 0).astype(np.int64)
    for contact, side in np.argwhere(geoms < 0).tolist():
        bodies[contact, side] = _of_flex(model, data, data.contact[contact], side)
    return bodies


def flex_name(model: Any, flex: int) -> str:
    """Names a flex in a message."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, flex)
    return f"flex '{name}'" if name else f"flex {flex}"


def _of_flex(model: Any, data: Any, contact: Any, side: int) -> int:
    flex, element, vertex = (int(values[side]) for values in (contact.flex, contact.elem, contact.vert))
    if model.flex_interp[flex]:  # its vertices have no bodies, they lie between those of the nodes
        first = int(model.flex_nodeadr[flex])
        carriers = np.asarray(model.flex_nodebodyid[first : first + int(model.flex_nodenum[flex])])
        places = data.xpos[carriers]
    else:
        corners = int(model.flex_dim[flex]) + 1
        start = int(model.flex_elemdataadr[flex]) + corners * element
        of_flex = [vertex] if vertex >= 0 else model.flex_elem[start : start + corners]
        vertices = int(model.flex_vertadr[flex]) + np.asarray(of_flex)
        carriers, places = np.asarray(model.flex_vertbodyid[vertices]), data.flexvert_xpos[vertices]
    return int(carriers[np.linalg.norm(places - contact.pos, axis=-1).argmin()])
