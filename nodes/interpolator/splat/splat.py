"""Implements method `splat`: the paper's bidirectional motion-vector warp, equations (5) to (7), with a hard z-buffer.

At fraction f = i/K of the gap, of length g, B's pixels go back along their motion and A's forward along their own of
the gap before, of length g', at the same speed: q_B = p + (1 - f) m_B(p), q_A = p - f (g / g') m_A(p), at the depth
(1 - f) Z_A + f Z_B along the correspondence, Z of the other keyframe being its nearest pixel there, or the source's own
where that is outside or sky. Of B's sources whose bilinear footprint covers a pixel, those within 1 % of the smallest
depth are averaged by their weights; A's fill only where B has none; a pixel that neither saw takes its nearest
background. Frame K is B itself.

On a CPU a serial scatter sums in the order of the sources; on a GPU sums are in whole numbers. Both give the same bytes
every time, and differ from each other by float rounding only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import KeyframeView, Method, Report
from nodes.interpolator.splat import pace_kernels
from nodes.interpolator.splat.cpu import SplatCpu
from nodes.interpolator.splat.gap_before import GapBefore


def make_splat(
    height: int,
    width: int,
    envs: int,
    upsampling: int,
    margin: int = 0,
    channels: int = 1,
    device: str = "cpu",
    threads: int = 1,
) -> Method:
    """Makes the warp of gaps that are as long as those before, on a device.

    height, width: of the keyframes, margin included [px]. upsampling: K. channels: 1 or 3.
    """
    if wp.get_device(device).is_cuda:
        from nodes.interpolator.splat.cuda import SplatCuda

        return SplatCuda(height, width, envs, upsampling, margin, channels, device)
    return SplatCpu(height, width, envs, upsampling, margin, channels, threads)


class Splat:
    """Warps keyframes between gaps of any lengths."""

    def __init__(self, splat: Method, envs: int) -> None:
        """Takes a method. splat: of `make_splat`, for E environments."""
        self._splat = splat
        self._before = GapBefore(envs)
        self._onward: wp.array | None = None

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """Implements `Method.between`. Views need `stamp_ns`."""
        before, gap, _ = self._before.of(a, b, np.asarray(held, bool))
        if (before == gap).all():
            return self._splat.between(a, b, held, out)
        assert a.motion is not None
        if self._onward is None:
            self._onward = wp.empty_like(a.motion)
        device = a.motion.device
        pace: wp.array = wp.array((gap / before).astype(np.float32), device=device)
        wp.launch(pace_kernels.go_on, a.motion.shape[:3], [pace, a.motion], [self._onward], device=device)
        return self._splat.between(replace(a, motion=self._onward), b, held, out)
