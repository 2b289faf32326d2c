"""`splat` on a GPU: the same equations as on a CPU, all sub-frames of all environments in one scatter per direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from nodes.interpolator.cuda import kernels
from nodes.interpolator.kernels import EMPTY, Source
from nodes.interpolator.keyframe import Report, View

SCRATCH_BYTES = 1 << 30
"""Sub-frames are warped in portions whose scratch memory stays below this."""


class SplatCuda:
    """The warp for E keyframes of the same size. Frames equal those of the CPU but for float rounding."""

    def __init__(
        self, height: int, width: int, envs: int, upsampling: int, margin: int, channels: int, device: str = "cuda"
    ) -> None:
        """height, width: of the keyframe, margin included [px]. upsampling: K."""
        self._shape = (envs, height, width)
        self._upsampling = upsampling
        self._margin = margin
        self._channels = channels
        self._device = device
        pixels, padded = height * width, (height + 2) * (width + 2)
        subs = envs * (upsampling - 1)
        rows = max(1, min(subs, SCRATCH_BYTES // (padded * (16 + 12 * channels))))
        self._portions = [(first, min(rows, subs - first)) for first in range(0, subs, rows)]
        with wp.ScopedDevice(device):
            self._sources = [wp.empty((envs, pixels), dtype=Source) for _ in "AB"]
            self._nearest = [wp.empty((rows, padded), dtype=wp.float32) for _ in "AB"]
            self._peaks = wp.zeros((rows, padded, channels), dtype=wp.float32)
            self._sums = wp.zeros((rows, padded, channels), dtype=wp.int64)
            self._weights = wp.zeros((rows, padded), dtype=wp.int64)
            self._frames = wp.empty((envs * upsampling, pixels, channels), dtype=wp.float32)
            self._counters = [wp.zeros(1, dtype=wp.int32) for _ in range(2)]

    def between(self, a: View, b: View, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array) -> Report:
        """See Method."""
        envs, height, width = self._shape
        filled, lost = self._counters
        filled.zero_()
        lost.zero_()
        stays: wp.array = wp.array(np.asarray(held, np.int32), device=self._device)
        images = [view.image.reshape((envs, height * width, self._channels)) for view in (a, b)]
        for sources, sign, here, there in zip(self._sources, (-1.0, 1.0), (a, b), (b, a)):
            given = [sign, stays, here.depth, there.depth, here.motion]
            wp.launch(kernels.locate, self._shape, given, [sources, lost], device=self._device)
        by_env = self._frames.reshape((envs, self._upsampling, height * width, self._channels))
        wp.copy(by_env[:, self._upsampling - 1], images[1])
        for first, rows in self._portions:
            self._warp(first, rows, images, filled)
        m, channels = self._margin, self._channels
        frames = self._frames.reshape((envs * self._upsampling, height, width * channels))
        inner = frames[:, m : height - m, m * channels : (width - m) * channels]
        if isinstance(out, wp.array):
            wp.copy(out.flatten().view(wp.float32).reshape(inner.shape), inner)
        else:
            out[:] = inner.numpy().reshape(out.shape)
        return Report(int(filled.numpy()[0]), int(lost.numpy()[0]))

    def _warp(self, first: int, rows: int, images: list[wp.array], filled: wp.array) -> None:
        """One portion of sub-frames: B, then A into its holes, then the pixels that neither saw."""
        _, height, width = self._shape
        pixels = height * width
        nearest_a, nearest = self._nearest
        nearest.fill_(EMPTY)
        nearest_a.fill_(0.0)
        for backward, depths in ((1, nearest), (0, nearest_a)):
            sources, image = self._sources[backward], images[backward]
            place = [first, self._upsampling, backward, width, height, sources]
            wp.launch(kernels.lower_all, (rows, pixels), place, [depths], device=self._device)
            dim = (rows, pixels, self._channels)
            wp.launch(kernels.peak_all, dim, [*place, image, depths], [self._peaks], device=self._device)
            totals = [self._sums, self._weights]
            wp.launch(kernels.add_all, dim, [*place, image, depths, self._peaks], totals, device=self._device)
            wp.launch(
                kernels.resolve,
                (rows, pixels),
                [first, self._upsampling, width, backward],
                [nearest, nearest_a, self._peaks, *totals, self._frames],
                device=self._device,
            )
        given = [first, self._upsampling, width, height, self._margin, nearest, images[1]]
        wp.launch(kernels.fill, (rows, pixels), given, [self._frames, filled], device=self._device)
