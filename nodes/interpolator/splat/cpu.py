"""Implements `splat` on a CPU."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.runtime.workers import Workers
from nodes.interpolator.keyframe import KeyframeView, Report
from nodes.interpolator.splat.cpu_kernels import make_warp_gap
from nodes.interpolator.splat.cpu_source_kernels import collect, make_sources
from nodes.interpolator.splat.cpu_sum_kernels import make_scratch
from nodes.interpolator.splat.warp_kernels import Source


class SplatCpu:
    """Warps E keyframes of the same size on a CPU.

    Work is left out where nothing can change: pixels without motion are copied, only the box that moving pixels sweep
    is worked on, and A is warped only where B left holes.
    """

    def __init__(
        self, height: int, width: int, envs: int, upsampling: int, margin: int, channels: int, threads: int = 1
    ) -> None:
        """Allocates what a gap needs. height, width: of the keyframe, margin included [px]. upsampling: K. threads:
        share the K - 1 sub-frames."""
        self._shape = (envs, height, width)
        self._upsampling = upsampling
        self._margin = margin
        self._channels = channels
        chunks = min(threads, upsampling - 1)
        self._bounds = np.linspace(1, upsampling, chunks + 1).round().astype(int) if chunks > 0 else np.ones(1, int)
        self._pool = Workers(chunks) if chunks > 1 else None
        pixels, padded = height * width, (height + 2) * (width + 2)
        with wp.ScopedDevice("cpu"):
            self._still = [wp.empty((envs, padded), dtype=wp.float32) for _ in "AB"]
            self._sources = [wp.empty((envs, pixels), dtype=Source) for _ in "AB"]
            self._counts = [wp.zeros((envs, 6), dtype=wp.int32) for _ in "AB"]
            self._straight = wp.empty((0, 0), dtype=wp.vec2)
            self._filled = wp.zeros(envs * upsampling, dtype=wp.int32)
            self._scratch = [self._make_scratch(pixels, padded) for _ in range(chunks)]
        self._warp_gap = make_warp_gap(channels)
        self._keyframes: list[Any] = [make_sources(channels)() for _ in "AB"]
        for keyframe, still, sources, counts in zip(self._keyframes, self._still, self._sources, self._counts):
            keyframe.still, keyframe.sources, keyframe.counts = still, sources, counts
        # With a margin the frames are made here and cropped; without one, in the output itself.
        size = (envs, upsampling, height, width) + ((3,) if channels == 3 else ())
        self._frames = np.empty(size, np.float32) if margin else None

    def between(
        self,
        a: KeyframeView,
        b: KeyframeView,
        held: Sequence[bool] | np.ndarray,
        out: np.ndarray | wp.array,
        bends: tuple[wp.array, wp.array] | None = None,
    ) -> Report:
        """Implements `Method.between`. bends: of A's and of B's paths, wp.vec2 [E, H W] px; straight ones without."""
        out = out.numpy() if isinstance(out, wp.array) else out
        envs, height, width = self._shape
        stays: wp.array = wp.array(np.asarray(held, np.int32), device="cpu")
        bends = bends or (self._straight, self._straight)
        for index, sign, here, there in ((1, 1.0, b, a), (0, -1.0, a, b)):
            wp.launch(
                collect,
                envs,
                [sign, stays, here.depth, there.depth, here.motion, bends[index], self._counts[1]],
                [self._still[index], self._sources[index], self._counts[index]],
                device="cpu",
            )
        frames = out if self._frames is None else self._frames
        frames[:] = b.image.numpy()[:, None]
        for keyframe, view, bend in zip(self._keyframes, (a, b), bends):
            keyframe.image, keyframe.bends = self._values(view.image, (envs, -1)), bend
        given = [width, height, self._margin, *self._keyframes]
        made = [self._values(wp.array(frames, copy=False, device="cpu"), (envs * self._upsampling, -1)), self._filled]
        launches = [
            wp.launch(
                self._warp_gap,
                envs,
                [int(first), int(last), self._upsampling, *given, scratch],
                made,
                device="cpu",
                record_cmd=True,
            )
            for first, last, scratch in zip(self._bounds[:-1], self._bounds[1:], self._scratch)
        ]
        if self._pool is None:
            for launch in launches:
                launch.launch()
        else:
            list(self._pool.map(lambda launch: launch.launch(), launches))
        if self._frames is not None:
            m = self._margin
            out[:] = frames[:, :, m : height - m, m : width - m]
        lost = sum(int(counts.numpy()[:, 5].sum()) for counts in self._counts)
        return Report(int(self._filled.numpy().sum()), lost)

    def _make_scratch(self, pixels: int, padded: int) -> Any:
        """Makes what a thread works in."""
        scratch: Any = make_scratch(self._channels)()
        scratch.nearest, scratch.nearest_a = (wp.zeros(padded, dtype=wp.float32) for _ in range(2))
        scratch.sums = wp.zeros(padded, dtype=wp.vec2 if self._channels == 1 else wp.vec4)
        scratch.holes, scratch.hits = (wp.zeros(pixels, dtype=wp.int32) for _ in range(2))
        return scratch

    def _values(self, array: wp.array, shape: tuple[int, int]) -> wp.array:
        """Views the array with a pixel as one value: a float, or a vec3 in colour."""
        return (array if self._channels == 1 else array.view(wp.vec3)).reshape(shape)
