"""Tells how long the light of lamps that go past things is on a point: a beam over its width, the light of a lamp near
a surface over about its distance from there."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from nodes.interpolator.refine.probing.body_boxes import BodyBoxes
from nodes.renderer.lights.lights import fixed_vectors
from nodes.renderer.raster.visibility import Visibility

PART = 0.5
"""Of a lamp's distance from a surface, the way in which a look falls on its light: that is half as strong from 0.77
distances before the nearest point to as many after, so that there are three looks or more in it."""
BEAM = 1.0
"""The same of a spot's half-angle: its beam is on most points for less time than in its middle."""
PAIRS, MOST, FEWEST = 1 << 9, 32, 4
"""Pairs of a lamp and a box that are looked at in an environment over all times of a gap, at most, and such times, at
most and at least."""
ROUNDING = 1e-7
"""Error of an angle that comes of the cosine of its half [rad]."""
TINY = 1e-12
"""Of a ray's direction along a side of a box, from which on it counts as none."""


class PassingLamps:
    """Finds the shortest time for which light of a lamp is on a point of what it goes by, as the camera sees it.

    Lamp and thing move against each other, and lamp and camera too: what a still camera sees of a wheel beside a still
    lamp stays as it is, and so does what a lamp on the camera lights.
    """

    def __init__(self, visibility: Visibility, movers: np.ndarray) -> None:
        """Finds the pairs of lamps and things. movers: bodies that move, int64 [M]."""
        lights, camera = visibility.scene.lights, visibility.camera_body
        boxes = BodyBoxes(visibility, np.arange(len(visibility.geometry.body)))
        moves = np.isin([light.body for light in lights], movers)
        seen_to_move = moves | (camera in movers)
        placed = np.array([light.kind != "directional" for light in lights], bool)
        body = np.array([light.body for light in lights], np.int64)
        against = moves[:, None] | np.isin(boxes.body, movers)
        wanted = (seen_to_move & placed)[:, None] & against & (body[:, None] != boxes.body)
        # Of each pair the lamp and the box.
        of, box = np.nonzero(wanted.reshape(len(lights), len(boxes.body)))
        self.any = len(of) > 0
        at, axes, half_u, half_v = fixed_vectors(lights)
        spot = axes.any(axis=1)
        cones = np.array([light.cone[1] for light in lights])
        self._at, self._rays, self._spot = at[of], _rays(axes, np.where(spot, cones, 0.0))[of], spot[of]
        # Light of a wide lamp is on a point for as long as its shorter side takes at least.
        self._wide = 2.0 * np.minimum(np.linalg.norm(half_u, axis=1), np.linalg.norm(half_v, axis=1))[of]
        self._part = np.where(spot, np.minimum(BEAM * cones, PART), PART)[of]
        self._lamp, self._thing, self._camera = body[of], boxes.body[box], camera
        self._translation, self._rotation, self._half = boxes.translation[box], boxes.rotation[box], boxes.half[box]
        which, thing = np.unique(box, return_inverse=True)
        self._pairs = of, thing
        self._places_of = (body, at), (boxes.body[which], boxes.translation[which])
        """Of lamps, and of boxes that something goes by: which body they are on, and where on it [m]."""
        self._movers = movers

    def shortest(self, moved: np.ndarray, rest: np.ndarray, longest: np.ndarray) -> np.ndarray:
        """Gives that time, float64 [E] instants; inf where no lamp goes by.

        moved: poses of the movers at all instants, float64 [n, E, M, 7]. rest: of all bodies at one time, float64
        [E, N, 7]. longest: times that are of no interest any more, float64 [E] instants; in place of these it may be
        inf.
        """
        most = len(moved) - 1
        times = min(most, MOST, max(FEWEST, PAIRS // len(self._lamp)))
        first = np.linspace(0, most - 1, times).astype(np.int64)
        poses, later = (self._poses(moved[first + k], rest) for k in (0, 1))
        near = self._candidates(poses, later, longest)
        if not len(near):
            return np.full(len(rest), np.inf)
        at, seen = self._places(poses, near)
        # What trembles goes by nothing; of a single time that cannot be told.
        far = np.minimum(_extent(at), _extent(seen)) if times > 1 else np.full(at.shape[1:3], np.inf)
        beside = self._beside(at, near)
        passes = (far > self._wide[near] + self._part[near] * beside.min(axis=0)).any(axis=0)
        pairs = near[passes]
        if not len(pairs):
            return np.full(len(rest), np.inf)
        at, seen, far = at[:, :, passes], seen[:, :, passes], far[:, passes]
        ways = (np.linalg.norm(b - a, axis=-1) for a, b in zip((at, seen), self._places(later, pairs)))
        way = np.minimum(*ways)
        distance = np.where(self._spot[pairs], self._along(at, poses, pairs), beside[:, :, passes])
        width = self._wide[pairs] + self._part[pairs] * distance
        going = (far > width) & (way > 0.0)
        return np.where(going, width / np.maximum(way, 1e-30), np.inf).min(axis=(0, 2))

    def _candidates(self, poses: np.ndarray, later: np.ndarray, longest: np.ndarray) -> np.ndarray:
        """Gives the pairs, int64 [P], whose lamp may go by in less than `longest`, by how far the bodies go and turn
        from `poses` to `later` and the sphere about each thing."""
        (lamp, lamp_step, _), (middle, step, turn) = (_steps(poses, later, *places) for places in self._places_of)
        of, box = self._pairs
        apart = np.linalg.norm(lamp[:, :, of] - middle[:, :, box], axis=-1)
        # Seen from the thing the lamp goes as far as both do, and as the thing turns beneath it.
        shift = lamp_step[:, :, of] + step[:, :, box]
        way = shift + turn[:, :, box] * (apart + shift)
        near = np.maximum(apart - np.linalg.norm(self._half, axis=1), 0.0)
        return np.flatnonzero((way * longest[:, None] > self._wide + self._part * near).any(axis=(0, 1)))

    def _poses(self, moved: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Gives the poses of all bodies and, last, of the world, float64 [T, E, N + 1, 7], for those of the movers, [T,
        E, M, 7]."""
        world = np.broadcast_to(se3.IDENTITY, (*moved.shape[:2], 1, 7))
        poses = np.concatenate([np.repeat(rest[None], len(moved), axis=0), world], axis=2)
        poses[:, :, self._movers] = moved
        return poses

    def _places(self, poses: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gives where the lamps of pairs, int [P], are seen from their boxes and from the camera, float64 [T, E, P, 3]
        m each."""
        at = se3.transform(poses[:, :, self._lamp[pairs]], self._at[pairs])
        in_thing = se3.transform(se3.inverse(poses[:, :, self._thing[pairs]]), at) - self._translation[pairs]
        in_box = np.einsum("tepc,pcd->tepd", in_thing, self._rotation[pairs])
        return in_box, se3.transform(se3.inverse(poses[:, :, [self._camera]]), at)

    def _beside(self, at: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Gives how far places [..., P, 3] are from the nearest side of the boxes of pairs, float64 [..., P] m."""
        over = np.abs(at) - self._half[pairs]
        return np.linalg.norm(np.maximum(over, 0.0), axis=-1) + np.maximum(-over.max(axis=-1), 0.0)

    def _along(self, at: np.ndarray, poses: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Gives how far the nearest ray of each pair's lamp goes from places [T, E, P, 3] to its box, float64 [T, E, P]
        m; inf where none meets it. From within a box it is where the ray leaves it."""
        lamp, thing = poses[:, :, self._lamp[pairs], 3:], se3.conjugate(poses[:, :, self._thing[pairs], 3:])
        turn = se3.multiply(thing, lamp)[..., None, :]
        rays = np.einsum("teprc,pcd->teprd", se3.rotate(turn, self._rays[pairs]), self._rotation[pairs])
        step = np.where(np.abs(rays) < TINY, TINY, rays)
        half = self._half[pairs]
        sides = np.stack([(s * half - at)[..., None, :] / step for s in (-1.0, 1.0)])
        enters, leaves = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
        met = np.where(enters > 0.0, enters, leaves)
        return np.where(leaves >= np.maximum(enters, 0.0), met, np.inf).min(axis=-1)


def _steps(
    poses: np.ndarray, later: np.ndarray, body: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gives where places `at` [P, 3] m of bodies [P] are in the world, float64 [T, E, P, 3] m, how far they go, [T, E,
    P] m, and by which angle the bodies turn, rad, from `poses` to `later`."""
    before, after = poses[:, :, body], later[:, :, body]
    now, then = se3.transform(before, at), se3.transform(after, at)
    cosine = np.abs((before[..., 3:] * after[..., 3:]).sum(axis=-1))
    turn = 2.0 * np.arccos(np.minimum(cosine, 1.0)) + ROUNDING
    return now, np.linalg.norm(then - now, axis=-1), turn


def _extent(places: np.ndarray) -> np.ndarray:
    """Gives the diagonal of what holds places [T, E, P, 3] of all times, float64 [E, P] m."""
    return np.linalg.norm(np.ptp(places, axis=0), axis=-1)


def _rays(axes: np.ndarray, cones: np.ndarray) -> np.ndarray:
    """Gives directions [L, 5, 3] of beams about axes [L, 3]: the axis, and four at the edge of a half-angle [L] rad."""
    beside = np.eye(3)[np.abs(axes).argmin(axis=1)]
    u = np.cross(axes, beside)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-30)
    v = np.cross(axes, u)
    sine, cosine = np.sin(cones)[:, None], np.cos(cones)[:, None]
    return np.stack([axes, *(cosine * axes + sine * way for way in (u, -u, v, -v))], axis=1)
