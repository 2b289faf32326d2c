"""Implements method `splat-quadratic`: the paper's warp along a parabola through three keyframes instead of a straight
line.

For what has no rigid poses: deforming meshes, or keyframes of which only depth and motion are known. Motion leads from
B's pixel to its place a in A, and A's motion from there to z in the keyframe before. With the gap A to B as the unit of
time and r the ratio of the gap before to it, the position at fraction f of the gap is Newton's

    q(f) = a + f v_1 + f (f - 1) c,    v_1 = p - a,    v_0 = (a - z) / r,    c = (v_1 - v_0) / (1 + r).

Its error is of third order in the gap, that of the straight line of second. A's own pixels, which fill B's holes, go on
along the parabola that they came on: q(f) = p + f v_0 + f (f + r) c. Where a is hidden in A, is not between four pixels
of one surface, or outside, or the velocity there is quite another one (as at a start, an impact, or on what hides it),
the path is straight; so is all of an episode's first gap, for nothing came before it.

It is kept for keyframes without poses of what turns or speeds up: the mean error of ln I of spinning_disk, 173x130 px,
at 62 keyframes per second x 16 is 0.017, that of `splat` 0.031. On the drone and in the warehouse they are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import KeyframeView, Report
from nodes.interpolator.splat import bend_kernels
from nodes.interpolator.splat.gap_before import GapBefore
from nodes.interpolator.splat.splat import make_splat


class Bends:
    """Keeps of one gap for the next the curvature of the paths that led to its end."""

    def __init__(self, shape: tuple[int, int, int], device: str) -> None:
        """Allocates the bends. shape: E, height and width of the keyframes [px]."""
        envs, height, width = shape
        self._shape, self._device = shape, device
        with wp.ScopedDevice(device):
            self._at_a, self._at_b = (wp.zeros((envs, height * width), dtype=wp.vec2) for _ in "AB")
            self._onward = wp.empty((*shape, 2), dtype=wp.float32)
        self._before = GapBefore(envs)

    def of(self, a: KeyframeView, b: KeyframeView, held: np.ndarray) -> tuple[wp.array, tuple[wp.array, wp.array]]:
        """Gives A's motion on to B, negated, and the bends of A's and of B's paths, wp.vec2 [E, H W] px."""
        before, gap, first = self._before.of(a, b, held)
        straight: wp.array = wp.array((first | held).astype(np.int32), device=self._device)
        given: list[Any] = [wp.array((before / gap).astype(np.float32), device=self._device), straight]
        self._at_a, self._at_b = self._at_b, self._at_a
        made = [self._at_a, self._onward]
        wp.launch(bend_kernels.extrapolate_paths, self._shape, [*given, a.motion], made, device=self._device)
        given += [b.depth, a.depth, b.motion, a.motion]
        wp.launch(bend_kernels.find_bends, self._shape, given, [self._at_b], device=self._device)
        return self._onward, (self._at_a, self._at_b)


class SplatQuadratic:
    """Warps E keyframes of the same size along parabolas."""

    def __init__(
        self,
        height: int,
        width: int,
        envs: int,
        upsampling: int,
        margin: int = 0,
        channels: int = 1,
        device: str = "cpu",
        threads: int = 1,
    ) -> None:
        """Takes what `make_splat` does."""
        self._splat: Any = make_splat(height, width, envs, upsampling, margin, channels, device, threads)
        self._bends = Bends((envs, height, width), device)

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """Implements `Method.between`. Views need `stamp_ns`."""
        onward, bends = self._bends.of(a, b, np.asarray(held, bool))
        return self._splat.between(replace(a, motion=onward), b, held, out, bends)
