"""Merges samples of pixels that are the mean of several, which are themselves sampled between frames."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.runtime.workers import edges_of
from nodes.interpolator.refine.samples.mean_kernels import Division, make_merge, make_subpixel_light
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.samples import Further

PART = 0.1
"""Tolerances of ln I within which samples of a mean are left out."""


class Means:
    """Merges the samples of the sub-pixels, of which each pixel is the mean, into those of pixels."""

    def __init__(self, rigid: Rigid, fineness: int, tolerance_ns: float) -> None:
        """Takes the sub-pixels' frames. rigid: of the sub-pixels. fineness: how many of these a pixel has per axis.
        tolerance_ns: as of `Refined`."""
        layout, (height, width) = rigid.layout, rigid.size
        division: Any = Division()
        division.fineness, division.coarse = fineness, layout.upsampling
        division.height, division.width = height // fineness, width // fineness
        division.margin, division.tolerance = rigid.visibility.margin, PART * layout.tolerance
        division.finest = max(round(tolerance_ns), 1)
        self._division, self._sampling = division, rigid.sampling
        self._device = rigid.visibility.device
        self._pixels = layout.envs * division.height * division.width
        cursor: wp.array = wp.empty(layout.envs * height * width, dtype=wp.int32, device=self._device)
        self._light: Any = make_subpixel_light(layout.channels)()
        self._light.cursor = cursor
        self._merge = make_merge(layout.channels)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        return [(self._merge, LAUNCH_BLOCK)]

    def of(
        self, found: Further, held: wp.array, since: wp.array, each: int, image: wp.array, frames: wp.array
    ) -> Further | None:
        """Gives the samples of the means, None without any.

        Args:
            found: samples of the sub-pixels.
            held: int32 [E], 1 for environments that have no gap.
            since: int32 [E, instants], ns from the gap's start to each instant.
            each: instants from one frame to the next.
            image: keyframe A, with its margin.
            frames: [E K, h, w].
        """
        self._division.each = each
        with wp.ScopedDevice(self._device):
            places = wp.zeros(self._pixels + 1, dtype=wp.int32)
            light = self._light
            light.image_a, light.frames = image, frames
            light.first, light.offset, light.value = found.first, found.offset, found.value
            given = [held, since, light, places]
            self._launch(0, [*given, found.offset, found.value])
            wp.utils.array_scan(places, places, inclusive=True)
            total = int(places[-1:].numpy()[0])
            if not total:
                return None
            offset, value = wp.empty(total, dtype=wp.int32), wp.empty(total, dtype=found.value.dtype)
            self._launch(1, [*given, offset, value])
        return Further(places, offset, value)

    def _launch(self, writes: int, given: list[Any]) -> None:
        """Counts the samples, or writes them: the same kernel, so that both find the same."""
        edges = edges_of(self._pixels, self._sampling.bands)
        self._sampling.launch([(self._merge, e - s, [s, self._division, writes, *given]) for s, e in pairwise(edges)])
