"""Holds a recording with the scene that was found in it, and simulates a sensor before that scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.events.measure.bursts import Bursts, bursts_of
from evis.random_numbers import GOLDEN, mix
from nodes.event_sensor.fit.statistics import statistics
from nodes.event_sensor.fit.wheel import Wheel, find_wheel
from nodes.event_sensor.sensor import EventSensor

STEP_NS = 250_000
"""Between frames during the motion; a border of 3000 px/s moves by 0.75 px in it, ln I being a line in between."""
CHUNK = 64
SOME_PIXELS = 700
"""So many of the wheel's pixels are simulated while the parameters are searched."""
MANY_PIXELS = 4000
"""So many for what is reported, and where the dead time is searched."""
LEAST_SHARE = 2e-5
"""Of all intervals: those that may be shorter than the least, which one error of the camera would set otherwise."""
BEFORE_NS = 5_000_000
"""What is simulated before the motion."""
UNSURE_NS = 20_000_000
"""What is not counted after the motion's start, which is known to a window of angles: what the border passed in that
window has had its events by then. Nor is anything counted behind the last angle, where a wheel may go on slowly."""


@dataclass(frozen=True)
class Light:
    """Describes how bright the scene is.

    white: radiance of its white half [W/(sr m^2)]; contrast: ln(white / black).
    """

    white: float
    contrast: float


@dataclass
class Clip:
    """Holds a recording. name: of its file; t int64 [n] ns, x, y, p [n]: all its events; real: their statistics."""

    name: str
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    wheel: Wheel
    real: dict[str, float] = field(default_factory=dict)
    middle_speed: float = 0.0
    least_interval_us: float = 0.0

    def slow(self, found: Bursts, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Tells of bursts at x, y [B, px] whether the border that made them was slower than half of them: bool [B]."""
        return self.speed_at(found.start, x, y) < self.middle_speed

    def speed_at(self, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Computes the speed [B, px/s] of the border at times t [B, ns] and pixels x, y [B]."""
        wheel = self.wheel
        far = np.hypot(x - wheel.hub[0], y - wheel.hub[1])
        return np.asarray(np.interp(t, wheel.at, wheel.speed) * far)

    @property
    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns x, y float64 [N, px] of the wheel's pixels on the sensor."""
        rows, columns = np.nonzero(self.wheel.mask)
        return columns + float(self.wheel.box[0]), rows + float(self.wheel.box[1])


def least_interval(t: np.ndarray, pixel: np.ndarray) -> float:
    """Finds the shortest time between two events of a pixel [us], but for a few in a hundred thousand; t [n, ns], pixel
    [n]."""
    order = np.argsort(pixel, kind="stable")
    interval = np.diff(t[order])[pixel[order][1:] == pixel[order][:-1]]
    return float(np.quantile(interval, LEAST_SHARE)) * 1e-3 if len(interval) else 0.0


def read_clip(name: str, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> Clip:
    """Finds the scene of a recording and measures it; t int64 [n, ns], x, y, p [n]. Raises NoWheel."""
    if len(t) > 1 and (np.diff(t) < 0).any():
        order = np.argsort(t, kind="stable")
        t, x, y, p = t[order], x[order], y[order], p[order]
    clip = Clip(name, t, x, y, p, find_wheel(t, x, y, p))
    wheel = clip.wheel
    first, last = np.searchsorted(t, counted(wheel))
    column, row = x[first:last].astype(np.int64) - wheel.box[0], y[first:last].astype(np.int64) - wheel.box[1]
    on_wheel = wheel.mask[row, column]
    pixel = (row * wheel.box[2] + column)[on_wheel]
    clip.least_interval_us = least_interval(t[first:last][on_wheel], pixel)

    def place(found: Bursts) -> tuple[np.ndarray, np.ndarray]:
        return found.pixel % wheel.box[2] + wheel.box[0], found.pixel // wheel.box[2] + wheel.box[1]

    found = bursts_of(t[first:last][on_wheel], pixel, p[first:last][on_wheel])
    clip.middle_speed = float(np.median(clip.speed_at(found.start, *place(found))))
    clip.real = statistics(
        t[first:last][on_wheel], pixel, p[first:last][on_wheel], int(wheel.mask.sum()), turns(wheel),
        lambda found: clip.slow(found, *place(found)),
    )  # fmt: skip
    return clip


def counted(wheel: Wheel) -> tuple[int, int]:
    """Gives the times [ns] from which and before which events of the motion count."""
    return wheel.start_ns + UNSURE_NS, wheel.end_ns


def turns(wheel: Wheel) -> float:
    """Computes the turns of the wheel while its events count."""
    return float(abs(np.diff(np.interp(counted(wheel), wheel.at, wheel.angle))[0]) / (2 * np.pi))


def luminance(clip: Clip, light: Light, blur_px: float, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Computes the light of the scene, float32 [K, N], at times t [K, ns] and pixels x, y [N, px].

    The border is a normal distribution's integral of the standard deviation blur_px, in intensity.
    """
    black = light.white * math.exp(-light.contrast)
    share = _normal_integral(clip.wheel.beyond(t, x, y) / np.float32(blur_px))
    return np.asarray(np.float32(black) + np.float32(light.white - black) * share, dtype=np.float32)


_GRID = np.linspace(-4.5, 4.5, 1801)
_INTEGRAL = np.array([0.5 * (1 + math.erf(v / math.sqrt(2))) for v in _GRID])


def _normal_integral(z: np.ndarray) -> np.ndarray:
    place = np.clip((z + 4.5) * np.float32(200), 0, 1800).astype(np.int32)
    return np.asarray(_INTEGRAL.astype(np.float32)[place])


def some_pixels(clip: Clip, most: int = SOME_PIXELS) -> tuple[np.ndarray, np.ndarray]:
    """Returns x, y [n] of pixels of the wheel picked by a hash: the same ones each time."""
    x, y = clip.pixels
    rank = np.argsort(mix(np.arange(len(x), dtype=np.uint64) * GOLDEN + np.uint64(1)))
    keep = np.sort(rank[:most])
    return x[keep], y[keep]


def simulate_motion(
    clip: Clip, light: Light, blur_px: float, sensor: Mapping[str, Any], *, most: int = SOME_PIXELS, seed: int = 0
) -> dict[str, float]:
    """Computes the statistics that a sensor of these parameters has of the motion in a clip."""
    x, y = some_pixels(clip, most)
    times = np.arange(clip.wheel.start_ns - BEFORE_NS, clip.wheel.end_ns + STEP_NS, STEP_NS, dtype=np.int64)
    t, pixel, p = simulate(clip, light, blur_px, sensor, times, x, y, seed)
    first, last = np.searchsorted(t, counted(clip.wheel))
    t, pixel, p = t[first:last], pixel[first:last], p[first:last]
    return statistics(
        t, pixel, p, len(x), turns(clip.wheel), lambda found: clip.slow(found, x[found.pixel], y[found.pixel])
    )


def simulate(
    clip: Clip, light: Light, blur_px: float, sensor: Mapping[str, Any], times: np.ndarray, x: np.ndarray,
    y: np.ndarray, seed: int = 0, sees: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Simulates the events of pixels x, y [N] that see the scene at `times` [K, ns]: t [n, ns], pixel's index [n] and p
    [n].

    sees: times of the scene [K, ns] that they see then, if others.
    """
    made = EventSensor(1, len(x), seed=seed, **sensor)
    episodes, parts = np.zeros(1, np.int32), []
    for first in range(0, len(times), CHUNK):
        now = times[first : first + CHUNK]
        seen = now if sees is None else sees[first : first + CHUNK]
        images = luminance(clip, light, blur_px, seen, x, y)[None, :, None, :]
        parts.append(made.process(images, now, episodes))
    if not parts:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.uint8)
    t, pixel, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txp")
    return t, pixel.astype(np.int64), p
