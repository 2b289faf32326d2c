"""Makes 8-bit preview images of keyframes at a low rate."""

from __future__ import annotations

import numpy as np

from evis.bag.preview import tone_map
from evis.bag.selection import FIRST_ENV
from evis.bag.threads import ALONE, Threads
from evis.runtime.pacing import RateLimit
from msgs.camera import Image, Keyframe
from msgs.header import Header


class PreviewMaker:
    """Makes images of one keyframe topic at no more than `rate_hz` in stamps. Environment 0 stands for all of them."""

    def __init__(self, keyframe_topic: str, rate_hz: float) -> None:
        self.camera = keyframe_topic.rsplit("/", 1)[0]
        self.count = 0
        self._due = RateLimit(rate_hz)

    def topic(self, keyframe: Keyframe) -> str:
        """Returns the topic of the preview."""
        return f"{FIRST_ENV if len(keyframe.image) > 1 else ''}{self.camera}/image"

    def update(self, keyframe: Keyframe, threads: Threads = ALONE) -> Image | None:
        """Makes the preview of a keyframe, None where none is due yet. threads: share its rows."""
        h = keyframe.header
        if not self._due.takes(h) or not len(keyframe.image):
            return None
        m = keyframe.margin
        radiance = np.asarray(keyframe.rgb[0])
        cropped = radiance[m : radiance.shape[0] - m, m : radiance.shape[1] - m]
        image = Image(Header(h.stamp_ns, self.count, h.clock, h.episode), tone_map(cropped, threads=threads), "rgb8")
        self.count += 1
        return image
