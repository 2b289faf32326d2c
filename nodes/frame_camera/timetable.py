"""Computes when the images of one environment are exposed, in its own time, and what light of a gap between frames is
theirs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from evis.runtime.clock import NS, keyframe_stamp, rate
from nodes.frame_camera.exposure_control import ExposureControl
from nodes.frame_camera.parameters import Settings


@dataclass
class Exposure:
    """Holds image `number`, whose first row is exposed from `start` for `length` ns, its last until `end`.

    begun: some of its light has been gathered.
    """

    number: int
    start: int
    length: int
    end: int
    begun: bool = False


class Timetable:
    """Opens exposures as time goes on: image n begins at phase + n / rate, whatever the frames are."""

    def __init__(self, settings: Settings, rows: int) -> None:
        self._settings = settings
        self._readout = settings.line_delay_ns * (rows - 1)
        self._open: list[Exposure] = []
        self._next = 0
        self.control = ExposureControl(settings)

    def begin(self, stamp: int) -> int:
        """Begins an episode at an own stamp [ns]. Returns how many exposures it cuts off."""
        lost, self._open = sum(exposure.begun for exposure in self._open), []
        since = stamp - self._settings.phase_ns
        self._next = max(0, int(since * rate(self._settings.rate_hz) / NS) - 1)
        while self._start(self._next) < stamp:
            self._next += 1
        return lost

    def within(self, until: int) -> Iterator[Exposure]:
        """Yields the exposures that have light of the gap up to `until`, in order; those that end there are over.

        An exposure is opened when it is asked for: the image before it has been read out by then, if it was in time.
        """
        for exposure in list(self._open):
            yield exposure
        while (start := self._start(self._next)) < until:
            length = self.control.exposure_at(start)
            exposure = Exposure(self._next, start, length, start + length + self._readout)
            self._next += 1
            self._open.append(exposure)
            yield exposure

    def close(self, exposure: Exposure) -> None:
        """Takes an exposure that has ended off the list."""
        self._open.remove(exposure)

    @property
    def unfinished(self) -> int:
        """Counts the exposures that have begun and not ended."""
        return len(self._open)

    def _start(self, number: int) -> int:
        return self._settings.phase_ns + keyframe_stamp(number, self._settings.rate_hz)


def slots_for(settings: Settings, rows: int) -> int:
    """Counts the images that can be exposed at one time: with a rolling shutter the first rows begin again early.

    Raises ValueError for a rolling shutter that is still at the rows of one image when the next is due: a sensor reads
    out one row at a time.
    """
    readout, period = settings.line_delay_ns * rows, int(NS / rate(settings.rate_hz))
    if readout > period:
        raise ValueError(
            f"rolling_shutter_us is {settings.line_delay_ns * 1e-3:.9g} us, which for {rows} rows is "
            f"{readout * 1e-6:.9g} ms; images at image_rate {settings.rate_hz:g} Hz are {period * 1e-6:.9g} ms apart, "
            f"and rows are read out one after another: give {period // rows * 1e-3:.9g} us at most, or a lower "
            "image_rate"
        )
    span = (settings.exposure_ns or settings.longest) + settings.line_delay_ns * (rows - 1)
    return -(-span * rate(settings.rate_hz) // NS) + 1


def quadrature(t: np.ndarray, exposure: Exposure, line_delay_ns: int, rows: int) -> np.ndarray:
    """Computes the weights [s], float64 [R, K + 1], by which frames make the integral of light over an exposure.

    t: int64 [K + 1] ns, times of the frames, the first being where the gap begins. Between two of them light is linear
    in time, and the trapezoid over the part of each step that a row is exposed for is exact. R = 1 for a global
    shutter, else one for each row.
    """
    start = exposure.start + line_delay_ns * np.arange(rows if line_delay_ns else 1, dtype=np.int64)[:, None]
    earlier, later = t[None, :-1], t[None, 1:]
    begin = np.clip(start, earlier, later)
    end = np.clip(start + exposure.length, earlier, later)
    length = (end - begin).astype(np.float64)
    step = np.maximum(later - earlier, 1)
    share = ((begin - earlier) + (end - earlier)) / (2.0 * step)
    weights = np.zeros((len(start), len(t)))
    weights[:, :-1] = length * (1.0 - share)
    weights[:, 1:] += length * share
    return weights * 1e-9
