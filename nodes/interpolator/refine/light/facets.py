"""Finds the facets of what is shaded round, each of which turns away from a lamp by itself, and how fast they come."""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.geometry.triangles import areas
from evis.gpu.exchange import cpu_array
from evis.runtime.clock import NS
from nodes.interpolator.refine.light.shadow_time_kernels import find_shortest_shadows
from nodes.interpolator.refine.probing.boxes import boxes_of
from nodes.renderer.geometry.triangles import Geometry
from nodes.renderer.raster.visibility import Visibility

LEAST_LEAN = np.radians(4.0)
"""Angle between a facet and the normal that it is shaded with, below which few pixels see it turn away: a cylinder of
64 sides has 2.8 degrees, a sphere 7.5."""
SELDOM_HZ = 1.0
"""How often in a second a pixel of the image sees a facet turn, on the average, from which on something counts:
with half of that robot_arm takes a tenth more time, and its error is the same to 0.001."""
BOXES, FEWEST = 1 << 9, 8
"""Boxes of an environment whose speeds are worked out, at most, unless they are of so few times in a gap."""
TWICE = 2.0
"""Angles of two facets of one place from the normal there, of one of them."""


class Facets:
    """Finds for how long a facet of something that moves is on a point.

    A lamp shines on no facet that is turned away from it, though its shading normal is not. normal_deviation: float32
    [T], sine of the angle from a triangle's plane to a lamp within which the next facet at its place may be turned
    otherwise; 0 of what is no such facet.
    """

    def __init__(self, visibility: Visibility, movers: np.ndarray, asked: np.ndarray) -> None:
        """Finds what is shaded round though its facets are flat. movers: bodies that move. asked: whether an instance
        may move against a lamp, bool [I]."""
        geometry = visibility.geometry
        normal_deviation = np.zeros(len(geometry.triangles), np.float32)
        grazed = np.zeros(len(geometry.body))
        half = np.zeros((len(geometry.body), 3))
        for instance in np.flatnonzero(asked):
            own = slice(int(geometry.first[instance]), int(geometry.first[instance + 1]))
            corners = geometry.vertices[geometry.triangles[own]].astype(np.float64)
            angle, area = normal_deviations_of(geometry, own), areas(corners)
            round_ = (angle > LEAST_LEAN) & (area > 0)
            if round_.any():
                normal_deviation[own] = np.where(round_, np.sin(np.minimum(TWICE * angle, np.pi / 2)), 0.0)
                half[instance] = width_of(corners[round_]) / 2
                # A lamp lies in any direction: within an angle from as many planes as its sine.
                grazed[instance] = np.average(normal_deviation[own], weights=area)
        which = np.flatnonzero((half[:, 0] > 0) & np.isin(geometry.body, movers))
        self._boxes, self._count = boxes_of(visibility, movers, which, half)
        self._mover, self._place = np.searchsorted(movers, geometry.body[which]), geometry.translation[which]
        view = visibility.view
        shown = np.pi * (geometry.radius[which].astype(np.float64) * max(view.fx, view.fy)) ** 2
        # Of the image, at a distance of a metre.
        self._shown, self._grazed = shown / (view.width * view.height), grazed[which]
        self._camera_body = visibility.camera_body
        self.normal_deviation = visibility.put(normal_deviation, wp.float32)
        self.any = bool(len(which))

    def shortest(self, moved: np.ndarray, rest: np.ndarray, apart_ns: np.ndarray) -> np.ndarray:
        """Gives that time, float64 [E] ns, of what is large and fast enough in the image.

        moved: poses of the movers at all instants, float64 [n, E, M, 7], apart_ns [E] from each other. rest: of all
        bodies, float64 [E, N, 7].
        """
        envs, last = moved.shape[1], len(moved) - 2
        first = np.linspace(0, last, min(last + 1, max(FEWEST, BOXES // self._count))).astype(np.int32)
        # A lamp that moves brings no other facet.
        found, shine = np.empty((len(first), envs, self._count)), np.zeros(envs)
        poses = cpu_array(np.ascontiguousarray(moved), wp.transformd)
        given = [self._boxes, cpu_array(shine), cpu_array(first), poses]
        wp.launch(find_shortest_shadows, found.shape, given, [cpu_array(found)], device="cpu")
        times = apart_ns[:, None] * found.min(axis=0)
        places = se3.transform(moved[first][:, :, self._mover], self._place)
        away = np.linalg.norm(places - rest[:, None, self._camera_body, :3], axis=-1).min(axis=0)
        turned = np.minimum(self._shown / np.maximum(away, 1e-30) ** 2, 1.0) * self._grazed
        counts = np.isfinite(times) & (turned * NS >= SELDOM_HZ * np.where(np.isfinite(times), times, 0.0))
        return np.where(counts, times, np.inf).min(axis=1)


def normal_deviations_of(geometry: Geometry, own: slice) -> np.ndarray:
    """Computes the greatest angle [rad] of triangles' shading normals from their planes' own, float64; own: which."""
    if geometry.smooth is None:
        return np.zeros(own.stop - own.start)
    shown = geometry.smooth.reshape(-1, 3, 3)[own].astype(np.float64)
    length = np.linalg.norm(shown, axis=-1)
    along = (shown * geometry.normals[own, None]).sum(-1)
    cosine = np.divide(along, length, out=np.ones_like(along), where=length > 0)
    return np.arccos(np.clip(cosine, -1.0, 1.0)).max(axis=1)


def width_of(corners: np.ndarray) -> float:
    """Computes how wide triangles [n, 3, 3] are: the median of their least heights, by area [m]."""
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    area = areas(corners)
    height = 2 * area / np.maximum(sides, 1e-30)
    order = np.argsort(height)
    so_far = np.cumsum(area[order])
    return float(height[order][np.searchsorted(so_far, so_far[-1] / 2)])
