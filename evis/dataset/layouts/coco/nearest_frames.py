"""Finds the annotated image that each frame of a camera belongs to."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from msgs.camera import Image

_MOST = 4096
"""Images that may wait for a frame; an exposure lasts no such number of keyframes."""


@dataclass
class _Annotated:
    number: int
    stamp_ns: int
    off_ns: int | None = None
    """How far from the stamp its frame is; None = it has none."""


class NearestFrames:
    """Finds for each frame the image whose stamp is nearest to the middle of its exposure.

    A frame is there when its exposure is over, which may be whole intervals later, so the images behind it wait.
    """

    def __init__(self) -> None:
        self._images: deque[_Annotated] = deque(maxlen=_MOST)
        self._ahead: list[Image] = []
        """Frames after the last image: the first, which may belong to it, and the last, to the one that comes."""

    def came(self, frame: Image) -> list[tuple[int | None, Image]]:
        """Takes a frame; returns frames with the numbers of their images, None for what belongs to none."""
        if self._images and frame.header.stamp_ns <= self._images[-1].stamp_ns:
            return [self._placed(frame)]
        self._ahead.append(frame)
        return [(None, self._ahead.pop(1))] if len(self._ahead) > 2 else []

    def annotated(self, number: int, stamp_ns: int) -> list[tuple[int | None, Image]]:
        """Takes a new image; returns as `came` does."""
        self._images.append(_Annotated(number, stamp_ns))
        return self.rest()

    def rest(self) -> list[tuple[int | None, Image]]:
        """Returns what is left, as `came` does."""
        frames, self._ahead = self._ahead, []
        return [self._placed(frame) for frame in frames]

    def _placed(self, frame: Image) -> tuple[int | None, Image]:
        if not self._images:
            return None, frame
        stamp_ns = frame.header.stamp_ns
        image = min(self._images, key=lambda image: abs(image.stamp_ns - stamp_ns))
        while self._images[0] is not image:  # later frames belong to this image or to later ones
            self._images.popleft()
        off_ns = abs(image.stamp_ns - stamp_ns)
        if image.off_ns is not None and image.off_ns <= off_ns:
            return None, frame
        image.off_ns = off_ns
        return image.number, frame
