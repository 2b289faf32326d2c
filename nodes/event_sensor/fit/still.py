"""Estimates a sensor's noise from a recording: from events where nothing moves, of pixels in the white and in the
black."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from evis.events.measure.noise import Noise
from nodes.event_sensor.fit.clip import Clip, Light

WINDOW_NS = 10_000_000
STILL_STEP_NS = 10_000_000
"""Between frames in which nothing moves."""
MARGIN_NS = 150_000_000
"""Left out before the motion."""
SETTLED_NS = 150_000_000
"""Left out after it, where nothing else is still."""
LEAST_NS = 100_000_000
BORDER_PX = 6.0
"""Left out on both sides of the border."""
HOT_FACTOR, HOT_EVENTS = 10.0, 5
"""A hot pixel has more than so many times the mean rate of its side, and more than so many events."""


@dataclass
class Side:
    """Holds pixels that see the same light [W/(sr m^2)] while nothing moves, hot ones apart.

    seconds: pixels times time; on, off: events; hot: rates of its hot pixels [Hz]; pixels: how many there are, hot
    ones included.
    """

    light: float
    seconds: float = 0.0
    on: int = 0
    off: int = 0
    pixels: int = 0
    hot: list[float] = field(default_factory=list)

    @property
    def rates(self) -> tuple[float, float]:
        """Computes the rates ON and OFF [Hz]."""
        return self.on / max(self.seconds, 1e-12), self.off / max(self.seconds, 1e-12)


@dataclass(frozen=True)
class NoiseFit:
    """Holds what a still scene tells of a sensor's noise. sensor: parameters; white, black: what was counted; rate: of
    the wheel's pixels while nothing moves [Hz], hot ones included."""

    sensor: dict[str, float]
    white: Side
    black: Side
    rate: float


def still_part(clip: Clip) -> tuple[int, int, int]:
    """Finds start and end [ns] of the longer time at which nothing moves, before the motion if that is long enough, and
    the time at which the border stands there."""
    first, last = int(clip.t[0]), int(clip.t[-1])
    before = (first, clip.wheel.start_ns - MARGIN_NS, clip.wheel.start_ns)
    after = (clip.wheel.end_ns + SETTLED_NS, last, clip.wheel.end_ns)
    return before if before[1] - before[0] >= LEAST_NS or before[1] - before[0] > after[1] - after[0] else after


def fit_noise(clips: Sequence[Clip], light: Light) -> NoiseFit:
    """Fits leak, shot noise and hot pixels to all clips together.

    Leak is what the white has more of ON than shot noise, whose share of ON is that of the black. Shot noise ends at
    the light at which a line through the rates of black and white is 0, and is such that its total is that of all.
    Where nothing is ever still, nothing is said.
    """
    white, black, all_white, all_black = (
        Side(light.white * (1 if bright else math.exp(-light.contrast))) for bright in (True, False, True, False)
    )
    events, seconds = 0, 0.0
    for clip in clips:
        counts, observed, beyond = _observed(clip)
        mask = clip.wheel.mask
        events, seconds = events + int(counts[:, mask].sum()), seconds + float(observed[mask].sum())
        for side, where in ((white, beyond > BORDER_PX), (black, beyond < -BORDER_PX)):
            _add(side, counts, observed, where & mask)
        for side, where in ((all_white, beyond > 0), (all_black, beyond <= 0)):
            _add(side, counts, observed, where & mask)
    sensor = _parameters(white, black) if seconds else {}
    if "shot_rate" in sensor:
        sensor["shot_rate"] = _shot_rate(sensor, (all_white, all_black))
    return NoiseFit(sensor, white, black, events / max(seconds, 1e-12))


def _shot_rate(sensor: dict[str, float], sides: tuple[Side, Side]) -> float:
    """Finds the shot noise with which all pixels, those at the border too, have as many events as were recorded."""
    seen = sum(side.on + side.off - sensor["leak_rate"] * side.seconds for side in sides)
    expected = sum(side.seconds * max(1 - side.light / sensor["shot_white"], 0.0) for side in sides)
    return max(seen, 0.0) / max(expected, 1e-12)


def _observed(clip: Clip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Counts OFF and ON events [2, H, W] and time [H, W, s] of each pixel while all around it was quiet, and its
    distance from the border [H, W, px]."""
    start, end, at = still_part(clip)
    left, top, width, height = clip.wheel.box
    noise = Noise(width, height)
    edges = np.arange(start, end + 1, WINDOW_NS)
    cuts = np.searchsorted(clip.t, edges)
    for k in range(len(edges) - 1):
        part = slice(cuts[k], cuts[k + 1])
        x, y = clip.x[part].astype(np.int64) - left, clip.y[part].astype(np.int64) - top
        noise.add(x, y, clip.p[part].astype(np.int64), WINDOW_NS)
    rows, columns = np.mgrid[top : top + height, left : left + width].reshape(2, -1).astype(np.float64)
    beyond = clip.wheel.beyond(np.array([at]), columns, rows).reshape(height, width)
    return *noise.maps(), beyond


def _add(side: Side, counts: np.ndarray, seconds: np.ndarray, where: np.ndarray) -> None:
    where = where & (seconds > 0)
    total = counts.sum(0)
    hot = np.zeros_like(where)
    for _ in range(3):  # each turn by the mean of what the one before has left
        usual = where & ~hot
        mean = total[usual].sum() / max(seconds[usual].sum(), 1e-12)
        hot = where & (total > HOT_FACTOR * mean * seconds) & (total > HOT_EVENTS)
    usual = where & ~hot
    side.seconds += float(seconds[usual].sum())
    side.off += int(counts[0][usual].sum())
    side.on += int(counts[1][usual].sum())
    side.pixels += int(where.sum())
    side.hot += (total[hot] / seconds[hot]).tolist()


def _parameters(white: Side, black: Side) -> dict[str, float]:
    (white_on, white_off), (black_on, black_off) = white.rates, black.rates
    share = black_on / (black_on + black_off) if black.on + black.off else 0.5
    for _ in range(20):  # leak is in the ON of both
        leak = max(white_on - white_off * share / max(1 - share, 1e-6), 0.0)
        share = min(max((black_on - leak) / max(black_on - leak + black_off, 1e-12), 0.0), 1.0)
    bright, dark = max(white_on + white_off - leak, 0.0), max(black_on + black_off - leak, 0.0)
    sensor = {"leak_rate": leak}
    if dark > 0:
        ratio = bright / dark
        # Where the white is no quieter than the black, a light is taken by which it would hardly show.
        end = (white.light - ratio * black.light) / (1 - ratio) if ratio < 0.9 else 10 * white.light
        sensor |= {"shot_rate": dark / (1 - black.light / end), "shot_white": end, "shot_on_share": share}
    hot = white.hot + black.hot
    if hot:
        sensor["hot_pixel_fraction"] = len(hot) / (white.pixels + black.pixels)
        sensor["hot_pixel_rate"] = float(np.mean(hot))
        if len(hot) > 4:
            sensor["hot_pixel_spread"] = float(np.std(np.log(hot)))
    return sensor
