"""Controls the exposure: it computes the exposure time of the next image from the levels of those before it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nodes.frame_camera.parameters import Settings

MOST_CHANGE = 8.0
"""Most by which one image changes the exposure: where it is saturated or black it says no more than up or down."""
_HALVINGS = 40


class ExposureControl:
    """Chooses exposure times [ns] of one environment. With a fixed exposure it does nothing."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._wanted = settings.exposure_ns or settings.shortest
        self._read: list[tuple[int, int]] = []
        """(end of the readout [ns], what it asks for [ns]) of images that were read out."""

    @property
    def automatic(self) -> bool:
        """Tells whether there is anything to choose."""
        return self._settings.exposure_ns == 0

    def first(self, light: np.ndarray) -> None:
        """Chooses the exposure that an episode begins with: that which the control would come to in this light.

        light: radiance or luminance of all pixels, of any shape.
        """
        self._read = []
        if not self.automatic:
            return
        s, sensor = self._settings, self._settings.sensor
        per_second = light.astype(np.float64).ravel() * sensor["image_sensitivity"] + sensor["dark_current"]
        levels = per_second[np.isfinite(per_second)] / sensor["full_well"]
        shortest, longest = np.log(s.shortest), np.log(s.longest)
        for _ in range(_HALVINGS):
            middle = 0.5 * (shortest + longest)
            mean = _level(levels * np.exp(middle) * 1e-9, sensor)
            shortest, longest = (middle, longest) if mean < s.target else (shortest, middle)
        self._wanted = self._limited(np.exp(longest))

    def exposure_at(self, start: int) -> int:
        """Gives the exposure of an image that begins at a time: what the newest image read out before it asks for."""
        while self._read and self._read[0][0] <= start:
            self._wanted = self._read.pop(0)[1]
        return self._wanted

    def read_out(self, end: int, length: int, level: float) -> None:
        """Takes the mean level, as share of full scale and without gamma, of an image exposed for `length` ns."""
        if not self.automatic:
            return
        s = self._settings
        black = s.sensor["black_level"]
        wanted, is_now = max(s.target - black, 1e-6), max(level - black, 1e-9)
        change = min(max(wanted / is_now, 1.0 / MOST_CHANGE), MOST_CHANGE)
        self._read.append((end, self._limited(length * change)))

    def _limited(self, length: float) -> int:
        return min(max(round(length), self._settings.shortest), self._settings.longest)


def _level(filled: np.ndarray, sensor: Mapping[str, Any]) -> float:
    """The mean of an image without noise, whose wells are filled to these shares."""
    level = np.minimum(filled, 1.0) * sensor["image_gain"] + sensor["black_level"]
    return float(np.minimum(level, 1.0).mean()) if level.size else 0.0
