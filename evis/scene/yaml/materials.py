"""Reads materials of a scene file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.images import textures
from evis.scene.images.made_pictures import MadePictures
from evis.scene.images.pictures import load_picture
from evis.scene.model import Material
from evis.scene.own.drawn_file import drawn_file
from evis.scene.own.picture import read_picture
from evis.scene.sources import note
from evis.scene.yaml.reader import Fields

KINDS = ("blobs", "noise", "leaves", "checker", "bricks", "planks", "image")


def read_material(
    name: str,
    fields: Fields,
    folder: Path,
    pictures: MadePictures,
    textures: bool = True,
    made: dict[Any, Any] | None = None,
) -> Material:
    """Reads one entry of `materials:`; albedo, emission [W/(sr m^2)], roughness, metallic, two_sided, texture.

    folder: where image files are looked for. pictures: where those are begun that are made by code; they are full when
    it has waited. textures=False: no texture is made. made: pictures made or read before, which are not made again.
    """
    section = fields.section("texture", "texture")
    known = {} if made is None else made
    texture = _texture(section, folder, pictures, known) if section and textures else None
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


def _texture(fields: Fields, folder: Path, pictures: MadePictures, made: dict[Any, Any]) -> np.ndarray:
    """float32 [h, w, 3] of a `texture:` map."""
    kind = fields.text("kind", choices=KINDS)
    own = drawn_file(fields, "texture", folder)
    if kind == "image" and own is None:
        image = _image(fields, folder)
        fields.done()
        return image
    size = fields.whole("size", 256, minimum=2, maximum=4096)
    recipe = _recipe(kind, fields, size) if kind != "image" else None
    wedge = fields.section("wedge", "wedge")
    sector = (wedge.angle("angle"), wedge.fraction("value", 0.5)) if wedge else None
    if wedge:
        wedge.done()
    fields.done()
    key: Any = (own, size) if own else (*recipe, sector) if recipe else None
    if key not in made:
        made[key] = _own_picture(fields, own, size) if own else pictures.begin(key)
    picture: np.ndarray = made[key]
    return picture


def _own_picture(fields: Fields, path: Path, size: int) -> np.ndarray:
    """A picture of the user's, at most `size` texels long where above 0."""
    try:
        return read_picture(note(path), size)
    except SceneError as error:
        key = "folder" if size else "file"
        raise fields.error(key, f"names what cannot be used: {error}; mend it or take it away") from None


def _recipe(kind: str, fields: Fields, size: int) -> tuple[Callable[..., np.ndarray], tuple[Any, ...]]:
    """What makes a picture, with its arguments."""
    low, high = fields.fraction("low", 0.0), fields.fraction("high", 1.0)
    if kind == "checker":
        cells = fields.whole("cells", 8, minimum=1)
        if cells > min(size, textures.FINE):
            most = f"a picture of {size} texels shows {min(size, textures.FINE)} squares a side at most"
            raise fields.error("cells", f"is {cells}; {most}, so take fewer and repeat the picture")
        return textures.checker, (size, cells, low, high)
    if kind in ("bricks", "planks"):
        cells, joint = fields.whole("cells", 8, minimum=2, maximum=256), fields.fraction("joint", 0.1)
        if kind == "bricks" and cells % 2:
            raise fields.error("cells", f"is {cells}; the rows of bricks must be even in number")
        make = textures.bricks if kind == "bricks" else textures.planks
        return make, (size, cells, low, high, joint, _seed(fields))
    if kind == "leaves":
        feature = fields.number("feature", 0.2, above=0.0, maximum=0.5)
        return textures.leaves, (size, _seed(fields), feature, low, high, fields.fraction("colour", 1.0))
    # Blurred more than that, nothing of the noise is left but rounding.
    feature = fields.number("feature", 0.02, above=0.0, maximum=1.0)
    return (textures.blobs if kind == "blobs" else textures.noise), (size, _seed(fields), feature, low, high)


def _seed(fields: Fields) -> int:
    return fields.whole("seed", 0, maximum=(1 << 32) - 1)


def _image(fields: Fields, folder: Path) -> np.ndarray:
    """A picture from a file, linear."""
    name = fields.text("file")
    path = folder / name
    if not path.is_file():
        raise fields.error("file", f"names {name}, which is not in {folder or '.'}")
    if path.suffix.lower() == ".exr":
        return _own_picture(fields, path, 0)
    try:
        return load_picture(path)
    except SceneError as error:
        raise fields.error("file", f"names {name}, {error}") from None
