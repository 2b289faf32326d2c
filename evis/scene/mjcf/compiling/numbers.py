"""Checks numbers of a compiled MuJoCo model that MuJoCo takes and that nothing can be simulated with."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.errors import SceneError
from evis.scene.mjcf.frames import name_of

TIMESTEP = (1e-7, 1e9)
"""Shortest and longest step of a model [s]: a shorter one has no whole nanoseconds to speak of, stamps end at a longer
one."""

_OBJ = mujoco.mjtObj
_FINITE = (
    ("body", _OBJ.mjOBJ_BODY, ("pos", "quat")),
    ("camera", _OBJ.mjOBJ_CAMERA, ("pos", "quat")),
    ("light", _OBJ.mjOBJ_LIGHT, ("pos", "dir")),
    ("key", _OBJ.mjOBJ_KEY, ("qpos", "qvel", "ctrl")),
)
"""Elements, what MuJoCo calls them, and their numbers that must be finite."""


def check_numbers(file: str, model: Any) -> None:
    """Raises SceneError that names the file and the element for a number that nothing can be simulated with."""
    shortest, longest = TIMESTEP
    if not shortest <= model.opt.timestep <= longest:
        raise SceneError(
            f"{file}: <option> has timestep {model.opt.timestep:g}; it must be from {shortest:g} to {longest:g} s"
        )
    for element, kind, fields in _FINITE:
        for field in fields:
            values = getattr(model, f"{'cam' if element == 'camera' else element}_{field}")
            wrong = ~np.isfinite(values).all(axis=1)
            if wrong.any():
                name = name_of(model, kind, int(wrong.argmax()), element)
                raise SceneError(f"{file}: {element} '{name}' has a {field} that is not finite; give it numbers")
