"""Maps the device's clock to the host's by the offset and drift that the arrival times of data show."""

from __future__ import annotations

from collections import deque

import numpy as np

WINDOW_NS = 500_000_000
"""One point of the fit per window [ns of host time]."""
POINTS = 120
LEAST_SPAN_NS = 5_000_000_000
"""No drift is stated before the points span this much host time [ns]."""


class ClockMap:
    """Maps device time to host time: host = device + offset + drift * (device - reference).

    Data arrive late by an amount that varies and is never negative, so the least (host - device) of a window is the
    point that was delayed least; a line through those minima has the drift as its slope. What remains is the constant
    part of the delay (tens of us on USB), which cannot be seen from one side.
    """

    def __init__(self) -> None:
        self._points: deque[tuple[int, int]] = deque(maxlen=POINTS)
        self._window_end = 0
        self._best: tuple[int, int] | None = None
        self._slope = 0.0

    def add(self, host_ns: int, device_ns: int) -> None:
        """Adds the arrival at host_ns of data whose newest device time is device_ns."""
        gap = host_ns - device_ns
        if self._best is None:
            self._window_end = host_ns + WINDOW_NS
            self._best = (device_ns, gap)
        elif gap < self._best[1]:
            self._best = (device_ns, gap)
        if host_ns >= self._window_end:
            self._points.append(self._best)
            self._best = None
            self._fit()

    def _fit(self) -> None:
        device = np.array([p[0] for p in self._points], np.float64)
        if len(device) < 3 or device[-1] - device[0] < LEAST_SPAN_NS:
            return
        gap = np.array([p[1] for p in self._points], np.float64)
        self._slope = float(np.polyfit(device - device[0], gap - gap[0], 1)[0])

    @property
    def known(self) -> bool:
        """Tells whether the offset is known: data have arrived."""
        return self._best is not None or bool(self._points)

    @property
    def drift_ppm(self) -> float:
        """Tells how much faster the host's clock runs than the device's [1e-6]; 0 until known."""
        return self._slope * 1e6

    @property
    def offset_ns(self) -> int:
        """Returns host - device at the newest point [ns]."""
        points = [*self._points, *([self._best] if self._best else [])]
        if not points:
            return 0
        newest = points[-1][0]
        # the least delayed point, carried to now along the drift
        return min(gap + round(self._slope * (newest - device)) for device, gap in points)

    def to_device(self, host_ns: int) -> int:
        """Returns the device time [ns] of a host time (monotonic clock)."""
        return host_ns - self.offset_ns
