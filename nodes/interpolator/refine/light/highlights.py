"""Tells how close in time instants have to be for highlights that pass over what a pixel sees."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.runtime.clock import NS
from evis.scene.model import WORLD, Scene
from evis.scene.motion import may_turn
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.materials.ggx import alpha_of

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
    """Finds the gaps in which something glossy turns so fast that its highlights pass pixels between two instants."""

    def __init__(self, scene: Scene, movers: np.ndarray) -> None:
        """Finds what is glossy and may turn. movers: bodies that move, int64 [M]."""
        sharpest: dict[int, float] = {}
        if scene.lights or scene.environment_map is not None:
            for instance in scene.instances:
                alpha = alpha_of(scene.materials[instance.material])
                if alpha >= 0 and instance.body in movers:
                    sharpest[instance.body] = min(alpha, sharpest.get(instance.body, alpha))
        self._mover = np.searchsorted(movers, sorted(sharpest)).astype(np.int64)
        self._wide = 2 * HALF * np.array([sharpest[body] for body in sorted(sharpest)])

    def unseen(self, poses: Poses) -> np.ndarray:
        """Tells in which environments, bool [E], the radiance of a highlight may have fallen to half at the instant
        nearest to its peak. poses: at all instants of the gap."""
        last = len(poses.moved) - 2
        if not len(self._mover) or last < 0:
            return np.zeros(poses.rest.shape[0], bool)
        first = np.linspace(0, last, min(last + 1, LOOKED_AT)).astype(np.int64)
        before, after = (poses.moved[first + k][:, :, self._mover, 3:] for k in (0, 1))
        turned = se3.angle(se3.multiply(se3.conjugate(before), after))
        return np.asarray((turned > self._wide).any(axis=(0, 2)))
