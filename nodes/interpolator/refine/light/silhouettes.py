"""Measures how wide the parts and the holes of meshes are, seen along their axes, which decides the width of light and
dark in their shadows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import warp as wp

from evis.scene.model import Mesh
from nodes.interpolator.refine.light.silhouette_kernels import trace_silhouette
from nodes.renderer.geometry.triangles import SHELL_CONVEX
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import box_halves, half_extents

LINES, PLACES = 48, 512
"""Lines across an outline, and places on each at which it is looked whether there is something."""
FINE, CONVEX = 0.1, 0.2
"""Part of the parts and holes of an outline that may be narrower, of what is convex too: a round thing is narrow where
it ends."""
FLAT = 1e-4
"""Thickness of a mesh, of its size, up to which it is not looked at from aside."""


def finest_halves(visibility: Visibility, asked: np.ndarray) -> np.ndarray:
    """Gives half of how wide, at least, parts and holes of each instance are along the axes of its own frame, float64
    [I, 3] m: half the sides of a box, and of what is not `asked` for, bool [I]."""
    geometry = visibility.geometry

    def found() -> np.ndarray:
        known: dict[int, np.ndarray] = {}
        halves = half_extents(visibility).copy()
        whole = (box_halves(visibility) > 0).any(axis=1)
        for instance in np.flatnonzero(asked & ~whole):
            mesh = geometry.meshes[instance]
            if len(mesh.faces):
                if id(mesh) not in known:
                    convex = geometry.shell[instance] == SHELL_CONVEX
                    known[id(mesh)] = finest_half(mesh, CONVEX if convex else FINE)
                halves[instance] = np.minimum(halves[instance], known[id(mesh)])
        return halves

    return geometry.once(("finest halves", asked.tobytes()), found)


def finest_half(mesh: Mesh, narrower: float = FINE) -> np.ndarray:
    """Measures a mesh with faces: half the width along each axis that a share `narrower` of the parts and holes are
    below, of its outline seen along another axis, float64 [3] m; that of a place where it is so thin that none shows
    it."""
    finest = np.ptp(_points(mesh), axis=(0, 1)) / 2
    for along, place, seen in silhouettes_of(mesh):
        widths = widths_of(seen)
        places = float(np.quantile(widths, narrower)) if len(widths) else 1.0
        finest[along] = min(finest[along], places * place / 2)
    return finest


def finest_hole(mesh: Mesh) -> np.ndarray:
    """Measures half of how wide the holes in the outline of a mesh are along each axis, float64 [3] m: so that as many
    as a share FINE of all parts and holes are narrower; inf where there are fewer."""
    finest = np.full(3, np.inf)
    for along, place, seen in silhouettes_of(mesh):
        holes = np.sort(holes_of(seen))
        few = int(FINE * len(widths_of(seen)))
        if len(holes) > few:
            finest[along] = min(finest[along], float(holes[few]) * place / 2)
    return finest


def silhouettes_of(mesh: Mesh) -> Iterator[tuple[int, float, np.ndarray]]:
    """Looks at a mesh along each axis at which it is no line: gives, for both others, the axis that lines follow, the
    length [m] of a place on them, and what is seen there, int8 [LINES, PLACES]."""
    points = _points(mesh)
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    size = high - low
    with wp.ScopedDevice("cpu"):
        corners: wp.array = wp.array(points.reshape(-1, 3) - low, dtype=wp.vec3)
        order: wp.array = wp.array(np.arange(3 * len(points)), dtype=wp.int32)
        there = wp.Mesh(corners, order)
    for ahead in range(3):
        across = [axis for axis in range(3) if axis != ahead]
        if (size[across] <= FLAT * size.max()).any():
            continue
        for along, beside in (across, across[::-1]):
            seen: wp.array = wp.empty((LINES, PLACES), dtype=wp.int8, device="cpu")
            given = [there.id, wp.vec3(*size), along, beside, ahead]
            wp.launch(trace_silhouette, seen.shape, given, [seen], device="cpu")
            yield along, size[along] / PLACES, seen.numpy()


def widths_of(seen: np.ndarray) -> np.ndarray:
    """Gives how many places each part, and each hole between two parts, takes on lines [n, places]; int [any]."""
    line, place = _edges(seen)
    # An edge to the next one of the same line: parts and holes in turn.
    return np.diff(place)[np.diff(line) == 0]


def holes_of(seen: np.ndarray) -> np.ndarray:
    """Gives how many places each hole between two parts takes on lines [n, places]; int [any]."""
    line, place = _edges(seen)
    # Each line has an even number of edges, of which the second one ends a part.
    return (place[2::2] - place[1:-1:2])[line[2::2] == line[1:-1:2]]


def _edges(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finds where something begins or ends on lines [n, places]: lines, and places on these."""
    walls = np.pad(seen != 0, ((0, 0), (1, 1)))
    line, place = np.nonzero(walls[:, 1:] != walls[:, :-1])
    return line, place


def _points(mesh: Mesh) -> np.ndarray:
    """Gives the corners of a mesh's faces, float64 [F, 3, 3] m."""
    return np.asarray(mesh.vertices, np.float64)[np.asarray(mesh.faces)]
