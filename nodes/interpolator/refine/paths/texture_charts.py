"""Finds which triangles carry their texture on one plane."""

from __future__ import annotations

import numpy as np

from evis.scene.model import Instance, Scene
from nodes.renderer.geometry.triangles import Geometry, is_static

NO_CHART = -1
"""Stands for no chart: what has no texture, glows, or has colours of its own beside it."""
FINEST = 1e-5
"""Difference, of an instance's size and of the texture, up to which planes and places on textures are the same."""


def charts_of(scene: Scene, geometry: Geometry) -> np.ndarray:
    """Numbers the charts int32 [T] of all triangles: those of an instance that lie on one plane, and on which u and v
    are the same linear functions of the place. NO_CHART where a texture cannot be followed so."""
    charts = np.full(len(geometry.triangles), NO_CHART, np.int32)
    corners = geometry.vertices[geometry.triangles].astype(np.float64)
    for number, instance in enumerate(scene.instances):
        own = slice(int(geometry.first[number]), int(geometry.first[number + 1]))
        if _is_followed(scene, instance):
            # The number of a chart is that of one of its triangles.
            charts[own] = own.start + _alike(corners[own], np.asarray(instance.mesh.uv, np.float64))
    return charts


def follows_textures(scene: Scene, geometry: Geometry, camera_body: int) -> bool:
    """Tells whether there is a chart on something that moves before a camera that stands still.

    What a camera that moves sees of a still world goes by a few pixels in a gap, where looks at textures cost more than
    they save.
    """
    moving = ~geometry.static[geometry.triangle_instance]
    return is_static(scene, camera_body) and bool((charts_of(scene, geometry)[moving] != NO_CHART).any())


def _is_followed(scene: Scene, instance: Instance) -> bool:
    """Tells whether what an instance shows is a texture alone, and light on it."""
    material, mesh = scene.materials[instance.material], instance.mesh
    plain = material.texture is not None and not np.any(np.asarray(material.emission) > 0)
    return plain and mesh.uv is not None and mesh.colours is None


def _alike(corners: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Gives for each triangle the first one whose texture lies as its own; corners [F, 3, 3], uv [F, 3, 2]."""
    size = max(float(np.abs(corners).max(initial=0.0)), 1e-30)
    corners = corners / size
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        over = 1.0 / (normal * normal).sum(axis=1, keepdims=True)
        duals = np.stack([np.cross(second, normal) * over, np.cross(normal, first) * over], axis=1)
        unit = normal * np.sqrt(over)
    # [F, 2, 3]: gradients of u and v in the plane, and their values where the plane's coordinates are zero.
    along = np.einsum("fkc,fkd->fcd", uv[:, 1:] - uv[:, :1], duals)
    at_zero = uv[:, 0] - np.einsum("fcd,fd->fc", along, corners[:, 0])
    offset = (unit * corners[:, 0]).sum(axis=1, keepdims=True)
    described = np.concatenate([unit, offset, along.reshape(-1, 6), at_zero], axis=1)
    rounded = np.round(np.nan_to_num(described, nan=0.0, posinf=0.0, neginf=0.0) / FINEST).astype(np.int64)
    # One number in place of twelve, which are compared some ten times faster.
    mixed = (rounded * np.random.default_rng(0).integers(1 << 62, size=rounded.shape[1])).sum(axis=1)
    _, index, back = np.unique(mixed, return_index=True, return_inverse=True)
    return np.asarray(index[back.reshape(-1)], np.int32)
