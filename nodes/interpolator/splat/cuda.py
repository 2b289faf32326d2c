"""Implements `splat` on a GPU: the same equations as on a CPU, all sub-frames of all environments at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.cuda_graph import CudaGraphs
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.keyframe import KeyframeView, Report
from nodes.interpolator.splat import cuda_kernels, cuda_source_kernels

SCRATCH_BYTES = 1 << 30
"""Sub-frames are warped in portions whose scratch memory stays below this."""
BLOCK = 128
"""Threads of a block: with more of them the registers that they need leave room for too few on a GPU."""
PER_PIXEL = 40
"""Bytes of it, of one sub-frame."""

_launch: Any = partial(wp.launch, block_dim=BLOCK)


class Keyframe:
    """Holds one keyframe where the recorded launches read it, and what becomes of its pixels: see Sources."""

    def __init__(self, shape: tuple[int, int, int], frames: wp.array) -> None:
        """Allocates what a keyframe has. frames: of all environments [E, K, H, W] of float32 or vec3; the last of each
        is this keyframe."""
        envs, height, width = shape
        self._pixel: Any = frames.dtype
        channels = 1 if self._pixel is wp.float32 else 3
        pixels, padded = height * width, (height + 2) * (width + 2)
        s: Any = cuda_source_kernels.Sources()
        s.image = wp.empty((envs, pixels, channels), dtype=wp.float32)
        s.depth, s.motion = wp.empty(shape, dtype=wp.float32), wp.empty((*shape, 2), dtype=wp.float32)
        s.brightest = wp.zeros(envs, dtype=wp.int32)
        s.values = wp.empty((envs, pixels, channels), dtype=wp.int64)
        s.moves = wp.empty((envs, pixels), dtype=wp.vec4)
        s.still = wp.full((envs, padded), cuda_kernels.EMPTY, dtype=wp.float32)
        self.sources = s
        self._shape = shape
        self._seen = wp.zeros((envs, cuda_source_kernels.COPIES * cuda_source_kernels.EXPONENTS), dtype=wp.int32)
        own = (s.image if channels == 1 else s.image.view(wp.vec3)).reshape(shape)
        made = [s.depth, s.motion, frames, self._seen]
        # All but where the keyframe is stays the same: for a GPU that waits, every microsecond counts.
        given = [own, s.depth, s.motion]
        self._taking = _launch(cuda_source_kernels.take, math.prod(shape), given, [own, *made], record_cmd=True)

    def take(self, view: KeyframeView) -> None:
        """Copies a keyframe, also to the last frame."""
        assert view.depth is not None and view.motion is not None
        image: Any = view.image
        if self._pixel is not wp.float32:
            image = image.view(wp.vec3).reshape(self._shape)
        for index, given in enumerate((image, view.depth, view.motion)):
            self._taking.set_param_at_index(index, given)
        self._taking.launch()

    def find_brightest(self) -> None:
        """Finds the brightest value of the image, which sets the unit that sums are counted in."""
        brightest, seen = self.sources.brightest, self._seen
        brightest.zero_()
        _launch(cuda_source_kernels.find_brightest, seen.shape, [seen], [brightest], device=seen.device)
        seen.zero_()


class SplatCuda:
    """Warps E keyframes of the same size on a GPU. Frames equal those of the CPU but for float rounding."""

    def __init__(
        self, height: int, width: int, envs: int, upsampling: int, margin: int, channels: int, device: str = "cuda"
    ) -> None:
        """Allocates what a gap needs. height, width: of the keyframe, margin included [px]. upsampling: K."""
        self._shape = (envs, height, width)
        self._upsampling, self._margin = upsampling, margin
        self._device = wp.get_device(device)
        self._graphs = CudaGraphs(self._device)
        pixels, padded = height * width, (height + 2) * (width + 2)
        subs = envs * (upsampling - 1)
        rows = max(1, min(subs, SCRATCH_BYTES // (padded * PER_PIXEL)))
        self._portions = [(start, min(rows, subs - start)) for start in range(0, subs, rows)]
        with wp.ScopedDevice(self._device):
            pixel = pixel_type(channels)
            frames: wp.array = wp.empty((envs, upsampling, height, width), dtype=pixel)
            self._a, self._b = (Keyframe(self._shape, frames) for _ in "AB")
            self._chains = [_chains(rows, pixels, padded) for _ in "AB"]
            # Pixels beyond the image are no holes.
            self._nearest = wp.zeros((rows, padded), dtype=wp.float32)
            self._holes = wp.empty(rows * pixels, dtype=wp.int32)
            self._frames = frames.flatten().view(wp.float32).reshape((envs * upsampling, pixels, channels))
            whole = self._frames.reshape((envs * upsampling, height, width * channels))
            self._inner = whole[:, margin : height - margin, margin * channels : (width - margin) * channels]
            self._straight = wp.empty((0, 0), dtype=wp.vec2)
            self._held = wp.zeros(envs, dtype=wp.int32)
            self._counts = wp.zeros(2 + len(self._portions), dtype=wp.int32)
        self._told: wp.array = wp.zeros(2, dtype=wp.int32, device="cpu", pinned=self._device.is_cuda)
        self._holds = np.zeros(envs, np.int32)
        self._at_b: KeyframeView | None = None
        self._even = True

    def between(
        self,
        a: KeyframeView,
        b: KeyframeView,
        held: Sequence[bool] | np.ndarray,
        out: np.ndarray | wp.array,
        bends: tuple[wp.array, wp.array] | None = None,
    ) -> Report:
        """Implements `Method.between`. bends: of A's and of B's paths, wp.vec2 [E, H W] px; straight ones without."""
        holds = np.asarray(held, np.int32)
        if not np.array_equal(holds, self._holds):
            self._held.assign(holds)
            self._holds = holds.copy()
        self._a, self._b = self._b, self._a
        self._even = not self._even
        if self._at_b is not a:
            self._a.take(a)
            self._a.find_brightest()
        self._b.take(b)
        self._at_b = b
        curved = bends or (self._straight, self._straight)
        key = (self._even, curved[0].ptr, curved[1].ptr)
        self._graphs.run(key, partial(self._warp, self._a, self._b, curved))
        self._hand_over(out)
        if self._device.is_cuda:
            wp.synchronize_stream(self._device.stream)
        filled, lost = self._told.numpy()
        return Report(int(filled), int(lost))

    def _warp(self, a: Keyframe, b: Keyframe, bends: tuple[wp.array, wp.array]) -> None:
        """Makes all frames of a gap: launches only, which a GPU may have recorded."""
        self._counts.zero_()
        b.find_brightest()
        for keyframe, curves in zip((a, b), bends):
            keyframe.sources.bends = curves
        given = [self._held, a.sources, b.sources]
        pixels, device = math.prod(self._shape), self._device
        _launch(cuda_source_kernels.locate, 2 * pixels, given, [self._counts[1:]], device=device)
        for k, (start, rows) in enumerate(self._portions):
            self._warp_portion(start, rows, a.sources, b.sources, self._counts[2 + k :])
        wp.copy(self._told, self._counts[:2])

    def _warp_portion(self, start: int, rows: int, a: Any, b: Any, count: wp.array) -> None:
        """Makes one portion of sub-frames: B, then A into its holes, then the pixels that neither saw."""
        _, height, width = self._shape
        device, dim = self._device, rows * height * width
        place = [start, self._upsampling, width]
        of_a, of_b = self._chains
        of_b.first.zero_()
        given = [*place, height, 1, b, self._nearest]
        _launch(cuda_kernels.link_all, dim, given, [of_b], device=device)
        made = [self._nearest, self._frames, self._holes, count]
        _launch(cuda_kernels.show_all, dim, [*place, b, of_b], made, device=device)
        given = [*place, height, 0, a, self._nearest]
        _launch(cuda_kernels.link_all, dim, given, [of_a], device=device)
        given = [*place, a, of_a, self._holes, count]
        made = [self._nearest, self._frames]
        _launch(cuda_kernels.show_holes, cuda_kernels.LIST_WORKERS, given, made, device=device)
        given = [*place, height, self._margin, self._nearest, b.image, self._holes, count]
        made = [self._frames, self._counts[:1], of_a.first]
        _launch(cuda_kernels.fill, cuda_kernels.LIST_WORKERS, given, made, device=device)

    def _hand_over(self, out: np.ndarray | wp.array) -> None:
        """Copies the frames, without their margin, to where they are wanted."""
        inner = self._inner
        if isinstance(out, wp.array):
            wp.copy(out.flatten().view(wp.float32).reshape(inner.shape), inner)
        else:
            out[:] = inner.numpy().reshape(out.shape)


def _chains(rows: int, pixels: int, padded: int) -> Any:
    """Makes empty chains for so many sub-frames."""
    chains: Any = cuda_kernels.Chains()
    chains.first = wp.zeros((rows, padded), dtype=wp.int32)
    chains.next = wp.zeros((rows, pixels), dtype=wp.int32)
    chains.landed = wp.zeros((rows, pixels), dtype=wp.int64)
    return chains
