"""Measures how finely surfaces are painted: over which lengths their albedo goes up or down."""

from __future__ import annotations

import numpy as np

from evis.media.colour import REC709
from evis.scene.model import Material, Scene
from nodes.renderer.geometry.triangles import Geometry

EVEN = 1.0e30
"""Stands for the grain of what is of one colour [m]."""
DARKEST = 1e-3
"""Albedo below which differences do not matter."""
SWING = 1.0
"""Change of ln albedo that counts as a whole swing, where a texture has more."""
MOST_TEXELS = 1024
"""Texels along a side of a texture that are looked at; of a larger one every n-th."""
BLOCKS = 16
"""Parts along each side of a texture, of which the one with the finest grain counts."""


def grain_of(scene: Scene, geometry: Geometry, least: float) -> np.ndarray:
    """Computes over which length float32 [T] [m] ln albedo goes up or down on each triangle, EVEN without that.

    It is the swing of a texture, or of a triangle's colours, over the mean of its gradient's magnitude. least: change
    of ln albedo that matters.
    """
    grain = np.full(len(geometry.triangles), EVEN, np.float32)
    corners = geometry.vertices[geometry.triangles].astype(np.float64)
    known: dict[int, tuple[float, float] | None] = {}
    for number, instance in enumerate(scene.instances):
        own = slice(int(geometry.first[number]), int(geometry.first[number + 1]))
        if instance.material not in known:
            known[instance.material] = _of_texture(scene.materials[instance.material], least)
        fine = known[instance.material]
        if fine is not None and instance.mesh.uv is not None:
            along_u, along_v = _per_unit(corners[own], np.asarray(instance.mesh.uv, np.float64))
            grain[own] = np.minimum(np.minimum(along_u * fine[0], along_v * fine[1]), EVEN)
        if instance.mesh.colours is not None:
            grain[own] = np.minimum(grain[own], _of_colours(corners[own], instance.mesh.colours, least))
    return grain


def _of_texture(material: Material, least: float) -> tuple[float, float] | None:
    """Computes the grain along u and v, in units of these; None of what is even."""
    if material.texture is None:
        return None
    step = -(-max(material.texture.shape[:2]) // MOST_TEXELS)
    shown = np.asarray(material.texture, np.float32)[::step, ::step] * np.asarray(material.albedo, np.float32)
    log = np.log(np.maximum(shown @ np.array(REC709, np.float32), DARKEST))
    swing = float(log.max() - log.min())
    if swing < least:
        return None
    return tuple(min(swing, SWING) / max(_steepest(log, axis) * log.shape[axis], 1e-12) for axis in (1, 0))


def _steepest(log: np.ndarray, axis: int) -> float:
    """Computes the mean magnitude of the difference from one texel to the next, in the block where it is greatest."""
    change = np.abs(np.diff(log, axis=axis, append=np.take(log, [0], axis)))
    rows, columns = (np.unique(np.arange(BLOCKS) * size // BLOCKS) for size in log.shape)
    sums = np.add.reduceat(np.add.reduceat(change, rows, 0), columns, 1)
    counts = np.outer(np.diff(rows, append=log.shape[0]), np.diff(columns, append=log.shape[1]))
    return float((sums / counts).max())


def _per_unit(corners: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes the length [m] of a unit of u and of v on triangles, float64 [F]; corners [F, 3, 3], uv [F, 3, 2]."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    (u1, v1), (u2, v2) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / np.abs(u1 * v2 - u2 * v1)
        along_u = np.linalg.norm(v2[:, None] * first - v1[:, None] * second, axis=1) * over
        along_v = np.linalg.norm(u1[:, None] * second - u2[:, None] * first, axis=1) * over
    return np.nan_to_num(along_u, nan=EVEN, posinf=EVEN), np.nan_to_num(along_v, nan=EVEN, posinf=EVEN)


def _of_colours(corners: np.ndarray, colours: np.ndarray, least: float) -> np.ndarray:
    """Computes the grain [m] of triangles whose corners differ in colour: their longest edge."""
    log = np.log(np.maximum(np.asarray(colours, np.float64) @ np.array(REC709), DARKEST))
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    return np.where(np.ptp(log, axis=1) >= least, longest, EVEN)
