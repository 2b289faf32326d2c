"""Counts what coded frames (of videos and images) cannot tell the sensor while they pass, and says it at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.cli.events.repeats import Repeats
from evis.media.frames.ends import end_counts
from evis.media.frames.source import FrameBlock
from evis.media.frames.tone import Tone

FAR_NS = 5_000_000
"""Frames further apart are said to be far."""
NEAR_NS = 50_000
"""Frames nearer than this are said to be near: those of 20 Hz and more are so if their times are in us."""
WORTH = 0.001
"""Shares of pixels below this are reported but not warned of."""


class Coding:
    """Counts pixels at the ends of the code and in its coarse part.

    A step of the code is coarse where ln I changes by more than a threshold, the dark level included. as_stored: times
    are those of the files, and may be in another unit.
    """

    def __init__(self, tone: Tone | None, threshold: float, dark_level: float, as_stored: bool) -> None:
        self._tone, self._threshold, self._dark = tone, threshold, dark_level
        self._pixels = self._black = self._full = self._coarse = self._samples = self._frames = 0
        self._level: float | None = None
        self._code = 0
        self._first_ns = self._last_ns = 0
        self._repeats, self._as_stored = Repeats(), as_stored

    def add(self, block: FrameBlock, bits: int | None) -> None:
        """Counts a block of frames. bits: of a code, None where frames are not coded."""
        if not self._frames:
            self._first_ns = int(block.t[0])
        self._frames, self._last_ns = self._frames + len(block.t), int(block.t[-1])
        if block.ends is None or bits is None or self._tone is None:
            return
        self._repeats.add(block.image)
        for name, n in zip(("_pixels", "_black", "_full"), end_counts(block.ends)):
            setattr(self, name, getattr(self, name) + n)
        if self._level is None:
            self._code, self._level = self._coarse_below(self._tone, bits)
        self._samples += block.image.size
        self._coarse += int(np.count_nonzero(block.image < self._level))

    def _coarse_below(self, tone: Tone, bits: int) -> tuple[int, float]:
        """The first code above which no step is coarse, and its radiance."""
        codes = np.arange(1 << bits) / ((1 << bits) - 1)
        with np.errstate(divide="ignore"):
            steps = np.diff(np.log(tone.decode(codes) + self._dark))
        coarse = np.flatnonzero(steps > self._threshold)
        code = int(coarse[-1]) + 1 if len(coarse) else 0
        return code, float(tone.decode(codes[code]))

    def report(self) -> dict[str, Any]:
        """Reports the shares of pixels that were black, at full scale or coarsely coded, for a summary."""
        if not self._pixels:
            return {}
        black, full, coarse = self._shares()
        return {
            "black_share": round(black, 6),
            "full_scale_share": round(full, 6),
            "coarse_share": round(coarse, 6),
        } | self._repeats.report()

    def _shares(self) -> tuple[float, float, float]:
        pixels = max(self._pixels, 1)
        return self._black / pixels, self._full / pixels, self._coarse / max(self._samples, 1)

    def warnings(self, upsampled: bool) -> list[str]:
        """Says in sentences what cannot be had from these frames."""
        black, full, coarse = self._shares()
        said = []
        if full > WORTH:
            said.append(
                f"{100 * full:.1f} % of the pixels are at full scale: what was brighter there is lost, with its events"
            )
        if black > WORTH:
            said.append(f"{100 * black:.1f} % of the pixels are code 0: light and noise in the dark are lost there")
        if coarse > max(WORTH, black):
            said.append(
                f"{100 * coarse:.1f} % of the pixels are below code {self._code}, where one step of the code is more "
                "than a threshold: events there are the coding's; a larger --dark-level hides them"
            )
        apart = (self._last_ns - self._first_ns) / max(self._frames - 1, 1)
        if self._pixels and apart > FAR_NS and not upsampled:
            said.append(
                f"frames are {apart / 1e6:.3g} ms apart, and ln I goes straight from one to the next; --upsample auto "
                "makes frames between them along optical flow"
            )
        if self._as_stored and self._frames > 1 and apart < NEAR_NS:
            said.append(
                f"frames are {apart / 1000:.3g} us apart, {1e9 / apart:,.0f} a second; times must be in ns: multiply "
                "by 1000 those that are in us"
            )
        return said + self._repeats.warnings()
