"""Implements what sources of frames share: blocks of bounded size, checked times and sizes, the options of a reader."""

from __future__ import annotations

import abc
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from evis.media.colour import REC709
from evis.media.frames.tone import Tone

BLOCK_BYTES = 8_000_000
"""Frames per block are chosen to stay below this, so that a long video needs little memory."""
BLOCK_FRAMES = 32
PIXEL_BYTES = 12
"""What a pixel of an image takes in memory at least: linear R, G and B as float32."""
INT64_MAX = np.iinfo(np.int64).max
OF_SECONDS = "seconds become that by np.rint(1e9 * t).astype(np.int64)"
"""What to do with times that are not whole nanoseconds."""


class FramesError(ValueError):
    """Says that frames are missing, damaged or of a wrong kind. The text names the file and the remedy."""


class FrameBlock(NamedTuple):
    """Holds K frames of one camera.

    t: int64 [K] ns, strictly ascending. image: float32, linear luminance [K, H, W] or RGB [K, H, W, 3]. dlog_dt:
    float32 of the same shape, d ln(image)/dt [1/s], or None. ends: uint8 [K, H, W], flags of the pixels at an end of
    the code (evis.media.frames.ends), where options ask for them and the frames are coded.
    """

    t: np.ndarray
    image: np.ndarray
    dlog_dt: np.ndarray | None = None
    ends: np.ndarray | None = None


class NamedImage(NamedTuple):
    """Holds one image of a source: the name that an error should give it, t [ns], the image and its ends, or None."""

    name: str
    t: int
    image: np.ndarray
    ends: np.ndarray | None = None


@dataclass(frozen=True)
class FrameOptions:
    """Describes how frames are to be read.

    colour: RGB instead of luminance. slopes: read dlog_dt where there is one. fps: frames per second in place of the
    times that the files tell. tone, white: inverse tone curve of images of codes and of video, and the radiance of full
    scale. ends: flag the pixels at the ends of the code.
    """

    colour: bool = False
    slopes: bool = False
    fps: float | None = None
    tone: str | None = None
    white: float | None = None
    ends: bool = False

    def check(self) -> None:
        """Raises ValueError for a value out of range."""
        if self.fps is not None and not 1e-6 <= self.fps <= 1e9:
            raise FramesError(f"fps is {self.fps:g}, must be 1e-6 to 1e9 frames per second")

    def make_tone(self, told: str = "srgb", weights: tuple[float, float, float] = REC709) -> Tone:
        """Makes the inverse tone curve: the one given, or else that of which the file tells. weights: as of Tone."""
        return Tone(self.tone or told, 1.0 if self.white is None else self.white, weights)

    def refuse_tone(self, path: Path, what: str) -> None:
        """Raises where a tone curve is given for frames that are linear already."""
        if self.tone is not None or self.white is not None:
            raise FramesError(f"{path}: {what} is linear; a tone curve and white are for images of codes, and video")

    def stamp(self, index: int) -> int:
        """Returns the time of a frame at `fps` [ns], rounded once, so that it does not drift."""
        assert self.fps is not None
        return round(index * 1_000_000_000 / Fraction(self.fps))


class FrameSource(abc.ABC):
    """Reads a sequence of frames once, from start to end. A context manager."""

    kind: str
    width: int
    height: int
    channels: int
    count: int | None
    """Frames in all, None where the file does not tell."""
    has_slopes: bool = False
    tone: Tone | None = None
    """Curve that made linear light of codes, None where frames are not coded."""
    about: dict[str, Any]
    """What a report should tell: the tone curve, files left out."""

    @abc.abstractmethod
    def blocks(self) -> Iterator[FrameBlock]:
        """Yields all frames, in blocks of bounded size. Raises FramesError after the last good frame before a bad
        one.
        """

    def close(self) -> None:
        """Closes the file."""
        return

    def block_frames(self) -> int:
        """Returns the frames of one block."""
        size = 4 * self.width * self.height * self.channels * (2 if self.has_slopes else 1)
        return max(1, min(BLOCK_FRAMES, BLOCK_BYTES // size))

    def __enter__(self) -> FrameSource:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class ImageSource(FrameSource):
    """Checks and gathers single images, which `_images` yields, into blocks."""

    @abc.abstractmethod
    def _images(self) -> Iterator[NamedImage]:
        """Every frame."""

    def blocks(self) -> Iterator[FrameBlock]:
        images, length = self._checked(), self.block_frames()
        while True:
            stamps: list[int] = []
            gathered: list[np.ndarray] = []
            flags: list[np.ndarray] = []
            failure: Exception | None = None
            while len(stamps) < length:
                try:
                    _, t, image, ends = next(images)
                except StopIteration:
                    break
                except Exception as error:
                    # the frames before the bad one are still good
                    failure = error
                    break
                stamps.append(t)
                gathered.append(image)
                flags += [] if ends is None else [ends]
            if stamps:
                yield FrameBlock(
                    np.array(stamps, np.int64), np.stack(gathered), ends=np.stack(flags) if flags else None
                )
            if failure is not None:
                raise failure
            if len(stamps) < length:
                return

    def _checked(self) -> Iterator[NamedImage]:
        last: int | None = None
        for named in self._images():
            name, t, image, _ = named
            height, width = image.shape[:2]
            if (height, width) != (self.height, self.width):
                raise FramesError(f"{name}: {width}x{height}, the frames before are {self.width}x{self.height}")
            if abs(t) > INT64_MAX:
                raise FramesError(f"{name}: its time {t} ns does not fit int64")
            if last is not None and t <= last:
                raise FramesError(
                    f"{name}: its time {t} ns does not come after {last} ns of the frame before; --fps sets others"
                )
            last = t
            yield named
