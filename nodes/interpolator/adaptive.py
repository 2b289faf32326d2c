"""Adaptive K: as many frames in a gap as the image moves pixels, as in ESIM's rule for the flow (Rebecq et al., "ESIM:
an Open Event Camera Simulator", 2018, eq. 8), over the whole gap.

The displacement in a gap is its length times the largest speed in the image at either end, of any pixel and
environment. The speed is that over the last sub-step of the bodies where their states are known, so that a wheel which
turns by a whole turn per gap is seen to turn; otherwise that of the motion vectors, from keyframe to keyframe.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.interpolator.keyframe import KeyframeView
from nodes.renderer.renderer import Renderer

ROUNDING = 1 + 1e-5
"""Motion has 24 bits: 4 px are no more than four frames of 1 px."""


def counts_of(upsampling: int) -> list[int]:
    """Gives the K that gaps may have, ascending: upsampling and its halves, rounded up, down to 1; few, for each has
    its own memory."""
    counts = [upsampling]
    while counts[-1] > 1:
        counts.append(-(-counts[-1] // 2))
    return counts[::-1]


class AdaptiveCount:
    """Decides on the K of one gap after another."""

    def __init__(
        self, upsampling: int, most_px: float, device: str, scene: Scene | None, camera: Camera | None
    ) -> None:
        """upsampling: the largest K. most_px: displacement per frame that is allowed. scene, camera: where states are
        known."""
        self._counts, self._most, self._device = counts_of(upsampling), most_px, device
        self._scene, self._camera = scene, camera
        # What flickers changes without moving.
        self._always = scene is not None and any(light.waveform is not None for light in scene.lights)
        self._geometry: Renderer | None = None
        self._motion: wp.array | None = None
        self._speed = 0.0

    def begin(self) -> None:
        """Forgets the gap before, as an episode begins in all environments."""
        self._speed = 0.0

    def of(self, view: KeyframeView, gap_ns: int, held: np.ndarray) -> int:
        """Gives the K of the gap that ends with this keyframe; held: bool [E], environments that begin an episode
        there."""
        speed = self._by_states(view, held) if view.states is not None else self._by_motion(view, gap_ns, held)
        displacement = max(speed, self._speed) * gap_ns
        self._speed = speed
        if self._always or not np.isfinite(displacement):
            return self._counts[-1]
        return next((k for k in self._counts if displacement <= k * self._most * ROUNDING), self._counts[-1])

    def _by_motion(self, view: KeyframeView, gap_ns: int, held: np.ndarray) -> float:
        """px/ns, of the keyframe's motion vectors."""
        assert view.motion is not None
        return _largest(view.motion.numpy()[~held]) / gap_ns

    def _by_states(self, view: KeyframeView, held: np.ndarray) -> float:
        """px/ns over the last sub-step of the states."""
        assert view.states is not None and self._scene is not None and self._camera is not None
        states, t = view.states, view.states.t
        if len(t) < 2:
            return 0.0
        if self._geometry is None or self._motion is None:
            self._geometry = Renderer(self._scene, self._camera, len(states.pose), device=self._device)
            self._motion = wp.empty(self._geometry.shape, dtype=wp.vec2, device=self._device)
        now, before = (states.pose_at_step(n) for n in (-1, -2))
        self._geometry.render(now, before, ("motion",), {"motion": self._motion})
        motion = self._motion.numpy()
        if states.own_t is None:
            return _largest(motion[~held]) / int(t[-1] - t[-2])
        steps = states.own_t[:, -1] - states.own_t[:, -2]
        return max((_largest(motion[e]) / int(steps[e]) for e in np.flatnonzero(~held)), default=0.0)


def _largest(motion: np.ndarray) -> float:
    """The longest finite vector of [..., 2]."""
    squared = np.square(motion.astype(np.float64)).sum(-1)
    return float(np.sqrt(np.max(squared, where=np.isfinite(squared), initial=0.0)))
