"""Adds lights of a MuJoCo model, which have no units there.

The rule here: a light of diffuse d makes a white surface that faces it have the radiance d. So a directional light
gives an irradiance of pi d [W/m^2], and a point or spot light as much at the distance D of the model's centre, falling
with the square, as light does; where it has an `attenuation` a, b, c, the radiance there is d / (a + b D + c D^2), as
in MuJoCo. Where a light has an `intensity`, that times d is its radiant intensity [W/sr], and nothing else counts. A
spot shines within its `cutoff`, and falls to half where cos^exponent does. The `ambient` of headlight and lights add up
to the environment's radiance.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.mjcf.frames import MODE, TARGETS, TRACKS, at_rest, free_name, name_of, stays
from evis.scene.model import WORLD, Body, Light, Scene

_TYPE = mujoco.mjtLightType


def head_ambient(model: Any) -> np.ndarray:
    """Reads the ambient radiance of the model's headlight, float32 [3]; 0 of one that is off."""
    head = model.vis.headlight
    return np.array(head.ambient, np.float32) if head.active else np.zeros(3, np.float32)


def add_lights(scene: Scene, model: Any) -> np.ndarray:
    """Adds the model's lights, or its headlight if it has none; returns their ambient radiance, float32 [3]."""
    head, ambient = model.vis.headlight, head_ambient(model)
    data = at_rest(model)
    for i in np.flatnonzero(model.light_active).tolist():
        ambient = ambient + model.light_ambient[i]
        name = name_of(model, mujoco.mjtObj.mjOBJ_LIGHT, i, "light")
        if model.light_type[i] == _TYPE.mjLIGHT_IMAGE:
            scene.notes.append(f"light '{name}' is left out: it is an image; `environment_map` in a scene is one")
        else:
            scene.lights.append(_light(scene, model, data, i, name))
    if not scene.lights and head.active:
        body = scene.body_index(scene.cameras[0].name)
        colour = np.pi * np.array(head.diffuse, np.float32)
        scene.lights.append(Light("headlight", "directional", colour, np.array([0.0, 0.0, 1.0]), body, shadows=False))
    return np.asarray(ambient, np.float32)


def _light(scene: Scene, model: Any, data: Any, i: int, name: str) -> Light:
    diffuse, shadows = np.array(model.light_diffuse[i], np.float32), bool(model.light_castshadow[i])
    directional = model.light_type[i] == _TYPE.mjLIGHT_DIRECTIONAL
    cutoff = float(model.light_cutoff[i])
    aims = directional or (model.light_type[i] == _TYPE.mjLIGHT_SPOT and cutoff < 90)
    body, position, direction = _place(scene, model, data, i, name, directional, aims)
    if directional:
        return Light(name, "directional", np.pi * diffuse, direction, body, shadows)
    colour = np.float32(_strength(model, data, i)) * diffuse
    if not aims:
        return Light(name, "point", colour, position, body, shadows)
    cone = _cone(float(np.radians(cutoff)), float(model.light_exponent[i]))
    return Light(name, "spot", colour, position, body, shadows, direction, cone)


def _place(
    scene: Scene, model: Any, data: Any, i: int, name: str, directional: bool, aims: bool
) -> tuple[int, np.ndarray, np.ndarray]:
    """The body that a light is on, a new one where it needs one of its own, and its position and direction there.

    directional: it shines from everywhere. aims: its direction matters.
    """
    mode, body, target = int(model.light_mode[i]), int(model.light_bodyid[i]), int(model.light_targetbodyid[i])
    rigid = (body - 1, np.array(model.light_pos[i], np.float64), np.array(model.light_dir[i], np.float64))
    if mode == MODE.mjCAMLIGHT_FIXED or (mode in TARGETS and (target < 0 or not aims)):
        return rigid
    if stays(model, mode, body, target) or (mode in TRACKS and directional):
        return WORLD, np.array(data.light_xpos[i]), np.array(data.light_xdir[i])
    # The frame is turned so that the direction at rest goes to the present one.
    scene.bodies.append(Body(free_name(scene, name, "light"), None, follows=("light", i)))
    return len(scene.bodies) - 1, np.zeros(3), np.array(model.light_dir0[i], np.float64)


def _strength(model: Any, data: Any, i: int) -> float:
    """Radiant intensity [W/sr] for a diffuse of 1."""
    if model.light_intensity[i] > 0:
        return float(model.light_intensity[i])
    distance = float(np.linalg.norm(data.light_xpos[i] - model.stat.center))
    faded = float(model.light_attenuation[i] @ (1.0, distance, distance * distance))
    return float(np.pi * max(distance * distance, 1e-6) / max(faded, 1e-6))


def _cone(cutoff: float, exponent: float) -> tuple[float, float]:
    """Half-angles of a cone whose smooth step in the cosine is half where cos^exponent is, if that is within `cutoff`.

    A step that begins on the axis ends before `cutoff` where the power falls fast.
    """
    half = 0.5 ** (1 / exponent) if exponent > 0 else 0.0
    edge = max(float(np.cos(cutoff)), 2 * half - 1)
    full = max(2 * half - edge, edge)
    return float(np.arccos(min(full, 1.0))), float(np.arccos(edge))
