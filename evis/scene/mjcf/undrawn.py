"""Tells what of a MuJoCo model is not drawn, or drawn otherwise than MuJoCo draws it, with its names and what helps."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.mjcf.frames import name_of
from evis.scene.mjcf.geoms import GROUPS
from evis.scene.mjcf.materials import rgba_of

NAMED = 3
"""Things that a line names, of those that it is about."""
_OBJ = mujoco.mjtObj


def undrawn(model: Any) -> list[str]:
    """Tells which flexes, spatial tendons and skins of a model are not drawn, a line for each kind."""
    lines = []
    if flexes := _named(model, _OBJ.mjOBJ_FLEX, "flex", np.arange(model.nflex)):
        lines.append(f"flexes are simulated but not drawn: {flexes}; bodies with geoms in their place are")
    spatial = model.wrap_type[model.tendon_adr] != mujoco.mjtWrap.mjWRAP_JOINT
    seen = np.isin(model.tendon_group, GROUPS) & (_alpha(model, model.tendon_rgba, model.tendon_matid) > 0)
    if tendons := _named(model, _OBJ.mjOBJ_TENDON, "tendon", np.flatnonzero(spatial & seen)):
        lines.append(f"spatial tendons are simulated but not drawn: {tendons}; bodies with geoms along them are")
    if skins := _named(model, _OBJ.mjOBJ_SKIN, "skin", np.arange(model.nskin)):
        lines.append(f"skins are not drawn: {skins}; in their place are the shapes of the bodies under them")
    return lines


def looks_otherwise(model: Any, shown: np.ndarray) -> list[str]:
    """Tells which geoms are opaque here and not in MuJoCo, and where none is drawn, why.

    shown: those of a group that is drawn, bool [ngeom].
    """
    alpha = _alpha(model, model.geom_rgba, model.geom_matid)
    if model.ngeom and not (shown & (alpha > 0)).any():
        if shown.any():
            return [
                "none of the model's geoms is drawn, for those of groups 0 to 2 have alpha 0; give what is to be seen "
                "an alpha of 1"
            ]
        return ['none of the model\'s geoms is drawn, for all are in groups 3 to 5; give what is to be seen group="0"']
    clear = np.flatnonzero(shown & (alpha > 0) & (alpha < 1))
    if not len(clear):
        return []
    geoms = _few([_geom(model, geom) for geom in clear[:NAMED].tolist()], len(clear))
    return [f"what is transparent is drawn opaque: {geoms}; with alpha 0 it is left out"]


def _alpha(model: Any, rgba: np.ndarray, materials: np.ndarray) -> np.ndarray:
    """Alpha of elements with these colours [n, 4] and materials [n], float32 [n]."""
    return np.array([rgba_of(model, own, number)[3] for own, number in zip(rgba, materials.tolist())], np.float32)


def _geom(model: Any, geom: int) -> str:
    """Names a geom, that has no name by its body."""
    if name := mujoco.mj_id2name(model, _OBJ.mjOBJ_GEOM, geom):
        return f"'{name}'"
    return f"geom {geom} of body '{name_of(model, _OBJ.mjOBJ_BODY, int(model.geom_bodyid[geom]), 'body')}'"


def _named(model: Any, kind: Any, default: str, numbers: np.ndarray) -> str:
    """Names elements of a kind, the first few of many; "" for none."""
    return _few([f"'{name_of(model, kind, i, default)}'" for i in numbers[:NAMED].tolist()], len(numbers))


def _few(names: list[str], count: int) -> str:
    """Joins the names of the first few of `count` things."""
    return ", ".join(names) + (f" and {count - NAMED} more" if count > NAMED else "")
