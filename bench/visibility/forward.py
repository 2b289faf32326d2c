"""Finds what sub-frames see from keyframes' depth and ids alone, without a raster: every pixel moves with its body."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from bench.visibility.kernels import make_project, repeat, settle
from nodes.interpolator.displacement_kernels import BodyMotion, displace
from nodes.renderer.raster.visibility import Visibility

FOOTPRINTS = {"1 px": (0, False), "3x3 px": (1, False), "3x3 px, into holes only": (1, True)}
"""Pixels beside its own that a point covers on every side, and whether only those that no point falls on."""


class Forward:
    """Makes z-buffers of P instants of one environment from those of the two keyframes around them.

    packed: Warp uint64 [P, H, W] on the device, as Visibility's but for entries without a triangle: SKY where the sky
    was moved to, HOLE where nothing was, and marks at what is beside a point's own pixel (bench.visibility.kernels).
    """

    def __init__(self, visibility: Visibility, instants: int, footprint: str) -> None:
        """visibility: of the scene and camera. footprint: one of FOOTPRINTS. Raises ValueError for a lens."""
        v = self._v = visibility
        if v.lens != "none":
            raise ValueError(f"camera {v.camera.name} has distortion {v.lens}: points are moved for a pinhole only")
        bodies = len(v.scene.bodies)
        self._project = make_project(*FOOTPRINTS[footprint])
        on = np.array([i.body if i.body >= 0 else bodies for i in v.scene.instances], np.int32)
        self._body = v.put(on, wp.int32)
        self._motions = v.empty((instants, bodies + 2), BodyMotion)
        self._then = v.empty((instants, bodies), wp.transformd)
        self.packed = v.empty((instants, *v.shape[1:]), wp.uint64)

    def draw(self, poses: wp.array, keyframes: list[tuple[wp.array, wp.array]]) -> None:
        """Fills `packed` for body poses transformd [P, N] from keyframes: launches only.

        keyframes: each a z-buffer uint64 [1, H, W] of the raster and its poses transformd [1, N].
        """
        v = self._v
        self.packed.view(wp.int64).fill_(-1)
        dim = (self.packed.shape[0], v.shape[1], v.shape[2] // v.span)
        for seen, place in keyframes:
            wp.launch(repeat, self._then.shape, [place], [self._then], device=v.device)
            given: list[Any] = [v.camera_body, self._then, poses]
            wp.launch(displace, self._motions.shape, given, [self._motions], device=v.device)
            given = [v.view, v.span, seen, v.triangle_instance, self._body, self._motions]
            wp.launch(self._project, dim, given, [self.packed], device=v.device)

    def settle(self, exact: wp.array) -> None:
        """Makes `packed` one of the raster's kind, its holes filled from `exact` [P, H, W]."""
        wp.launch(settle, self.packed.shape, [exact], [self.packed], device=self._v.device)
