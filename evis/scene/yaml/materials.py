"""Materials of a scene file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.scene import textures
from evis.scene.errors import SceneError
from evis.scene.model import Material
from evis.scene.pictures import load_picture
from evis.scene.yaml.reader import Fields

KINDS = ("blobs", "noise", "checker", "bricks", "planks", "image")


def read_material(name: str, fields: Fields, folder: Path, textures: bool = True) -> Material:
    """Reads one entry of `materials:`; albedo, emission [W/(sr m^2)], roughness, metallic, two_sided, texture.

    folder: where image files are looked for. textures=False: no texture is made.
    """
    section = fields.section("texture", "texture")
    texture = _texture(section, folder) if section and textures else None
    material = Material(
        name,
        fields.colour("albedo", 1.0 if section else 0.5, maximum=1.0),
        texture,
        fields.colour("emission", 0.0),
        fields.fraction("roughness", 1.0),
        fields.fraction("metallic", 0.0),
        fields.flag("two_sided", False),
    )
    fields.done()
    return material


def _texture(fields: Fields, folder: Path) -> np.ndarray:
    """float32 [h, w, 3] of a `texture:` map."""
    kind = fields.text("kind", choices=KINDS)
    if kind == "image":
        image = _image(fields, folder)
        fields.done()
        return image
    size = fields.whole("size", 256, minimum=2, maximum=4096)
    low, high = fields.fraction("low", 0.0), fields.fraction("high", 1.0)
    if kind == "checker":
        image = textures.checker(size, fields.whole("cells", 8, minimum=1), low, high)
    elif kind in ("bricks", "planks"):
        cells, joint = fields.whole("cells", 8, minimum=2, maximum=256), fields.fraction("joint", 0.1)
        if kind == "bricks" and cells % 2:
            raise fields.error("cells", f"is {cells}; the rows of bricks must be even in number")
        make = textures.bricks if kind == "bricks" else textures.planks
        image = make(size, cells, low, high, joint, _seed(fields))
    else:
        feature = fields.number("feature", 0.02, above=0.0)
        image = (textures.blobs if kind == "blobs" else textures.noise)(size, _seed(fields), feature, low, high)
    wedge = fields.section("wedge", "wedge")
    if wedge:
        image = textures.add_wedge(image, wedge.angle("angle"), wedge.fraction("value", 0.5))
        wedge.done()
    fields.done()
    return np.ascontiguousarray(np.repeat(np.clip(image, 0.0, 1.0)[..., None], 3, axis=-1))


def _seed(fields: Fields) -> int:
    return fields.whole("seed", 0, maximum=(1 << 32) - 1)


def _image(fields: Fields, folder: Path) -> np.ndarray:
    """A picture from a file, linear."""
    name = fields.text("file")
    path = folder / name
    if not path.is_file():
        raise fields.error("file", f"names {name}, which is not in {folder or '.'}")
    try:
        return load_picture(path)
    except SceneError as error:
        raise fields.error("file", f"names {name}, {error}") from None
