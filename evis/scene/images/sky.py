"""Makes environment maps: radiance from far away in every direction, read from an EXR or made by code.

A map is float32 [h, w, 3] W/(sr m^2), linear Rec. 709, equirectangular: row 0 is up (+z), column 0 is +x, columns turn
towards +y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.images.pictures import load_exr
from evis.scene.yaml.drawing import is_draw
from evis.scene.yaml.reader import Fields

MAX_ROWS = 2048
"""Most rows of a map that is made by code; 4096 would take 4 GB on the way."""


def read_environment_map(fields: Fields, folder: Path) -> np.ndarray:
    """Reads or makes the map that a scene names: `environment_map: FILE.exr`, a path relative to the scene file, or
    `{kind: sky|studio|tunnel, ...}`.
    """
    value = fields.table["environment_map"]
    if not isinstance(value, dict) or is_draw(value):
        name = fields.text("environment_map")
        path = folder / name
        if not path.is_file():
            raise fields.error("environment_map", f"names {name}, which is not in {folder or '.'}")
        try:
            return load_exr(path)
        except SceneError as error:
            raise fields.error("environment_map", str(error)) from None
    section = fields.section("environment_map", "environment_map")
    assert section is not None
    kind = section.text("kind", choices=("sky", "studio", "tunnel"))
    rows = section.whole("rows", 256, minimum=16, maximum=MAX_ROWS)
    make = {"sky": _sky, "studio": _studio, "tunnel": _tunnel}[kind]
    image = make(section, directions(rows))
    section.done()
    return image.astype(np.float32)


def directions(rows: int) -> np.ndarray:
    """Computes the unit vectors float64 [rows, 2 rows, 3] towards the texel centres."""
    theta = np.pi * (np.arange(rows) + 0.5) / rows
    phi = np.pi * (np.arange(2 * rows) + 0.5) / rows
    sine, cosine = np.sin(theta)[:, None], np.cos(theta)[:, None]
    return np.stack((sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(cosine, (rows, 2 * rows))), axis=-1)


def solid_angles(rows: int) -> np.ndarray:
    """Computes the exact solid angle [sr] of a texel of each row, [rows]; times 2 rows their sum is 4 pi."""
    return _heights(rows) * np.pi / rows


def mean_radiance(image: np.ndarray) -> np.ndarray:
    """Computes the average of a map over all directions, float32 [3]."""
    rows, columns = image.shape[:2]
    weight = _heights(rows) / (2 * columns)
    return np.einsum("r,rcb->b", weight, image.astype(np.float64)).astype(np.float32)


def _heights(rows: int) -> np.ndarray:
    """Computes how high the part of the unit sphere is that each row sees; its area is 2 pi times that."""
    edge = np.cos(np.pi * np.arange(rows + 1) / rows)
    return edge[:-1] - edge[1:]


def _sky(fields: Fields, direction: np.ndarray) -> np.ndarray:
    """From `horizon` to `zenith` with the square root of the sine of the elevation, `ground` below, and a sun."""
    zenith, horizon = fields.colour("zenith", [0.3, 0.55, 1.2]), fields.colour("horizon", [1.2, 1.3, 1.4])
    ground = fields.colour("ground", 0.3)
    height = direction[..., 2:]
    image = horizon + np.sqrt(np.maximum(height, 0.0)) * (zenith - horizon)
    image = np.where(height > 0, image, ground)
    sun = fields.section("sun", "sun")
    if sun:
        radius = 0.5 * sun.angle("size", np.radians(0.533))
        if not 0.0 < radius < 1.5:
            raise sun.error("size", "must lie between 0 and 170 deg")
        disc = _disc(direction, sun.direction("towards"), radius)
        # The irradiance on a surface facing the sun is as given, however many texels its disc covers.
        total = float(np.sum(disc * solid_angles(len(disc))[:, None, None]))
        image = image + disc / total * sun.colour("irradiance")
        sun.done()
    return image


def _studio(fields: Fields, direction: np.ndarray) -> np.ndarray:
    """A room of radiance `wall` with rectangular panels, each seen `size` [rad] wide and high."""
    image = np.broadcast_to(fields.colour("wall", 0.05), direction.shape).astype(np.float64)
    for panel in fields.items("panels", "panel"):
        towards = panel.direction("towards")
        side = np.cross(towards, [0.0, 0.0, 1.0])
        side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-6 else np.array([1.0, 0.0, 0.0])
        given = panel.plain("size")
        size = [panel.angle_of("size", v) for v in (given if isinstance(given, list) else [given])]
        if len(size) != 2 or not all(0.0 < s < 3.0 for s in size):
            raise panel.error("size", "must be two angles between 0 and 170 deg, width and height")
        ahead = direction @ towards
        safe = np.maximum(ahead, 1e-9)
        across, along = np.abs(direction @ side) / safe, np.abs(direction @ np.cross(side, towards)) / safe
        inside = (ahead > 0) & (across < np.tan(0.5 * size[0])) & (along < np.tan(0.5 * size[1]))
        image = np.where(inside[..., None], panel.colour("radiance"), image)
        panel.done()
    return image


def _tunnel(fields: Fields, direction: np.ndarray) -> np.ndarray:
    """Radiance `wall` all around but for a mouth, a disc of `size` [rad] and radiance `outside`."""
    size = fields.angle("size", np.radians(20))
    if not 0.0 < size < 3.0:
        raise fields.error("size", "must lie between 0 and 170 deg")
    mouth = _disc(direction, fields.direction("towards", [1, 0, 0]), 0.5 * size)
    return fields.colour("wall", 0.01) + mouth * (fields.colour("outside", 1000.0) - fields.colour("wall", 0.01))


def _disc(direction: np.ndarray, towards: np.ndarray, radius: float) -> np.ndarray:
    """Coverage [rows, columns, 1] of a disc with an edge one texel soft; a disc smaller than a texel fills one."""
    texel = np.pi / len(direction)
    distance = np.arctan2(np.linalg.norm(np.cross(direction, towards), axis=-1), direction @ towards)
    return np.clip((max(radius, 0.75 * texel) - distance) / texel + 0.5, 0.0, 1.0)[..., None]
