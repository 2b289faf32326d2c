"""Makes triangle meshes of the primitive shapes, by code.

Every shape is centred on its frame; axes of revolution are z. Faces run counter-clockwise seen from outside. uv (0, 0)
is the texture's lower left corner. Triangle counts are modest: silhouettes lie within 1 % of the radius
of the true shape (the chord of a 24-gon, 1 - cos(pi / 24) = 0.9 %; of a cylinder's 64-gon 0.1 %), unless more is asked
for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from evis.scene.model import Mesh, Roundness

SEGMENTS = 64
"""Sides of a cylinder; the rim of a disk has twice as many."""
NO_AREA = 1e-12
"""Twice the area of a triangle, by the square of the longest side of the mesh, up to which it has none."""


def box(size: np.ndarray, tile: float = 0.0) -> Mesh:
    """Makes a box with edge lengths size [3]; every face shows the whole texture, or repeats it every `tile` m."""
    corners, uv = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            if sign < 0:
                a, b = b, a
            n = sign * np.eye(3)[axis]
            corners.append([n - a - b, n + a - b, n + a + b, n - a + b])
            edges = np.abs(2 * np.stack((a, b))) @ (0.5 * np.asarray(size))
            uv.append(_QUAD_UV * (edges / tile if tile > 0 else 1.0))
    vertices = np.array(corners).reshape(-1, 3) * 0.5 * np.asarray(size)
    return _mesh(vertices, np.arange(24).reshape(6, 4)[:, _QUAD].reshape(-1, 3), np.array(uv).reshape(-1, 2))


def rounded_box(size: np.ndarray, radius: float, segments: int = 3) -> Mesh:
    """Makes a box with edge lengths size [3], its edges quarter circles of `radius` [m] in 2 `segments` steps, smooth
    normals.

    Every face shows the whole texture, bent over half of its round edges. Raises ValueError for a radius beyond half of
    the shortest edge.
    """
    half = 0.5 * np.asarray(size, np.float64)
    if not 0.0 < radius <= half.min() * (1 + 1e-9):
        raise ValueError(f"the radius of the edges is {radius:g} m; it must be more than 0, at most {half.min():g} m")
    # Along each axis of a face: the tangents of angles up to 45 deg at both ends, the flat part between them.
    bend = np.tan(np.linspace(-np.pi / 4, 0, segments + 1))
    parts = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            a, b = (axis + 1) % 3, (axis + 2) % 3
            if sign < 0:
                a, b = b, a
            lines, texture = [], []
            for k in (a, b):
                slope = np.r_[bend, -bend[::-1]]
                core = np.repeat([-1.0, 1.0], segments + 1) * (half[k] - radius)
                lines.append((core, slope))
                along = core + radius * np.sin(np.arctan(slope))
                texture.append((along - along[0]) / (along[-1] - along[0]))
            normal = np.zeros((len(slope), len(slope), 3))
            normal[..., axis] = sign
            normal[..., a], normal[..., b] = lines[0][1][None, :], lines[1][1][:, None]
            normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
            points = np.zeros_like(normal)
            points[..., axis] = sign * (half[axis] - radius)
            points[..., a], points[..., b] = lines[0][0][None, :], lines[1][0][:, None]
            u, v = np.meshgrid(*texture)
            uv = np.stack((u, v), axis=-1).reshape(-1, 2)
            vertices = (points + radius * normal).reshape(-1, 3)
            parts.append(_mesh(vertices, _convex_faces(vertices, *u.shape), uv, normal.reshape(-1, 3)))
    return join(*parts)


def plane(size: np.ndarray, repeat: Sequence[float] | np.ndarray = (1.0, 1.0), cells: int = 8) -> Mesh:
    """Makes a rectangle of size [2] in x, y, facing +z, cut into cells x cells quads (a z-buffer likes no huge
    triangles).
    """
    line = np.linspace(-0.5, 0.5, cells + 1)
    y, x = np.meshgrid(line, line, indexing="ij")
    vertices = np.stack((x * size[0], y * size[1], 0 * x), axis=-1).reshape(-1, 3)
    uv = (np.stack((x, y), axis=-1).reshape(-1, 2) + 0.5) * repeat
    return _mesh(vertices, _grid_faces(cells + 1, cells + 1), uv)


def grid(points: np.ndarray, uv: np.ndarray) -> Mesh:
    """Makes a surface through points [rows, columns, 3] (rows along y, columns along x) with uv [rows, columns, 2]."""
    return _mesh(points.reshape(-1, 3), _grid_faces(*points.shape[:2]), uv.reshape(-1, 2))


def disk(radius: float, finer: int = 1) -> Mesh:
    """Makes a flat disk of 128 x `finer` sides facing +z; the texture lies over its bounding square, upright along
    +y.
    """
    segments = 2 * SEGMENTS * finer
    return round_mesh(_disk(radius, segments), radius * sagitta(segments), partial(disk, radius), radius)


def _disk(radius: float, segments: int) -> Mesh:
    rim = _circle(segments)
    vertices = np.concatenate((np.zeros((1, 3)), np.c_[radius * rim, np.zeros(segments)]))
    around = np.arange(segments)
    faces = np.stack((np.zeros(segments, int), around + 1, (around + 1) % segments + 1), axis=-1)
    return _mesh(vertices, faces, np.concatenate(([[0.5, 0.5]], 0.5 + 0.5 * rim)))


def sphere(radius: float) -> Mesh:
    """Makes a latitude-longitude sphere of 528 triangles with smooth normals."""
    return ellipsoid(np.full(3, radius))


def ellipsoid(radii: np.ndarray, finer: int = 1) -> Mesh:
    """Makes an ellipsoid with semi-axes radii [3] of 24 x `finer` sides, smooth normals."""
    rings, sides = 12 * finer, 24 * finer
    angle = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    profile = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    mesh = _revolve(profile, profile, np.linspace(0, 1, rings + 1), sides)
    radii = np.asarray(radii, np.float64)
    mesh.vertices = (mesh.vertices * radii).astype(np.float32)
    assert mesh.normals is not None
    normals = mesh.normals / radii
    mesh.normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
    longest = float(radii.max())
    return round_mesh(mesh, longest * sagitta(sides), partial(ellipsoid, radii), longest)


def cylinder(radius: float, height: float, finer: int = 1) -> Mesh:
    """Makes a closed cylinder along z of 64 x `finer` sides: smooth side, flat caps (each with the texture over its
    bounding square).
    """
    h, segments = 0.5 * height, SEGMENTS * finer
    side = _revolve(
        np.array([[radius, -h], [radius, h]]), np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([0.0, 1.0]), segments
    )
    top = _flat(_disk(radius, segments))
    top.vertices[:, 2] = h
    bottom = _disk(radius, segments)
    bottom.vertices *= np.array([1, -1, 1], np.float32)  # half a turn about x, which leaves z = 0 as it is
    bottom = _flat(bottom)
    bottom.vertices[:, 2] = -h
    whole = float(np.hypot(radius, h))
    return round_mesh(join(side, top, bottom), radius * sagitta(segments), partial(cylinder, radius, height), whole)


def capsule(radius: float, height: float, finer: int = 1) -> Mesh:
    """Makes a cylinder of `height` along z of 24 x `finer` sides with a hemisphere on each end, smooth normals."""
    rings, sides = 5 * finer, 24 * finer
    low = np.linspace(-np.pi / 2, 0, rings + 1)
    high = np.linspace(0, np.pi / 2, rings + 1)
    angle = np.concatenate((low, high))
    normals = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
    profile = radius * normals
    profile[:, 1] += np.where(np.arange(len(angle)) <= rings, -0.5, 0.5) * height
    length = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=-1))))
    mesh = _revolve(profile, normals, length / length[-1], sides)
    return round_mesh(mesh, radius * sagitta(4 * rings), partial(capsule, radius, height), radius + 0.5 * height)


def triangles(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    """Makes a mesh of its vertices [V, 3] and faces [F, 3], shaded flat, without uv. Raises ValueError for one without
    any area.
    """
    mesh = Mesh(np.asarray(vertices, np.float32), np.asarray(faces, np.int32))
    if is_flat(mesh):
        raise ValueError("no triangle has an area: the corners of each are in one line or one place; move some of them")
    return mesh


def is_flat(mesh: Mesh) -> bool:
    """Tells whether no triangle has an area, as far as float64 tells for points of this size."""
    a, b, c = mesh.vertices.astype(np.float64)[mesh.faces].transpose(1, 0, 2)
    size = max(float(np.abs(np.stack((b - a, c - a))).max()), np.finfo(np.float64).tiny)
    return bool(np.linalg.norm(np.cross((b - a) / size, (c - a) / size), axis=-1).max() <= NO_AREA)


def join(*parts: Mesh) -> Mesh:
    """Joins several meshes into one; all must have uv and normals."""
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.faces + o for p, o in zip(parts, offsets)]).astype(np.int32),
        np.concatenate([p.uv for p in parts if p.uv is not None]),
        np.concatenate([p.normals for p in parts if p.normals is not None]),
    )


_QUAD = np.array([[0, 1, 2], [0, 2, 3]])
_QUAD_UV = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def round_mesh(mesh: Mesh, error: float, make: Callable[..., Mesh], radius: float) -> Mesh:
    """Gives a mesh what tells how to make it finer. error, radius: as of Roundness. make: takes `finer=n`."""
    mesh.round = Roundness(float(error), lambda n: make(finer=n), float(radius))
    return mesh


def sagitta(sides: int) -> float:
    """Computes how far within a circle of radius 1 the sides of a regular polygon lie."""
    return float(1.0 - np.cos(np.pi / sides))


def _circle(segments: int) -> np.ndarray:
    angle = 2 * np.pi * np.arange(segments) / segments
    return np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def _grid_faces(rows: int, columns: int) -> np.ndarray:
    """Faces of a grid of vertices numbered row by row, two triangles per cell."""
    return _grid_cells(rows, columns)[:, _QUAD].reshape(-1, 3)


def _convex_faces(vertices: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The same of cells that are not plane, each cut along the diagonal that is further out."""
    cells = _grid_cells(rows, columns)
    a, b, c, d = (vertices[cells[:, k]] for k in range(4))
    outside = np.einsum("nk,nk->n", np.cross(b - a, c - a), d - a) > 0
    cells[outside] = np.roll(cells[outside], -1, axis=1)
    return cells[:, _QUAD].reshape(-1, 3)


def _grid_cells(rows: int, columns: int) -> np.ndarray:
    """The four corners of each cell of a grid of vertices, counter-clockwise."""
    start = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    return np.stack((start, start + 1, start + columns + 1, start + columns), axis=-1)


def _mesh(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray, normals: np.ndarray | None = None) -> Mesh:
    """Per-vertex uv and normals spread over the corners; triangles without area left out."""
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    faces = faces[area > 1e-12 * max(area.max(), 1e-300)]
    return Mesh(
        vertices.astype(np.float32), faces.astype(np.int32), uv[faces].astype(np.float32),
        None if normals is None else normals[faces].astype(np.float32),
    )  # fmt: skip


def _flat(mesh: Mesh) -> Mesh:
    """The same with the geometric normal at every corner."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    mesh.normals = np.repeat(normal[:, None], 3, axis=1).astype(np.float32)
    return mesh


def _revolve(profile: np.ndarray, normals: np.ndarray, v: np.ndarray, segments: int) -> Mesh:
    """Surface of revolution about z of a profile [P, 2] (radius, z) from bottom to top, u once around."""
    u = np.linspace(0, 1, segments + 1)
    ring = np.stack((np.cos(2 * np.pi * u), np.sin(2 * np.pi * u)), axis=-1)

    def sweep(curve: np.ndarray) -> np.ndarray:
        around = curve[:, None, :1] * ring
        return np.concatenate((around, np.broadcast_to(curve[:, None, 1:], (*around.shape[:2], 1))), -1).reshape(-1, 3)

    uv = np.stack((np.tile(u, len(profile)), np.repeat(v, len(u))), axis=-1)
    return _mesh(sweep(profile), _grid_faces(len(profile), len(u)), uv, sweep(normals))
