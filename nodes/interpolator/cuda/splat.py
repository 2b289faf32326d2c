"""`splat` on a GPU: the same equations as on a CPU, all sub-frames of all environments in one scatter per direction."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import warp as wp

from nodes.interpolator.cuda import kernels
from nodes.interpolator.keyframe import Report, View
from nodes.renderer.recording import Recording

SCRATCH_BYTES = 1 << 30
"""Sub-frames are warped in portions whose scratch memory stays below this."""


class Images:
    """A keyframe where the recorded launches read it: image [E, H W, C], depth [E, H, W], motion [E, H, W, 2]."""

    def __init__(self, shape: tuple[int, int, int], channels: int) -> None:
        envs, height, width = shape
        self.image = wp.empty((envs, height * width, channels), dtype=wp.float32)
        self.depth = wp.empty(shape, dtype=wp.float32)
        self.motion = wp.empty((*shape, 2), dtype=wp.float32)

    def take(self, view: View) -> None:
        """Copy a keyframe."""
        assert view.depth is not None and view.motion is not None
        wp.copy(self.image, view.image.reshape(self.image.shape))
        wp.copy(self.depth, view.depth)
        wp.copy(self.motion, view.motion)


class SplatCuda:
    """The warp for E keyframes of the same size. Frames equal those of the CPU but for float rounding."""

    def __init__(
        self, height: int, width: int, envs: int, upsampling: int, margin: int, channels: int, device: str = "cuda"
    ) -> None:
        """height, width: of the keyframe, margin included [px]. upsampling: K."""
        self._shape = (envs, height, width)
        self._upsampling, self._margin, self._channels = upsampling, margin, channels
        self._device = wp.get_device(device)
        self._recording = Recording(self._device)
        pixels, padded = height * width, (height + 2) * (width + 2)
        subs = envs * (upsampling - 1)
        rows = max(1, min(subs, SCRATCH_BYTES // (padded * (16 + 16 * channels))))
        self._portions = [(first, min(rows, subs - first)) for first in range(0, subs, rows)]
        with wp.ScopedDevice(self._device):
            self._a, self._b = (Images(self._shape, channels) for _ in "AB")
            self._moves = [wp.empty((envs, pixels), dtype=wp.vec4) for _ in "AB"]
            self._still = [wp.full((envs, padded), kernels.EMPTY, dtype=wp.float32) for _ in "AB"]
            self._seen = wp.zeros((2, envs, kernels.EXPONENTS), dtype=wp.int32)
            self._brightest = wp.zeros((2, envs), dtype=wp.int32)
            self._nearest = [wp.empty((rows, padded), dtype=wp.float32) for _ in "AB"]
            self._sums = [wp.zeros((rows, padded, channels), dtype=wp.int64) for _ in range(2)]
            self._weights = wp.zeros((rows, padded), dtype=wp.int64)
            self._frames = wp.empty((envs * upsampling, pixels, channels), dtype=wp.float32)
            self._straight = wp.empty((0, 0), dtype=wp.vec2)
            self._held = wp.zeros(envs, dtype=wp.int32)
            self._counts = wp.zeros(2, dtype=wp.int32)
        self._holds = np.zeros(envs, np.int32)
        self._at_b: View | None = None
        self._even = True

    def between(
        self,
        a: View,
        b: View,
        held: Sequence[bool] | np.ndarray,
        out: np.ndarray | wp.array,
        bends: tuple[wp.array, wp.array] | None = None,
    ) -> Report:
        """See Method. bends: of A's and of B's paths, wp.vec2 [E, H W] px; straight ones without."""
        holds = np.asarray(held, np.int32)
        if not np.array_equal(holds, self._holds):
            self._held.assign(holds)
            self._holds = holds.copy()
        self._a, self._b = self._b, self._a
        self._even = not self._even
        if self._at_b is not a:
            self._a.take(a)
        self._b.take(b)
        self._at_b = b
        curved = bends or (self._straight, self._straight)
        key = (self._even, curved[0].ptr, curved[1].ptr)
        self._recording.run(key, partial(self._launch, self._a, self._b, curved))
        m, channels = self._margin, self._channels
        envs, height, width = self._shape
        frames = self._frames.reshape((envs * self._upsampling, height, width * channels))
        inner = frames[:, m : height - m, m * channels : (width - m) * channels]
        if isinstance(out, wp.array):
            wp.copy(out.flatten().view(wp.float32).reshape(inner.shape), inner)
        else:
            out[:] = inner.numpy().reshape(out.shape)
        filled, lost = self._counts.numpy()
        return Report(int(filled), int(lost))

    def _launch(self, a: Images, b: Images, bends: tuple[wp.array, wp.array]) -> None:
        """All frames of a gap: launches only, which a GPU may have recorded."""
        for counts in (self._counts, self._seen, self._brightest):
            counts.zero_()
        for k, (sign, here, there) in enumerate(((-1.0, a, b), (1.0, b, a))):
            given = [sign, k, self._held, here.depth, there.depth, here.motion, bends[k], here.image]
            made = [self._moves[k], self._still[k], self._seen, self._counts[1:]]
            wp.launch(kernels.locate, self._shape, given, made, device=self._device)
        given = [self._seen]
        wp.launch(kernels.find_brightest, self._seen.shape, given, [self._brightest], device=self._device)
        by_env = self._frames.reshape((self._shape[0], self._upsampling, *self._frames.shape[1:]))
        wp.copy(by_env[:, self._upsampling - 1], b.image)
        for first, rows in self._portions:
            self._warp(first, rows, (a.image, b.image), bends)

    def _warp(self, first: int, rows: int, images: tuple[wp.array, wp.array], bends: tuple[wp.array, wp.array]) -> None:
        """One portion of sub-frames: B, then A into its holes, then the pixels that neither saw."""
        _, height, width = self._shape
        pixels = height * width
        nearest_a, nearest = self._nearest
        given = [first, self._upsampling, self._still[1]]
        wp.launch(kernels.begin, nearest[:rows].shape, given, [nearest], device=self._device)
        totals = [*self._sums, self._weights]
        for backward, depths in ((1, nearest), (0, nearest_a)):
            image, still = images[backward], self._still[backward]
            place = [first, self._upsampling, backward, width, height, self._moves[backward]]
            place.append(bends[backward])
            wp.launch(kernels.lower_all, (rows, pixels), place, [depths], device=self._device)
            given = [*place, image, self._brightest, depths]
            wp.launch(kernels.add_all, (rows, pixels), given, totals, device=self._device)
            given = [first, self._upsampling, width, backward, image, still, self._still[0], self._brightest]
            made = [nearest, nearest_a, *totals, self._frames]
            wp.launch(kernels.resolve, (rows, pixels), given, made, device=self._device)
        given = [first, self._upsampling, width, height, self._margin, nearest, images[1]]
        wp.launch(kernels.fill, (rows, pixels), given, [self._frames, self._counts[:1]], device=self._device)
