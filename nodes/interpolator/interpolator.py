"""Keyframes in, frames at K times the rate out: the interpolator without bus and files."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from evis.clock import subframe_stamps
from nodes.interpolator import splat
from nodes.interpolator.keyframe import Method, Report, View, device_named
from nodes.interpolator.luminance import luminance_of
from nodes.interpolator.passthrough import Passthrough, crop

NEEDS: dict[str, frozenset[str]] = {"splat": splat.NEEDS, "none": frozenset()}
"""Images of a keyframe that a method uses besides the radiance."""

Allocate = Callable[[tuple[int, ...]], np.ndarray]


def new_frames(shape: tuple[int, ...]) -> np.ndarray:
    """Frames in memory of their own."""
    return np.empty(shape, np.float32)


class Interpolator:
    """The stream of one camera's keyframes. It remembers the last one; the caller keeps that one's arrays valid."""

    def __init__(
        self, method: str, upsampling: int, *, colour: bool = False, device: str = "cpu", threads: int = 1
    ) -> None:
        """method: `splat` or `none`. upsampling: K. colour: frames are linear RGB instead of luminance."""
        if method not in NEEDS or upsampling < 1:
            raise ValueError(f"interpolator method '{method}' with upsampling {upsampling}: splat or none, 1 or more")
        self.upsampling = 1 if method == "none" else upsampling
        self._needs = NEEDS[method]
        self._colour = colour
        self._device = device_named(device)
        self._threads = threads
        self._method: Method | None = None
        self._size: tuple[tuple[int, ...], int] | None = None
        self._last: View | None = None
        self._stamp = 0
        self._episodes = np.zeros(0, np.int32)
        self.report = Report()

    def push(
        self,
        stamp_ns: int,
        episodes: np.ndarray,
        radiance: np.ndarray,
        depth: np.ndarray | None,
        motion: np.ndarray | None,
        margin: int = 0,
        allocate: Allocate = new_frames,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Frames of the gap that ends with this keyframe.

        radiance: float32 or float16 [E, H, W, 3]. depth: float32 [E, H, W] m. motion: float32 [E, H, W, 2] px. margin:
        pixels beyond the image on every side. allocate: gives the array of a shape to write the frames into.
        Returns (stamps int64 [K] ns, frames float32 [E, K, h, w] or, in colour, [E, K, h, w, 3]); K = 1 where all
        environments begin an episode. Environments that begin one while others go on hold this keyframe in all K
        frames. `report` tells what was filled. Raises ValueError.
        """
        envs, height, width, _ = radiance.shape
        if min(height, width) <= 2 * margin:
            raise ValueError(f"keyframe of {width}x{height} px is no larger than its margin of {margin} px per side")
        if self._size not in (None, (radiance.shape, margin)):
            raise ValueError(f"keyframe is {radiance.shape} with margin {margin}, before it was {self._size}")
        self._size = (radiance.shape, margin)
        view = View(self._image(radiance), self._use("depth", depth), self._use("motion", motion))
        held = np.ones(envs, bool) if self._last is None else np.asarray(episodes) != self._episodes
        begins = bool(held.all())
        stamps = np.array([stamp_ns]) if begins else subframe_stamps(self._stamp, stamp_ns, self.upsampling)
        if not begins and stamp_ns <= self._stamp:
            raise ValueError(f"keyframe at {stamp_ns} ns came after the one at {self._stamp} ns of the same episode")
        tail = (3,) if self._colour else ()
        out = allocate((envs, len(stamps), height - 2 * margin, width - 2 * margin, *tail))
        if begins or self._last is None:
            crop(view, margin, out)
            self.report = Report()
        else:
            if self._method is None:
                self._method = self._build(envs, height, width, margin)
            self.report = self._method.between(self._last, view, held, out)
        self._last, self._stamp, self._episodes = view, stamp_ns, np.array(episodes)
        return stamps, out

    def warm_up(self) -> None:
        """Compile the kernels now rather than at the first keyframe."""
        tiny = Interpolator("splat" if self._needs else "none", 2, colour=self._colour, device=str(self._device))
        for stamp in (0, 2):
            for dtype in (np.float16, np.float32):
                tiny._image(np.ones((1, 4, 4, 3), dtype))
            radiance, depth, motion = (np.ones((1, 4, 4, *tail), np.float32) for tail in ((3,), (), (2,)))
            tiny.push(stamp, np.zeros(1, np.int32), radiance, depth, motion)

    def _build(self, envs: int, height: int, width: int, margin: int) -> Method:
        if not self._needs:
            return Passthrough(margin)
        channels = 3 if self._colour else 1
        return splat.make_splat(
            height, width, envs, self.upsampling, margin, channels, str(self._device), self._threads
        )  # fmt: skip

    def _use(self, name: str, image: np.ndarray | None) -> wp.array | None:
        if name not in self._needs:
            return None
        if image is None:
            raise ValueError(f"the splat interpolator needs {name} with every keyframe")
        return wp.array(image, dtype=wp.float32, device=self._device, copy=False)

    def _image(self, radiance: np.ndarray) -> wp.array:
        """What is warped: luminance, or RGB, in float32 on the device."""
        if self._colour:
            return wp.array(radiance.astype(np.float32, copy=False), dtype=wp.float32, device=self._device, copy=False)
        return luminance_of(radiance, self._device)
