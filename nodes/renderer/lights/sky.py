"""Holds the sky on the device: an environment map with its halvings, and the irradiance that it gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Scene
from nodes.renderer.lights import lobe_kernels, sky_kernels
from nodes.renderer.lights.lights import check_colour
from nodes.renderer.materials.ggx import directional_albedo
from nodes.renderer.raster.visibility import Visibility

CELLS = (64, 128)
"""Rows and columns of the map that irradiance is summed over."""

NORMALS = (32, 64)
"""Rows and columns of the irradiance map."""

SPECULAR_SAMPLES = 24
"""Of a lobe: a multiple of lobe_kernels.RUN."""


def make_sky(visibility: Visibility, gloss: bool) -> Any:
    """Makes the kernels' sky. Raises ValueError for an environment or a map that is not usable."""
    scene, put = visibility.scene, visibility.put
    check_colour(scene, "environment", scene.environment)
    sky = sky_kernels.Sky()
    sky.uniform = wp.vec3(*(float(v) for v in scene.environment))
    sky.camera = visibility.eye
    levels, diffuse = [np.zeros((0, 0, 3))], np.zeros((0, 0, 3))
    if scene.environment_map is not None:
        radiance = _checked(scene)
        levels = halvings(radiance)
        diffuse = irradiance_map(radiance) if scene.sky_lights else np.tile(scene.environment, (2, 2, 1))
    shapes = [level.shape for level in levels]
    full = [surrounded(level) for level in levels]
    starts = np.cumsum([0] + [level.shape[0] * level.shape[1] for level in full])
    places = [(start, w, h) for start, (h, w, _) in zip(starts, shapes)] + [(0, diffuse.shape[1], diffuse.shape[0])]
    sky.levels = put(np.array(places, np.int32), wp.vec3i)
    beside = np.zeros((lobe_kernels.BESIDE, 3))
    sky.texels = put(np.concatenate([*(level.reshape(-1, 3) for level in full), beside]), wp.vec3)
    sky.diffuse = put(surrounded(diffuse).reshape(-1, 3), wp.vec3)
    sky.albedo = put(directional_albedo() if gloss else np.zeros((0, 0, 2)), wp.vec2)
    sky.points = put(_points(SPECULAR_SAMPLES), wp.float32)
    return sky


def surrounded(level: np.ndarray) -> np.ndarray:
    """Gives a map float [h, w, 3] as [h + 2, w + 2, 3], its columns from azimuth -pi to pi, with a texel more on every
    side: whoever reads it has no end to look for. Beyond a pole lies the row of the other side."""
    if level.size == 0:
        return level
    across = level.shape[1] // 2
    tall = np.concatenate([np.roll(level[:1], -across, 1), level, np.roll(level[-1:], -across, 1)])
    return tall[:, np.arange(-across - 1, level.shape[1] - across + 1) % level.shape[1]]


def halvings(radiance: np.ndarray) -> list[np.ndarray]:
    """Gives the map float [h, w, 3] and its reductions to half, a quarter ..., means over solid angle."""
    levels = [np.asarray(radiance, np.float64)]
    while min(levels[-1].shape[:2]) > 2:
        h, w = levels[-1].shape[:2]
        levels.append(_reduced(levels[-1], h // 2, w // 2))
    return levels


def irradiance_map(radiance: np.ndarray) -> np.ndarray:
    """Gives the irradiance / pi float64 [*NORMALS, 3] of surfaces with these normals, of a map that surrounds them.

    Sum over cells of max(0, n . (integral of radiance times direction over the cell)): exact for every cell that lies
    on one side of the horizon, and in any case for a uniform map, by which it is divided.
    """
    h, w = radiance.shape[:2]
    rows, columns = min(h, CELLS[0]), min(w, CELLS[1])
    flux = _direction_integrals(h, w)
    cells = np.empty((rows * columns, 3, 4))
    for channel in range(4):
        strength = np.ones((h, w)) if channel == 3 else radiance[..., channel].astype(np.float64)
        vectors = flux * strength[..., None]
        summed = _overlap(h, rows, True) @ vectors.reshape(h, -1)
        summed = summed.reshape(rows, w, 3).transpose(1, 0, 2).reshape(w, -1)
        cells[..., channel] = (
            (_overlap(w, columns, True) @ summed).reshape(columns, rows, 3).transpose(1, 0, 2).reshape(-1, 3)
        )
    theta = (np.arange(NORMALS[0]) + 0.5) / NORMALS[0] * np.pi
    phi = (np.arange(NORMALS[1]) + 0.5) / NORMALS[1] * 2 * np.pi
    theta, phi = (g.ravel() for g in np.meshgrid(theta, phi, indexing="ij"))
    normals = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    sums = np.stack([np.maximum(normals @ cells[..., c].T, 0).sum(1) for c in range(4)], -1)
    return (sums[:, :3] / sums[:, 3:]).reshape(*NORMALS, 3)


def _direction_integrals(h: int, w: int) -> np.ndarray:
    """Computes the integral of the direction over each texel's solid angle, float64 [h, w, 3]."""
    theta, phi = np.linspace(0, np.pi, h + 1), np.linspace(0, 2 * np.pi, w + 1)
    across = np.diff(theta / 2 - np.sin(2 * theta) / 4)[:, None]
    along = np.diff(np.sin(theta) ** 2 / 2)[:, None] * np.diff(phi)
    return np.stack([across * np.diff(np.sin(phi)), across * np.diff(-np.cos(phi)), along], -1)


def _reduced(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    h, w = image.shape[:2]
    solid = -np.diff(np.cos(np.linspace(0, np.pi, h + 1)))
    weights = _overlap(h, rows, False) * solid
    weights /= weights.sum(1, keepdims=True)
    narrow = (weights @ image.reshape(h, -1)).reshape(rows, w, 3).transpose(1, 0, 2).reshape(w, -1)
    return (_overlap(w, columns, False) @ narrow).reshape(columns, rows, 3).transpose(1, 0, 2)


def _overlap(size: int, parts: int, total: bool) -> np.ndarray:
    """Makes the matrix [parts, size] that sums (total) or averages `size` texels into equal parts.

    A texel that two parts share counts in each by its share.
    """
    edges, cuts = np.arange(size + 1), np.arange(parts + 1) * size / parts
    share = np.minimum(edges[None, 1:], cuts[1:, None]) - np.maximum(edges[None, :-1], cuts[:-1, None])
    share = np.maximum(share, 0)
    return share if total else share / (size / parts)


def _points(count: int) -> np.ndarray:
    """Gives Hammersley's points as cosines and sines of an angle and heights in (0, 1], float64 [3, count]."""
    index = np.arange(count)
    bits = np.zeros(count)
    for digit in range(int(np.ceil(np.log2(count)))):
        bits += ((index >> digit) & 1) * 0.5 ** (digit + 1)
    return np.stack([np.cos(2 * np.pi * bits), np.sin(2 * np.pi * bits), 1 - (index + 0.5) / count])


def _checked(scene: Scene) -> np.ndarray:
    radiance = np.asarray(scene.environment_map)
    if radiance.ndim != 3 or radiance.shape[2] != 3:
        raise ValueError(f"scene {scene.name}: environment_map must be [h, w, 3], it is {list(radiance.shape)}")
    h, w = radiance.shape[:2]
    if min(h, w) < 2:
        raise ValueError(
            f"scene {scene.name}: environment_map is {w} x {h} texels, it must be at least 2 x 2; "
            "for the same radiance from everywhere use environment: [r, g, b]"
        )
    bad = ~np.isfinite(radiance) | (radiance < 0)
    if bad.any():
        row, column, _ = np.argwhere(bad)[0]
        raise ValueError(
            f"scene {scene.name}: environment_map has {bad.sum()} values that are negative or not finite, "
            f"the first at row {row}, column {column}"
        )
    return radiance
