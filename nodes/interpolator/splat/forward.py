"""`splat-forward`: the paper's warp with A's true motion across the gap in place of the motion of the gap before.

Equation (6) sends A's pixels on along the motion that they had in the previous gap, for a rendering engine knows no
more when it draws A. Here both keyframes and the bodies' poses at both are there, so A's pixels go where B's poses put
them: the straight line from A's pixel to its place in B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.interpolator import image_kernels
from nodes.interpolator.keyframe import KeyframeView, Report
from nodes.interpolator.splat.splat import make_splat
from nodes.renderer.renderer import Renderer


class SplatForward:
    """Warps E keyframes of one camera of a scene, of the same size."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        envs: int,
        upsampling: int,
        margin: int = 0,
        channels: int = 1,
        device: str = "cpu",
        threads: int = 1,
    ) -> None:
        """scene, camera: those of the renderer. upsampling: K. channels: 1 or 3."""
        self._geometry = Renderer(scene, camera, envs, margin, device, threads)
        _, height, width = self._geometry.shape
        self._splat = make_splat(height, width, envs, upsampling, margin, channels, device, threads)
        shape = self._geometry.shape
        self._motion = wp.empty(shape, dtype=wp.vec2, device=device)
        self._back = wp.empty((*shape, 2), dtype=wp.float32, device=device)

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """See Method."""
        assert a.states is not None and b.states is not None
        then, now = (view.states.end_pose for view in (b, a) if view.states is not None)
        # Motion is where a point was before minus where it is; with B as `before` it is the way that lies ahead.
        self._geometry.render(now, then, ("motion",), {"motion": self._motion})
        ahead = self._motion.view(wp.float32).reshape((*self._geometry.shape, 2))
        wp.launch(image_kernels.negated, ahead.size, [ahead.flatten()], [self._back.flatten()], device=ahead.device)
        return self._splat.between(replace(a, motion=self._back), b, held, out)
