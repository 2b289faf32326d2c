"""Materials of a scene file."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene import textures
from evis.scene.errors import SceneError
from evis.scene.model import Material
from evis.scene.pictures import load_picture
from evis.scene.yaml.reader import Fields

SMALL = 512
"""Texels along the side of pictures that are kept for other scenes, 3 MB at most."""
KINDS = ("blobs", "noise", "checker", "bricks", "planks", "image")


def read_material(
    name: str, fields: Fields, folder: Path, textures: bool = True, made: dict[Any, Any] | None = None
) -> Material:
    """Reads one entry of `materials:`; albedo, emission [W/(sr m^2)], roughness, metallic, two_sided, texture.

    folder: where image files are looked for. textures=False: no texture is made. made: pictures made by code before,
    which are not made again.
    """
    section = fields.section("texture", "texture")
    texture = _texture(section, folder, {} if made is None else made) if section and textures else None
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


def _texture(fields: Fields, folder: Path, made: dict[Any, Any]) -> np.ndarray:
    """float32 [h, w, 3] of a `texture:` map."""
    kind = fields.text("kind", choices=KINDS)
    if kind == "image":
        image = _image(fields, folder)
        fields.done()
        return image
    make, arguments = _recipe(kind, fields)
    wedge = fields.section("wedge", "wedge")
    sector = (wedge.angle("angle"), wedge.fraction("value", 0.5)) if wedge else None
    if wedge:
        wedge.done()
    fields.done()
    key = make, arguments, sector
    if key not in made:
        made[key] = _small_picture(*key) if arguments[0] <= SMALL else _picture(*key)
    picture: np.ndarray = made[key]
    return picture


def _picture(
    make: Callable[..., np.ndarray], arguments: tuple[Any, ...], sector: tuple[float, float] | None
) -> np.ndarray:
    """Makes a picture, float32 [h, w, 3]. sector: angle [rad] and value of its wedge."""
    image = make(*arguments)
    image = image if sector is None else textures.add_wedge(image, *sector)
    picture = np.ascontiguousarray(np.repeat(np.clip(image, 0.0, 1.0)[..., None], 3, axis=-1))
    picture.flags.writeable = False
    return picture


_small_picture = lru_cache(maxsize=16)(_picture)
"""Shared by scenes that differ in other things, as the sequences of a data set do."""


def _recipe(kind: str, fields: Fields) -> tuple[Callable[..., np.ndarray], tuple[Any, ...]]:
    """What makes a picture, with its arguments."""
    size = fields.whole("size", 256, minimum=2, maximum=4096)
    low, high = fields.fraction("low", 0.0), fields.fraction("high", 1.0)
    if kind == "checker":
        return textures.checker, (size, fields.whole("cells", 8, minimum=1), low, high)
    if kind in ("bricks", "planks"):
        cells, joint = fields.whole("cells", 8, minimum=2, maximum=256), fields.fraction("joint", 0.1)
        if kind == "bricks" and cells % 2:
            raise fields.error("cells", f"is {cells}; the rows of bricks must be even in number")
        make = textures.bricks if kind == "bricks" else textures.planks
        return make, (size, cells, low, high, joint, _seed(fields))
    feature = fields.number("feature", 0.02, above=0.0)
    return (textures.blobs if kind == "blobs" else textures.noise), (size, _seed(fields), feature, low, high)


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
