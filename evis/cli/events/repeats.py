"""Counts frames that repeat the one before, as films have them that were brought to a higher rate than their own."""

from __future__ import annotations

import numpy as np

LONGEST = 4
"""Repeats in a row up to this many, between frames that change, are told of; in longer ones the scene is at rest."""
WORTH = 0.02
"""Shares of frames below this are reported but not warned of."""


class Repeats:
    """Counts repeats in short rows, with a change before and after: motion stands still there, and then jumps."""

    def __init__(self) -> None:
        self.frames = self.repeated = 0
        self._last: np.ndarray | None = None
        self._changed = False
        self._row = 0

    def add(self, images: np.ndarray) -> None:
        """Counts frames [K, ...] that follow those before."""
        self.frames += len(images)
        for image in images:
            if self._last is not None and np.array_equal(image, self._last):
                self._row += 1
            elif self._last is not None:
                self.repeated += self._row if self._changed and self._row <= LONGEST else 0
                self._changed, self._row = True, 0
            self._last = image
        # of the block only this one is kept
        self._last = None if self._last is None else self._last.copy()

    def report(self) -> dict[str, int]:
        """Reports the number of repeated frames, where there are any, for a summary."""
        return {"repeated_frames": self.repeated} if self.repeated else {}

    def warnings(self) -> list[str]:
        """Says what repeats do to the events, and how to be rid of them."""
        if self.repeated <= WORTH * self.frames:
            return []
        return [
            f"{self.repeated} of {self.frames} frames repeat the one before, at most {LONGEST} in a row: motion stands "
            "still there and then jumps; if the film was brought to this rate from a lower one, take the repeats out: "
            "ffmpeg -i IN -vf mpdecimate -fps_mode vfr OUT"
        ]
