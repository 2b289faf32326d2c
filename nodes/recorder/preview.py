"""A slow 8-bit image stream from keyframes."""

from __future__ import annotations

import numpy as np

from evis.bag.preview import tone_map
from evis.bag.selection import FIRST_ENV
from evis.bag.threads import ALONE, Threads
from msgs.camera import Image, Keyframe
from msgs.header import Header


class PreviewClock:
    """Says of which keyframes a preview is due, `rate_hz` of them a second in stamps and no more."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._due: tuple[int, int] | None = None

    def takes(self, header: Header) -> bool:
        """Says whether a preview of this keyframe is due; keyframes are asked about in their order.

        One that is not due changes nothing, so that it need not be asked about.
        """
        if self._due is None or self._due[0] != header.episode:
            self._due = (header.episode, header.stamp_ns)
        late = header.stamp_ns - self._due[1]
        if late < 0:
            return False
        # The next is due at a multiple of the period after the first, whatever the keyframe rate is.
        self._due = (header.episode, self._due[1] + self._period_ns * (late // self._period_ns + 1))
        return True


class PreviewMaker:
    """Makes images of one keyframe topic at no more than `rate_hz` in stamps. Environment 0 stands for all of them."""

    def __init__(self, keyframe_topic: str, rate_hz: float) -> None:
        self.camera = keyframe_topic.rsplit("/", 1)[0]
        self.count = 0
        self._clock = PreviewClock(rate_hz)

    def topic(self, keyframe: Keyframe) -> str:
        """Where the image belongs."""
        return f"{FIRST_ENV if len(keyframe.image) > 1 else ''}{self.camera}/image"

    def update(self, keyframe: Keyframe, threads: Threads = ALONE) -> Image | None:
        """The preview of this keyframe, None where none is due yet. threads: share its rows."""
        h = keyframe.header
        if not self._clock.takes(h) or not len(keyframe.image):
            return None
        m = keyframe.margin
        radiance = np.asarray(keyframe.rgb[0])
        cropped = radiance[m : radiance.shape[0] - m, m : radiance.shape[1] - m]
        image = Image(Header(h.stamp_ns, self.count, h.clock, h.episode), tone_map(cropped, threads=threads), "rgb8")
        self.count += 1
        return image
