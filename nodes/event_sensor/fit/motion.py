"""Estimates from a recorded motion a sensor's thresholds, corner frequency and its law, dead time and mismatch."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nodes.event_sensor.fit.clip import MANY_PIXELS, SOME_PIXELS, Clip, Light, simulate_motion
from nodes.event_sensor.fit.search import STEP, least_squares
from nodes.event_sensor.fit.statistics import BLUR, CHANCE, SCALES, differences
from nodes.event_sensor.parameters import SENSOR

UNKNOWN = ("threshold_on", "threshold_off", "bandwidth_hz", "threshold_mismatch")
"""Fitted as logarithms; thresholds relative to the contrast, the mismatch relative to the thresholds."""
START = (0.14, 0.16, 60.0, 0.08)
LOW = (0.02, 0.02, 3.0, 0.005)
HIGH = (0.8, 0.8, 20_000.0, 0.4)
LEAST_THRESHOLD = 1.01 * SENSOR["threshold_floor"].default
MOST_MISMATCH: float = SENSOR["threshold_mismatch"].maximum or math.inf
LEAST_CONTRAST, MOST_CONTRAST = 0.05, 12.0
"""Between these a sensor with mismatch can have thresholds of LOW to HIGH, or some of them, and a STEP beyond."""
BLUR_STARTS, BLUR_LOW, BLUR_HIGH = (0.4, 2.0), 0.15, 8.0
"""A blurred edge looks much like a slow photoreceptor: the search begins at a sharp and at a soft scene."""
EXPONENT_LOW, EXPONENT_HIGH = 0.0, 1.2
DEAD_START, DEAD_LOW = 0.6, 0.01
"""Of the dead time, as a share of the least interval between events, which it cannot exceed."""
WIDE_STEP = 0.1
"""Of an unknown, to both sides, for the slopes of a precise fit: thresholds and corner make up for the dead time
nearly, and slopes over STEP are too noisy to follow that valley, or to tell how long it is."""
SLOPE_PIXELS = 1500
"""So many are simulated for these slopes. The misfit takes MANY_PIXELS: along the valley, that of 1500 differs by
chance as much as by the dead time."""


@dataclass(frozen=True)
class MotionFit:
    """Holds what the recorded motion tells of a sensor. sensor: parameters of nodes.event_sensor.parameters; deviation:
    how well each is known [relative, of bandwidth_exponent absolute]; blur [px] of each clip's scene; cost: mean square
    of what is left, in SCALES; values: the unknowns, in the order of UNKNOWN, as they are searched."""

    sensor: dict[str, float]
    deviation: dict[str, float]
    blur: tuple[float, ...]
    cost: float
    values: np.ndarray


def fit_motion(
    clips: Sequence[Clip],
    light: Light,
    noise: Mapping[str, float],
    exponent: float | None = None,
    like: MotionFit | None = None,
    dead_us: float | None = None,
    say: Callable[[str], None] = lambda text: None,
    precise: bool = False,
) -> MotionFit:
    """Fits a sensor to the motion of all clips together, and a blur to each.

    noise: parameters that are known. exponent: of the corner's law, corner ~ I^exponent up to the scene's white; None:
    it is fitted too. like: another fit, from which the search begins. dead_us: the dead time; None: it is fitted too,
    up to the least interval. precise: by so many pixels that costs tell dead times apart.
    """
    laws, dead = int(exponent is None), int(dead_us is None)
    shared = len(UNKNOWN) + laws + dead
    most_us = least_interval_us(clips)

    def dead_time(values: np.ndarray) -> float:
        return float(values[shared - 1]) * most_us if dead_us is None else dead_us

    most = MANY_PIXELS if precise else SOME_PIXELS

    def residuals_of(which: int, values: np.ndarray, most: int) -> np.ndarray:
        sensor, blur = sensor_of(values, light, dead_time(values), exponent), math.exp(values[shared + which])
        made = simulate_motion(clips[which], light, blur, {**sensor, **noise}, most=most)
        return differences(made, clips[which].real)

    def residuals(values: np.ndarray) -> np.ndarray:
        say(f"threshold {light.contrast * math.exp(values[0]):.3f}, corner {math.exp(values[2]):.3g} Hz")
        return np.concatenate([residuals_of(k, values, most) for k in range(len(clips))])

    def slopes(at: np.ndarray, here: np.ndarray) -> np.ndarray:
        rows, out = len(SCALES), np.zeros((len(here), len(at)))
        for k in range(len(clips)):  # a clip's blur changes that clip alone
            part = slice(k * rows, (k + 1) * rows)
            for i in (*range(shared), shared + k):
                there = at.copy()
                if precise:
                    before = at.copy()
                    there[i], before[i] = min(at[i] + WIDE_STEP, high[i]), max(at[i] - WIDE_STEP, low[i])
                    change = residuals_of(k, there, SLOPE_PIXELS) - residuals_of(k, before, SLOPE_PIXELS)
                    out[part, i] = change / (there[i] - before[i])
                else:
                    there[i] += STEP
                    out[part, i] = (residuals_of(k, there, most) - here[part]) / STEP
        return out

    start = np.concatenate([np.log(START), [0.1] * laws, [DEAD_START] * dead])
    starts = [np.concatenate([start, np.full(len(clips), math.log(blur))]) for blur in BLUR_STARTS]
    if like is not None:
        law = min(max(like.sensor.get("bandwidth_exponent", 0.0), 0.1), 0.9)
        start = np.concatenate([like.values[: len(UNKNOWN)], [law] * laws, [DEAD_START] * dead])
        starts = [np.concatenate([start, np.log(like.blur)])]
    low, high = bounds(light, len(clips), laws, dead)
    found = least_squares(residuals, starts, low, high, slopes)
    spread = found.deviations(CHANCE)
    deviation = dict(zip(UNKNOWN, map(float, spread)))
    if laws:
        deviation["bandwidth_exponent"] = float(spread[len(UNKNOWN)])
    if dead:
        deviation["refractory_us"] = float(spread[shared - 1] / found.values[shared - 1])
    blur = tuple(float(b) for b in np.exp(found.values[shared:]))
    cost = found.cost / len(found.residuals)
    sensor = sensor_of(found.values, light, dead_time(found.values), exponent)
    return MotionFit(sensor, deviation, blur, cost, found.values)


def least_interval_us(clips: Sequence[Clip]) -> float:
    """Finds the shortest time between two events of a pixel in all clips [us], which no dead time exceeds."""
    return min(clip.least_interval_us for clip in clips)


def fit_blur(clip: Clip, light: Light, sensor: dict[str, Any]) -> float:
    """Finds the blur [px] of a clip's scene for a sensor that is given, by the intervals between events alone."""

    def residuals(values: np.ndarray) -> np.ndarray:
        return differences(simulate_motion(clip, light, math.exp(values[0]), sensor), clip.real, BLUR)

    low, high = np.log([BLUR_LOW]), np.log([BLUR_HIGH])
    found = least_squares(residuals, [np.log([b]) for b in BLUR_STARTS], low, high)
    return math.exp(float(found.values[0]))


def bounds(light: Light, clips: int, laws: int = 0, dead: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Gives the least and most of the unknowns: of UNKNOWN, of the corner's law and the dead time where they are
    fitted (`laws`, `dead`: 1 or 0), and of the blur of each clip."""
    least = np.maximum(LOW, [LEAST_THRESHOLD / light.contrast] * 2 + [0.0] * 2)
    low = np.concatenate([np.log(least), [EXPONENT_LOW] * laws, [DEAD_LOW] * dead, [math.log(BLUR_LOW)] * clips])
    high = np.concatenate([np.log(HIGH), [EXPONENT_HIGH] * laws, [1.0] * dead, [math.log(BLUR_HIGH)] * clips])
    return low, high


def sensor_of(values: np.ndarray, light: Light, dead_us: float, exponent: float | None) -> dict[str, float]:
    """Gives the parameters of the sensor that unknowns stand for, in the order of UNKNOWN and, where `exponent` is
    None, that of the corner's law."""
    on, off, corner, mismatch = (math.exp(v) for v in values[: len(UNKNOWN)])
    sensor = {
        "threshold_on": on * light.contrast,
        "threshold_off": off * light.contrast,
        "bandwidth_hz": corner,
        "refractory_us": dead_us,
        "threshold_mismatch": min(mismatch * light.contrast * math.sqrt(on * off), MOST_MISMATCH),
    }
    law = float(values[len(UNKNOWN)]) if exponent is None else exponent
    if law:
        sensor |= {"bandwidth_level": light.white, "bandwidth_exponent": law}
    return sensor
