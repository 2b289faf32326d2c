"""Finds for how long light through the gaps between shapes that move as one is on a point: between the plates of a
shutter, the blades of a fan, the bars of a gate."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.exchange import cpu_array
from evis.scene.model import WORLD, Mesh, Scene
from evis.scene.motion import Path, Prescribed, Shift
from nodes.interpolator.refine.light.box_shadows import CORNERS, BoxShadows
from nodes.interpolator.refine.light.shadow_time_kernels import find_shortest_shadows
from nodes.interpolator.refine.light.silhouettes import finest_hole
from nodes.interpolator.refine.probing.box_kernels import Boxes
from nodes.renderer.geometry.triangles import Geometry
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents

ALIKE = 6
"""Decimals [m] to which things of one size agree."""


class Hole(NamedTuple):
    """Holds the box about things that gaps are between: the body it is on; its middle, half its sides, and half of how
    wide the gaps are along its axes, inf where there are none, float64 [3] m each."""

    body: int
    middle: np.ndarray
    half: np.ndarray
    finest: np.ndarray


class Assemblies:
    """Finds the shortest time for which light between shapes that move as one is on a point.

    Each shape by itself is known by how wide it and its own holes are, which says nothing of what is between two: a
    slit of 2 cm between plates of half a metre. Shapes of one body are looked at together, and those of all that stands
    on it, or goes the same way.
    """

    def __init__(self, visibility: Visibility, movers: np.ndarray, which: np.ndarray, worlds: Sequence[Scene]) -> None:
        """Finds what stands on one body and moves as one. movers: bodies that move. which: instances on them that throw
        shadows. worlds: the scene of each environment where they stand on each other otherwise; none where the
        visibility's is that of all."""
        geometry, scenes = visibility.geometry, worlds or (visibility.scene,)
        holes: dict[tuple[bytes, bytes], Hole | None] = {}
        owners: dict[tuple[bytes, bytes], list[int]] = {}
        for number, scene in enumerate(scenes):
            for members, poses in assemblies_of(scene, geometry, which):
                key = members.tobytes(), poses.tobytes()
                if key not in holes:
                    holes[key] = hole_in(geometry, members, poses)
                owners.setdefault(key, []).append(number)
        # Those of the same environments together.
        alike: dict[tuple[int, ...], list[Hole]] = {}
        for key, hole in holes.items():
            if hole is not None:
                alike.setdefault(tuple(owners[key]), []).append(hole)
        self._parts: list[tuple[np.ndarray | None, Any, BoxShadows]] = []
        for envs, each in alike.items():
            boxes = _boxes_of(each, movers)
            shadows = BoxShadows(visibility, movers, boxes, np.full(len(each), CORNERS))
            self._parts.append((np.array(envs) if len(envs) < len(scenes) else None, boxes, shadows))
        self.any = bool(self._parts)

    def shortest(self, shine: np.ndarray, first: np.ndarray, moved: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Gives that time, float64 [E] instants. shine [E], first [n]: as of `find_shortest_shadows`. moved: poses of
        the movers, float64 [instants, E, M, 7]. rest: of all bodies at one time, float64 [E, N, 7]."""
        shortest = np.full(moved.shape[1], np.inf)
        for envs, boxes, shadows in self._parts:
            own = np.arange(len(shortest)) if envs is None else envs[envs < len(shortest)]
            found = np.empty((len(first), len(own), boxes.mover.size))
            poses = np.ascontiguousarray(moved if envs is None else moved[:, own])
            given = [boxes, cpu_array(shine[own]), cpu_array(first), cpu_array(poses, wp.transformd)]
            wp.launch(find_shortest_shadows, found.shape, given, [cpu_array(found)], device="cpu")
            shortest[own] = np.minimum(shortest[own], found.min(axis=(0, 2)))
            if shadows.any and len(own):
                shortest[own] = np.minimum(shortest[own], shadows.shortest(poses, rest[own], first))
        return shortest


def assemblies_of(scene: Scene, geometry: Geometry, which: np.ndarray) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Lists the instances, of `which`, that move as one, two or more: their numbers, and the poses of their bodies in
    the frame of the first one's, float64 [n, 7]."""
    groups: dict[Hashable, list[tuple[int, np.ndarray]]] = {}
    stands = {body: _carrier_of(scene, body) for body in np.unique(geometry.body[which]).tolist()}
    for instance in which.tolist():
        carrier, pose = stands[int(geometry.body[instance])]
        groups.setdefault(carrier, []).append((instance, pose))
    for members in groups.values():
        if len(members) > 1:
            back = se3.inverse(members[0][1])
            yield np.array([n for n, _ in members]), np.array([se3.compose(back, pose) for _, pose in members])


def _carrier_of(scene: Scene, body: int) -> tuple[Hashable, np.ndarray]:
    """Finds what a body moves with, as a key that is equal for bodies that move as one, and its pose there [7]."""
    path, mount = scene.bodies[body].trajectory, scene.bodies[body].mount
    if mount is not None:
        return mount
    if not isinstance(path, Prescribed):
        return body, se3.IDENTITY
    pose = se3.IDENTITY
    while path.parent is not None and not path.shifts and not path.turns:
        pose = se3.compose(path.start, pose)
        path = path.parent
    if path.turns:
        return (path,), pose
    return (path.parent, *(_shift_key(shift) for shift in path.shifts)), se3.compose(path.start, pose)


def _shift_key(shift: Shift) -> Hashable:
    """Makes a key of a shift, equal for shifts that are equal."""
    if isinstance(shift, Path):
        return shift.spline
    return type(shift), *(np.asarray(getattr(shift, item.name), np.float64).tobytes() for item in fields(shift))


def thinnest_between(
    visibility: Visibility, which: np.ndarray, worlds: Sequence[Scene], scale: np.ndarray
) -> np.ndarray:
    """Measures how wide the gaps between things of one size are that stand still, the bars of a fence: float64 [1 or
    E] m, the narrowest, inf without any. which: instances that stand still. worlds: as of Assemblies.
    scale [I]: how many times as wide the gaps between instances count.

    Things of one size alone, for what stands behind fills gaps in an outline: a lamp may see through between any two.
    """
    v = visibility
    geometry, scenes = v.geometry, worlds or (v.scene,)
    found, known = np.full(len(scenes), np.inf), dict[tuple[bytes, bytes], float]()
    sizes = np.round(half_extents(v)[which], ALIKE)
    _, size = np.unique(sizes, axis=0, return_inverse=True)
    alike = [which[size.ravel() == n] for n in np.flatnonzero(np.bincount(size.ravel()) > 1)]
    for number, scene in enumerate(scenes):
        for members in alike:
            poses = np.array([_still_pose(scene, int(body)) for body in geometry.body[members]])
            key = members.tobytes(), poses.tobytes()
            if key not in known:
                hole = hole_in(geometry, members, poses)
                known[key] = np.inf if hole is None else 2 * float(hole.finest.min())
            found[number] = min(found[number], scale[members[0]] * known[key])
    return found


def _still_pose(scene: Scene, body: int) -> np.ndarray:
    """Gives the pose [7] of a body that stands still, or of the world."""
    path = scene.bodies[body].trajectory if body != WORLD else None
    return se3.IDENTITY if path is None else path.pose(np.zeros(1, np.int64))[0]


def hole_in(geometry: Geometry, members: np.ndarray, poses: np.ndarray) -> Hole | None:
    """Measures how wide the gaps between some instances are, whose bodies are at these poses [n, 7] in the frame of the
    first one's; None without any."""
    corners = []
    for instance, pose in zip(members, poses):
        own = slice(geometry.first[instance], geometry.first[instance + 1])
        points = geometry.vertices[geometry.triangles[own]].astype(np.float64).reshape(-1, 3)
        placed = points @ geometry.rotation[instance].T + geometry.translation[instance]
        corners.append(se3.transform(pose, placed))
    points = np.concatenate(corners)
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    finest = finest_hole(Mesh(points, np.arange(len(points)).reshape(-1, 3)))
    if not np.isfinite(finest).any():
        return None
    return Hole(int(geometry.body[members[0]]), (low + high) / 2, (high - low) / 2, finest)


def _boxes_of(holes: Sequence[Hole], movers: np.ndarray) -> Any:
    """Makes Boxes of them, on the host."""
    boxes, bodies = Boxes(), np.array([hole.body for hole in holes])
    with wp.ScopedDevice("cpu"):
        boxes.mover = wp.array(np.searchsorted(movers, bodies).astype(np.int32), dtype=wp.int32)
        boxes.rotation = wp.array(np.tile(np.eye(3), (len(holes), 1, 1)), dtype=wp.mat33d)
        boxes.translation = wp.array(np.array([hole.middle for hole in holes]), dtype=wp.vec3d)
        boxes.half = wp.array(np.array([hole.half for hole in holes]), dtype=wp.vec3d)
        boxes.fine = wp.array(np.array([np.minimum(hole.finest, hole.half) for hole in holes]), dtype=wp.vec3d)
    return boxes
