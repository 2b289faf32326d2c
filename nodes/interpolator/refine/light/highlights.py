"""Tells how close in time instants have to be for highlights that pass over what a pixel sees."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.runtime.clock import NS
from evis.scene.model import WORLD, Scene
from evis.scene.motion import may_turn
from nodes.interpolator.refine.light.curvature import curvature_of
from nodes.interpolator.refine.probing.frustum import frustum_slopes
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.materials.ggx import alpha_of
from nodes.renderer.raster.visibility import Visibility

TURNED = 75.0
"""How fast surfaces may turn [rad/s] for instants to be no farther apart than a highlight takes to pass by alpha: what
is smoother than a roughness of 0.2 is looked at more often than 0.3 ms asks for. How fast they do turn does not count
here: environments whose bodies turn otherwise share the instants, and those in which glossy things may not turn have
their own."""
CLOSEST_NS = 135_000.0
"""How close instants are for that, at most: with half of that three scenes lose less by 0.5 to 2 % of their events, for
a tenth to a third more time."""
HALF = 0.64
"""Angle of the half vector from the normal, of alpha, at which a GGX lobe has half of its greatest radiance: where
(1 + (angle / alpha)^2)^-2 is a half (Walter et al., Microfacet Models for Refraction through Rough Surfaces, 2007)."""
BRIGHT = 3.0
"""Angle of the half vector from the normal, of alpha, at which a lobe has a hundredth of its greatest radiance: over so
much of something round a highlight is bright."""
FEW = 0.003
"""How often a highlight on something round may pass a pixel unseen in a gap, on the average."""
LOOKED_AT = 64
"""Instants of a gap at which it is worked out how fast bodies turn."""


def tolerance_for(scene: Scene, tolerance_ns: float) -> float:
    """Gives the tolerance of time [ns] that the instants of a scene are chosen by: less than `tolerance_ns` where the
    sharpest highlights on what may turn ask for that. What a highlight does between two instants is lost, however
    roughly the time of a crossing is wanted."""
    # What stays as it is, or only shifts, has highlights that pass slowly.
    turning = [i for i in scene.instances if i.body != WORLD and may_turn(scene.bodies[i.body].trajectory)]
    alphas = [alpha_of(scene.materials[i.material]) for i in turning]
    alphas = [alpha for alpha in alphas if alpha >= 0]
    if not alphas or not (scene.lights or scene.environment_map is not None):
        return tolerance_ns
    return min(tolerance_ns, max(min(alphas) / TURNED * NS, CLOSEST_NS) / 2)


class Highlights:
    """Finds the gaps in which highlights pass pixels between two instants: where something glossy turns so fast, or
    something glossy and round goes by so fast, or a camera over it."""

    def __init__(self, visibility: Visibility, movers: np.ndarray) -> None:
        """Finds what is glossy. movers: bodies that move, int64 [M]."""
        scene = visibility.scene
        shines = scene.lights or scene.environment_map is not None
        alphas = np.array([alpha_of(scene.materials[i.material]) if shines else -1.0 for i in scene.instances])
        sharpest: dict[int, float] = {}
        for instance, alpha in zip(scene.instances, alphas):
            if alpha >= 0 and instance.body in movers:
                sharpest[instance.body] = min(alpha, sharpest.get(instance.body, alpha))
        self._mover = np.searchsorted(movers, sorted(sharpest)).astype(np.int64)
        self._wide = 2 * HALF * np.array([sharpest[body] for body in sorted(sharpest)])
        self._round = Round(visibility, movers, alphas)

    def unseen(self, poses: Poses) -> np.ndarray:
        """Tells in which environments, bool [E], the radiance of a highlight may have fallen to half at the instant
        nearest to its peak. poses: at all instants of the gap."""
        last = len(poses.moved) - 2
        if last < 0:
            return np.zeros(poses.rest.shape[0], bool)
        first = np.linspace(0, last, min(last + 1, LOOKED_AT)).astype(np.int64)
        before, after = (poses.moved[first + k][:, :, self._mover, 3:] for k in (0, 1))
        turned = se3.angle(se3.multiply(se3.conjugate(before), after))
        return np.asarray((turned > self._wide).any(axis=(0, 2))) | self._round.unseen(poses, first)


class Round:
    """Finds what is glossy and round, and how often a pixel goes over it so fast that a highlight passes between two
    instants. A surface of curvature c turns by c for each metre that a pixel goes over it."""

    def __init__(self, visibility: Visibility, movers: np.ndarray, alphas: np.ndarray) -> None:
        """Finds the shapes. alphas: of each instance, below 0 of what has no highlights, float64 [I]."""
        geometry, view, camera = visibility.geometry, visibility.view, visibility.camera_body
        moves = np.isin(geometry.body, movers) | (camera in movers)
        which = np.flatnonzero((alphas >= 0) & moves & (geometry.body != camera))
        curved = np.array([curvature_of(geometry, n) for n in which.tolist()]).reshape(-1, 2)
        which, greater, lesser = (a[curved[:, 0] > 0] for a in (which, curved[:, 0], curved[:, 1]))
        self._radius = geometry.radius[which].astype(np.float64)
        self._across = 2 * HALF * alphas[which] / greater
        with np.errstate(divide="ignore"):
            self._length = np.minimum(2 * BRIGHT * alphas[which] / lesser, 2 * self._radius)
        self._body, self._middle = geometry.body[which], geometry.translation[which]
        self._movers, self._camera = movers, camera
        self._gain, self._pixels = max(view.fx, view.fy), view.width * view.height
        sides = np.abs(frustum_slopes(view) or np.full(4, np.inf)).reshape(2, 2).max(axis=1)
        self._corner = np.pi if np.isinf(sides).any() else float(np.arctan(np.hypot(*sides)))

    def unseen(self, poses: Poses, first: np.ndarray) -> np.ndarray:
        """Tells in which environments that is more than FEW, bool [E]. first: instants to look at, int64 [n]."""
        if not len(self._radius):
            return np.zeros(poses.rest.shape[0], bool)
        before, after = (self._seen(poses, first + k) for k in (0, 1))
        away = np.maximum(np.linalg.norm(before, axis=-1), self._radius)
        turned = np.arctan2(np.linalg.norm(np.cross(before, after), axis=-1), (before * after).sum(axis=-1))
        off = np.arctan2(np.linalg.norm(before[..., :2], axis=-1), before[..., 2])
        shown = off < self._corner + np.arcsin(self._radius / away)
        passed = np.where(shown & (turned * away > self._across), turned * self._length / away, 0.0)
        share = self._gain**2 / self._pixels * len(poses.moved) / len(first)
        return np.asarray(share * passed.sum(axis=(0, 2)) > FEW)

    def _seen(self, poses: Poses, which: np.ndarray) -> np.ndarray:
        """Gives where the shapes' middles are before the camera at some instants, float64 [n, E, shapes, 3] m."""
        envs = poses.rest.shape[0]
        world = np.broadcast_to(se3.IDENTITY, (len(which), envs, 1, 7))
        # The world's own shapes are on body -1.
        bodies = np.concatenate([np.repeat(poses.rest[None], len(which), axis=0), world], axis=2)
        bodies[:, :, self._movers] = poses.moved[which]
        eye = se3.inverse(bodies[:, :, self._camera])[:, :, None]
        return np.asarray(se3.transform(se3.compose(eye, bodies[:, :, self._body]), self._middle))
