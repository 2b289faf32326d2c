"""Reads lights of a scene file."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.scene.errors import SceneError
from evis.scene.model import WORLD, Light, Waveform
from evis.scene.yaml.reader import Fields

KINDS = ("directional", "point", "spot", "area")


def read_light(name: str, fields: Fields, body: int = WORLD) -> Light:
    """Reads one entry of `lights:` but for `body`, which the caller has looked up."""
    kind = fields.text("kind", choices=KINDS)
    shadows = fields.flag("shadows", True)
    if kind == "directional":
        light = Light(name, kind, fields.colour("irradiance"), fields.direction("direction"), body, shadows)
    elif kind == "area":
        light = Light(name, kind, fields.colour("radiance"), fields.vector("position"), body, shadows)
        size = fields.vector("size", 2, above=0.0)
        right, down, light.direction = _axes(fields, light.vector)
        # half_u x half_v is the side that shines: right x down = forward.
        light.half_u, light.half_v = 0.5 * size[0] * right, 0.5 * size[1] * down
    else:
        light = Light(name, kind, fields.colour("intensity"), fields.vector("position"), body, shadows)
        if kind == "spot":
            light.direction = _axes(fields, light.vector)[2]
            light.cone = _cone(fields)
    light.waveform = _flicker(fields)
    fields.done()
    return light


def _axes(fields: Fields, position: np.ndarray) -> np.ndarray:
    """Unit vectors right, down, forward of a light that looks along `direction` or at `look_at`; rows of [3, 3]."""
    if fields.has("direction") == fields.has("look_at"):
        if fields.has("direction"):
            raise fields.error("look_at", "and direction are given; leave one out")
        raise fields.error(None, "needs 'direction' or 'look_at'")
    target = position + fields.direction("direction") if fields.has("direction") else fields.vector("look_at")
    up = fields.vector("up", 3, [0, 0, 1])
    forward = target - position
    if not fields.has("up") and np.linalg.norm(np.cross(forward, up)) < 1e-9 * np.linalg.norm(forward):
        up = np.array([0.0, 1.0, 0.0])  # straight up or down, as a lamp under a ceiling
    try:
        return se3.to_matrix(se3.look_at(position, target, up)[3:]).T
    except ValueError as error:
        if isinstance(error, SceneError):
            raise
        text = str(error).replace("the camera", "the light")
        raise fields.error("look_at" if fields.has("look_at") else "direction", f"cannot be followed: {text}") from None


def _cone(fields: Fields) -> tuple[float, float]:
    """Half-angles [rad]: full light inside the first, none outside the second."""
    outer = fields.angle("cone")
    if not 0.0 < outer <= np.pi / 2:
        raise fields.error("cone", f"is {outer:g} rad; the half-angle must lie between 0 and 90 deg")
    inner = fields.angle("full", 0.8 * outer)
    if not 0.0 <= inner <= outer:
        raise fields.error("full", f"is {inner:g} rad; it must lie between 0 and the cone, {outer:g} rad")
    return inner, outer


def _flicker(fields: Fields) -> Waveform | None:
    section = fields.section("flicker", "flicker")
    if section is None:
        return None
    kind = section.text("kind", choices=("sine", "square"))
    duty = section.fraction("duty", 0.5)
    if kind == "sine" and section.has("duty"):
        raise section.error("duty", "is for kind square")
    if not 0.0 < duty < 1.0:
        raise section.error("duty", f"is {duty:g}; it must lie between 0 and 1")
    waveform = Waveform(
        kind, section.number("frequency", above=0.0), section.fraction("depth", 1.0), section.number("phase", 0.0), duty
    )
    section.done()
    return waveform
