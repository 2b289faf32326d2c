"""Materials of a scene file."""

from __future__ import annotations

import numpy as np

from evis.scene import textures
from evis.scene.model import Material
from evis.scene.reader import Fields


def read_material(name: str, fields: Fields, textures: bool = True) -> Material:
    """One entry of `materials:`; albedo, emission [W/(sr m^2)], roughness, metallic, two_sided, texture.

    textures=False: no texture is made.
    """
    section = fields.section("texture", "texture")
    texture = _texture(section) if section and textures else None
    material = Material(
        name,
        fields.colour("albedo", 1.0 if section else 0.5, maximum=1.0),
        texture,
        fields.colour("emission", 0.0),
        _fraction(fields, "roughness", 1.0),
        _fraction(fields, "metallic", 0.0),
        fields.flag("two_sided", False),
    )
    fields.done()
    return material


def _texture(fields: Fields) -> np.ndarray:
    """float32 [size, size, 3] of a `texture:` map."""
    kind = fields.text("kind", choices=("blobs", "noise", "checker"))
    size = fields.whole("size", 256, minimum=2, maximum=4096)
    low, high = _fraction(fields, "low", 0.0), _fraction(fields, "high", 1.0)
    if kind == "checker":
        image = textures.checker(size, fields.whole("cells", 8, minimum=1), low, high)
    else:
        seed = fields.whole("seed", 0, maximum=(1 << 32) - 1)
        feature = fields.number("feature", 0.02, above=0.0)
        image = (textures.blobs if kind == "blobs" else textures.noise)(size, seed, feature, low, high)
    wedge = fields.section("wedge", "wedge")
    if wedge:
        image = textures.add_wedge(image, wedge.angle("angle"), _fraction(wedge, "value", 0.5))
        wedge.done()
    fields.done()
    return np.ascontiguousarray(np.repeat(np.clip(image, 0.0, 1.0)[..., None], 3, axis=-1))


def _fraction(fields: Fields, key: str, default: float) -> float:
    value = fields.number(key, default, minimum=0.0)
    if value > 1.0:
        raise fields.error(key, f"is {value:g}; the most is 1")
    return value
