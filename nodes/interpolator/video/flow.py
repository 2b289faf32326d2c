"""Computes dense optical flow between two frames, both ways, and tells where the two agree.

Flow is that of DIS (Kroeger, Timofte, Dai, Van Gool, "Fast Optical Flow using Dense Inverse Search", ECCV 2016) as
OpenCV has it, the optional extra `video`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.media.colour import luminance_of, srgb_from_linear

STILL_PX = 0.1
"""Motion below this is noise of the estimate: the pixel is taken to stand still."""
SMALLEST = 32
"""Smaller pictures are continued to this many pixels a side: DIS needs some levels of its pyramid."""
MOVING_PX = 0.5
"""Pixels that move more than this count in the share that can be trusted; standing still is easily agreed on."""
BRIGHT_QUANTILE = 0.999
"""What is brighter than this share of both frames is cut off before flow is looked for, so that a lamp does not make
all else black."""


@dataclass(frozen=True)
class Flow:
    """Holds the motion between frames a and b.

    forward: float32 [H, W, 2] px, where each pixel of a goes. backward: the same from b to a. agrees_a, agrees_b: bool
    [H, W], forward and backward flow lead back to the same place.
    """

    forward: np.ndarray
    backward: np.ndarray
    agrees_a: np.ndarray
    agrees_b: np.ndarray

    @property
    def largest_px(self) -> float:
        """Gives the largest motion where both agree [px]; that of all pixels where they agree nowhere."""
        lengths = [np.linalg.norm(f, axis=2) for f in (self.forward, self.backward)]
        trusted = [length[ok] for length, ok in zip(lengths, (self.agrees_a, self.agrees_b)) if ok.any()]
        return float(max(part.max() for part in trusted or lengths))

    def moving(self) -> tuple[int, int]:
        """Counts the pixels of a that move, and those of them where both agree."""
        moves = np.linalg.norm(self.forward, axis=2) > MOVING_PX
        return int(moves.sum()), int((moves & self.agrees_a).sum())


class DenseFlow:
    """Finds the motion between frames. Raises ValueError where OpenCV is not installed."""

    def __init__(self) -> None:
        try:
            import cv2
        except ImportError:
            raise ValueError(
                "frames are upsampled with OpenCV's optical flow: pip install 'evis[video]', or give --upsample N with "
                "an --interpolator of your own"
            ) from None
        self._cv: Any = cv2
        self._dis = self._cv.DISOpticalFlow_create(self._cv.DISOPTICAL_FLOW_PRESET_MEDIUM)

    def between(self, a: np.ndarray, b: np.ndarray) -> Flow:
        """Finds the motion between two frames.

        Args:
            a, b: float32 [H, W] luminance or [H, W, 3] RGB, linear.
        """
        codes = _codes(*(luminance_of(image) if image.ndim == 3 else image for image in (a, b)))
        if (codes[0] == codes[1]).all():
            still, agrees = np.zeros((*a.shape[:2], 2), np.float32), np.ones(a.shape[:2], bool)
            return Flow(still, still.copy(), agrees, agrees)
        threads = self._cv.getNumThreads()
        self._cv.setNumThreads(1)  # the picture is divided among threads, and flow depends on how
        try:
            forward, backward = self._found(*codes), self._found(*codes[::-1])
        finally:
            self._cv.setNumThreads(threads)
        return Flow(forward, backward, self._agrees(forward, backward), self._agrees(backward, forward))

    def _found(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        pad = [(0, max(0, SMALLEST - n)) for n in a.shape]
        flow = self._dis.calc(*(np.pad(image, pad, mode="edge") for image in (a, b)), None)
        flow = np.ascontiguousarray(flow[: a.shape[0], : a.shape[1]])
        flow[np.linalg.norm(flow, axis=2) < STILL_PX] = 0.0
        return flow

    def _agrees(self, there: np.ndarray, back: np.ndarray) -> np.ndarray:
        """Tells where flow there and back agree, by equation (5) of Sundaram, Brox, Keutzer, ECCV 2010; false where the
        pixel leaves the picture."""
        height, width = there.shape[:2]
        y, x = np.mgrid[:height, :width].astype(np.float32)
        x, y = x + there[..., 0], y + there[..., 1]
        returned = self._cv.remap(back, x, y, self._cv.INTER_LINEAR, borderMode=self._cv.BORDER_REPLICATE)
        squares = (there**2).sum(axis=2) + (returned**2).sum(axis=2)
        inside = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
        agrees: np.ndarray = (((there + returned) ** 2).sum(axis=2) < 0.01 * squares + 0.5) & inside
        return agrees


def _codes(a: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """Converts both frames to 8 bits, of one scale, as an eye sees them: flow looks for equal brightness, in the dark
    too."""
    both = np.nan_to_num(np.stack([a, b]), nan=0.0, posinf=float(np.finfo(np.float32).max), neginf=0.0)
    full = float(np.quantile(both, BRIGHT_QUANTILE)) or float(both.max()) or 1.0
    return list((srgb_from_linear(np.clip(both / np.float32(full), 0, 1)) * 255 + 0.5).astype(np.uint8))
