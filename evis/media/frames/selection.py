"""Selects a part of a sequence of frames: a stretch of its time, a rectangle of its picture, in another size, slowed
down."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from evis.media.frames.resize import Resize
from evis.media.frames.source import FrameBlock, FramesError, FrameSource

MOST_SIDE = 65536
STRETCH = 0.02
"""Width over height may change by this share without a word."""


@dataclass(frozen=True)
class Selection:
    """Describes which part of a sequence is wanted.

    crop: x, y, width, height [px] of the source. width, height: of the frames [px]; one alone keeps the picture's
    proportions. start_ns, stop_ns: as the source plays, from its first frame on; stop is not included. slow_motion: the
    source plays so many times slower than the scene was, times are divided by it.
    """

    crop: tuple[int, int, int, int] | None = None
    width: int | None = None
    height: int | None = None
    start_ns: int = 0
    stop_ns: int | None = None
    slow_motion: float = 1.0

    def check(self) -> None:
        """Raises FramesError for a value out of range."""
        if self.start_ns < 0 or (self.stop_ns is not None and self.stop_ns < 0):
            raise FramesError("from and to are seconds from the first frame on, 0 or more")
        if self.stop_ns is not None and self.stop_ns <= self.start_ns:
            raise FramesError(
                f"from {self.start_ns / 1e9:g} to {self.stop_ns / 1e9:g} s: the end must be later than the start"
            )
        if not 1e-6 <= self.slow_motion <= 1e6:
            raise FramesError(f"slow-motion is {self.slow_motion:g}, must be above 0; 8 = played 8 times slower")
        for name, side in (("width", self.width), ("height", self.height)):
            if side is not None and not 1 <= side <= MOST_SIDE:
                raise FramesError(f"{name} is {side}, must be 1 to {MOST_SIDE} pixels")

    @property
    def is_all(self) -> bool:
        """Tells whether nothing is left out or changed."""
        return self == Selection()


class SelectedFrames(FrameSource):
    """Reads a part of another source, which it closes with itself."""

    def __init__(self, source: FrameSource, selection: Selection) -> None:
        """Raises FramesError where the source does not have that part."""
        selection.check()
        self._source, self._selection = source, selection
        self.kind, self.channels, self.about = source.kind, source.channels, source.about
        self.has_slopes, self.tone = source.has_slopes, source.tone
        self._whole_time = not selection.start_ns and selection.stop_ns is None
        self.count = source.count if self._whole_time else None
        x, y, width, height = selection.crop or (0, 0, source.width, source.height)
        if min(x, y) < 0 or min(width, height) < 1 or x + width > source.width or y + height > source.height:
            raise FramesError(
                f"crop {x},{y},{width},{height} is not inside the frames of {source.width}x{source.height}"
            )
        self._part = (slice(None), slice(y, y + height), slice(x, x + width))
        self.width, self.height = _size(selection, width, height)
        change = self.width * height / (self.height * width)
        self.stretched = change if abs(change - 1) > STRETCH else 1.0
        """How much wider against its height the picture is made; 1 where that is by less than STRETCH."""
        self._resize = None
        if (self.width, self.height) != (width, height):
            if self.has_slopes:
                raise FramesError("frames with dlog_dt cannot be resized; leave out the size, or take crossing cubic")
            self._resize = Resize((height, width), (self.height, self.width))

    def blocks(self) -> Iterator[FrameBlock]:
        """Yields the frames of the part. Raises FramesError where no frame is in it."""
        chosen, slow = self._selection, Fraction(self._selection.slow_motion)
        first: int | None = None
        last: int | None = None
        for block in self._source.blocks():
            first = int(block.t[0]) if first is None else first
            t = block.t - first
            low = np.searchsorted(t, chosen.start_ns)
            high = len(t) if chosen.stop_ns is None else np.searchsorted(t, chosen.stop_ns)
            if high > low:
                selected = self._selected(block, slice(low, high), slow)
                if (np.diff(selected.t) <= 0).any() or (last is not None and selected.t[0] <= last):
                    raise FramesError(f"slow-motion {float(slow):g} leaves frames less than 1 ns apart")
                last = int(selected.t[-1])
                yield selected
            if high < len(t):
                break
        if last is None and first is not None:
            end = "" if chosen.stop_ns is None else f" to {chosen.stop_ns / 1e9:g}"
            raise FramesError(f"from {chosen.start_ns / 1e9:g}{end} s: the source has no frame then")

    def _selected(self, block: FrameBlock, when: slice, slow: Fraction) -> FrameBlock:
        """Makes the frames `when` of a block: cut, resized, at the times of the scene."""
        t, image, slopes, ends = (None if a is None else a[when] for a in block)
        assert t is not None and image is not None
        image = image[self._part]
        if self._resize is not None:
            image = self._resize(image)
        if slopes is not None:
            slopes = np.ascontiguousarray(slopes[self._part] * np.float32(slow))
        if slow != 1:
            t = np.array([round(int(stamp) / slow) for stamp in t], np.int64)
        return FrameBlock(t, np.ascontiguousarray(image), slopes, None if ends is None else ends[self._part])

    def close(self) -> None:
        """Closes the source."""
        self._source.close()


def _size(selection: Selection, width: int, height: int) -> tuple[int, int]:
    """Gives width and height of the frames that are made of a picture of width x height."""
    w, h = selection.width, selection.height
    if w is None:
        return (width, height) if h is None else (max(1, round(width * h / height)), h)
    return w, max(1, round(height * w / width)) if h is None else h
