"""Measures the noise of a sensor from any stream: events where all around is quiet, and pixels that never are.

A pixel is observed in a window while none of its eight neighbours has an event in it. The condition says nothing
about the pixel itself, so that the events it has in the observed time, over that time, are an unbiased estimate of the
rate of noise that is independent from pixel to pixel (leak, shot noise). What a moving edge causes comes in several
neighbouring pixels at once and is left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

HOT_FACTOR = 10.0
HOT_LIST = 20
_DENSE = 64
"""Pixels for an event from which a window is counted event by event."""


class Noise:
    """Collects windows of events of a sensor of width x height pixels."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (height, width)
        self._quiet = np.zeros((2, height, width), np.int64)
        self._total = np.zeros((height, width), np.int64)
        self._busy_ns = np.zeros((height, width), np.int64)
        """Time in which a pixel was not observed."""
        self._span_ns = 0

    def add(self, x: np.ndarray, y: np.ndarray, p: np.ndarray, length_ns: int) -> None:
        """Adds the events of one window (each [n]), of the given length [ns]."""
        height, width = self._size
        self._span_ns += length_ns
        at = y.astype(np.int64) * width + x
        if len(at) * _DENSE < height * width:
            # a window costs what its events do, not a whole image
            pixels, which = np.unique(at, return_inverse=True)
            near = _around(pixels, width, height)
            pairs = np.bincount(2 * which + p, minlength=2 * len(pixels)).reshape(-1, 2)
            alone = ~np.isin(pixels, near, assume_unique=True)
            self._total.reshape(-1)[pixels] += pairs.sum(1)
            self._busy_ns.reshape(-1)[near] += length_ns
            self._quiet.reshape(2, -1)[:, pixels[alone]] += pairs[alone].T
            return
        counts = np.bincount(p.astype(np.int64) * (height * width) + at, minlength=2 * height * width).reshape(
            2, height, width
        )
        both = counts.sum(0)
        self._total += both
        busy = neighbours_active(both > 0)
        self._busy_ns += busy * length_ns
        self._quiet += counts * ~busy

    def idle(self, length_ns: int) -> None:
        """Adds time without any event [ns]."""
        self._span_ns += length_ns

    def maps(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the events of each pixel while all around was quiet, OFF and ON, int64 [2, H, W], and for how long
        that was, float64 [H, W, s]."""
        return self._quiet.copy(), (float(self._span_ns) - self._busy_ns) * 1e-9

    def report(self) -> dict[str, Any]:
        """Reports the noise. rate_hz: noise events per pixel and second, hot pixels left out; None where nothing was
        ever observed.

        A hot pixel has more than 10 times the mean rate of the others while all around is quiet, and so many events
        that chance does not explain it (five standard deviations of a Poisson count).
        """
        quiet = self._quiet.sum(0)
        span = self._span_ns * 1e-9
        seconds_of = (float(self._span_ns) - self._busy_ns) * 1e-9
        observed = seconds_of > 0
        if not observed.any():
            return {"rate_hz": None, "on_rate_hz": None, "off_rate_hz": None, "observed_share": 0.0, "hot_pixels": None}
        hot = np.zeros(self._size, bool)
        for _ in range(4):  # each turn judges by the mean of what the one before has left
            kept = observed & ~hot
            mean = quiet[kept].sum() / max(seconds_of[kept].sum(), 1e-12)
            expected = mean * seconds_of
            found = (quiet > HOT_FACTOR * expected) & (quiet > expected + 5 * np.sqrt(expected) + 5)
            if (found == hot).all():
                break
            hot = found
        kept = observed & ~hot
        seconds = seconds_of[kept].sum()
        off, on = (float(part[kept].sum() / seconds) if seconds else None for part in self._quiet)
        rows, columns = np.nonzero(hot)
        order = np.argsort(-quiet[rows, columns], kind="stable")[:HOT_LIST]
        worst = [
            {
                "x": int(columns[i]),
                "y": int(rows[i]),
                "rate_hz": float(self._total[rows[i], columns[i]] / max(span, 1e-12)),
            }
            for i in order
        ]
        return {
            "rate_hz": None if on is None or off is None else on + off,
            "on_rate_hz": on,
            "off_rate_hz": off,
            "observed_share": float(seconds_of.sum() / max(span * hot.size, 1e-12)),
            "hot_pixels": {"count": int(hot.sum()), "worst": worst},
        }


def _around(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Places [n, y * width + x] of all that have one of `pixels` as a neighbour, each once."""
    y, x = np.divmod(pixels, width)
    found = []
    for dy, dx in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        inside = (y + dy >= 0) & (y + dy < height) & (x + dx >= 0) & (x + dx < width)
        found.append(pixels[inside] + dy * width + dx)
    return np.unique(np.concatenate(found))


def neighbours_active(active: np.ndarray) -> np.ndarray:
    """Tells whether any of the eight neighbours is active: bool [H, W] -> bool [H, W]."""
    padded = np.pad(active, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    sides = padded[:-2, 1:-1] | padded[2:, 1:-1]
    return rows[:, :-2] | rows[:, 2:] | sides
