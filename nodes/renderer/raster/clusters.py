"""Cuts instances into blocks of consecutive triangles and vertices, the unit in which they are culled and drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nodes.renderer.geometry.triangles import Geometry

SIZE = 64
"""Most triangles or vertices of a block."""


@dataclass
class Blocks:
    """Holds arrays [B] of raster_kernels.Blocks; the first `still` ones belong to still instances."""

    instance: np.ndarray
    first: np.ndarray
    last: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    extent: np.ndarray
    axis: np.ndarray
    cosine: np.ndarray
    still: int


def triangle_blocks(geometry: Geometry, still: np.ndarray, two_sided: np.ndarray) -> Blocks:
    """Gives blocks of triangles; still, two_sided: bool [I]."""
    key = "triangle blocks", still.tobytes(), two_sided.tobytes()
    return geometry.once(key, lambda: _triangle_blocks(geometry, still, two_sided))


def _triangle_blocks(geometry: Geometry, still: np.ndarray, two_sided: np.ndarray) -> Blocks:
    instance, first, last, count = _cut(geometry.first, still)
    # One step for all triangles each: numpy is slow to go over axes of three.
    corners = geometry.vertices[geometry.triangles.T].astype(np.float64)
    low, high = (of(of(corners[0], corners[1]), corners[2]) for of in (np.minimum, np.maximum))
    normals = geometry.normals.astype(np.float64)
    centre, radius = np.zeros((len(instance), 3)), np.zeros(len(instance))
    axis, cosine = np.zeros((len(instance), 3)), np.zeros(len(instance))
    if len(instance):
        # reduceat needs ascending starts: blocks in the order of the triangles.
        order = np.argsort(first)
        starts, lengths = first[order], (last - first)[order]
        middle = (np.minimum.reduceat(low, starts) + np.maximum.reduceat(high, starts)) / 2
        x, y, z = np.moveaxis(corners - np.repeat(middle, lengths, 0), -1, 0) ** 2
        away = np.maximum.reduce(np.sqrt(x + y + z))
        mean = np.add.reduceat(normals, starts)
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        mean = np.divide(mean, size, out=np.zeros_like(mean), where=size > 1e-6)
        x, y, z = (normals * np.repeat(mean, lengths, 0)).T
        # A triangle without area is never seen.
        lean = np.where((normals.T != 0).any(0), x + y + z, 1.0)
        centre[order], radius[order] = middle, np.maximum.reduceat(away, starts)
        axis[order], cosine[order] = mean, np.minimum.reduceat(lean, starts)
        cosine = np.where(two_sided[instance], 0.0, np.minimum(cosine - 1e-5, 1.0))
    extent = geometry.radius[instance]
    return Blocks(instance, first, last, centre, radius * (1 + 1e-6), extent, axis, cosine, count)


def vertex_blocks(geometry: Geometry, still: np.ndarray) -> Blocks:
    """Gives blocks of vertices, with nothing but `extent` to cull them by: an instance's vertices are there or are
    not."""
    edges = np.searchsorted(geometry.vertex_instance, np.arange(len(still) + 1))
    instance, first, last, count = _cut(edges, still)
    zero, none = np.zeros(len(instance)), np.zeros((len(instance), 3))
    return Blocks(instance, first, last, none, zero, geometry.radius[instance], none, zero, count)


def _cut(edges: np.ndarray, still: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Lists the blocks of items edges[i]..edges[i + 1]: instance, first and last of each, and the count of still ones,
    which come first."""
    sizes = np.diff(edges)
    pieces = -(-sizes // SIZE)
    order = np.argsort(~still, kind="stable")
    instance = np.repeat(order, pieces[order])
    index = np.arange(len(instance)) - np.repeat(np.cumsum(pieces[order]) - pieces[order], pieces[order])
    first = edges[instance] + SIZE * index
    return instance, first, np.minimum(first + SIZE, edges[instance + 1]), int(pieces[still].sum())
