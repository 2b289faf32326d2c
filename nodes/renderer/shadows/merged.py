"""Joins still instances into one mesh: one tree of triangles instead of a tree of instances over their own trees."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.renderer.raster.visibility import Visibility

MOST_TRIANGLES = 4_000_000
"""Beyond, the memory for them (about 200 bytes each) is kept for other things."""


class MergedMesh:
    """Joins the triangles of instances `chosen` to one `mesh` on the device, with each one's instance and face there.

    turn float64 [C, 3, 3] and centre float64 [C, 3] take an instance's frame to the mesh's.
    """

    def __init__(self, visibility: Visibility, chosen: np.ndarray, turn: np.ndarray, centre: np.ndarray) -> None:
        geometry, put = visibility.geometry, visibility.put
        place = np.full(len(geometry.body), -1)
        place[chosen] = np.arange(len(chosen))
        at = place[geometry.vertex_instance]
        used = at >= 0
        points = np.zeros((len(geometry.vertices), 3))
        points[used] = (turn[at[used]] @ geometry.vertices[used, :, None].astype(np.float64))[..., 0] + centre[at[used]]
        triangles = np.flatnonzero(place[geometry.triangle_instance] >= 0)
        # Only the vertices that are used, for the others lie anywhere.
        index = np.cumsum(used) - 1
        owner = geometry.triangle_instance[triangles]
        self.instance, self.face = put(owner, wp.int32), put(triangles - geometry.first[owner], wp.int32)
        self.mesh = wp.Mesh(
            points=put(points[used], wp.vec3),
            indices=put(index[geometry.triangles[triangles]].reshape(-1), wp.int32),
            bvh_constructor="sah",
        )


def mergeable(visibility: Visibility, chosen: np.ndarray) -> bool:
    """Tells whether instances [C] are few enough triangles to be joined."""
    counts: Any = np.diff(visibility.geometry.first)[chosen]
    return 0 < int(counts.sum()) <= MOST_TRIANGLES
