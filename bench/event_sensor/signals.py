"""Makes test signals whose events are known in closed form, one signal per pixel.

A pixel fires when L has moved by C from its reference, which starts at L(0) and follows in whole thresholds: the levels
are L(0) + k C, and of the level that fired last only its two neighbours can fire next.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evis.events.measure.distance import EventStream

SECOND = 1_000_000_000


@dataclass(frozen=True)
class Recording:
    """Holds frames of a signal: luminance, dlog_dt float32 [K, H, W] (dL/dt in 1/s); t int64 [K] ns."""

    luminance: np.ndarray
    dlog_dt: np.ndarray
    t: np.ndarray


def stamps(rate: float, duration_s: float) -> np.ndarray:
    """Gives the stamps of frames: frame k is at round(k / rate), the last one not after the duration."""
    return np.rint(np.arange(int(duration_s * rate + 1e-9) + 1) * SECOND / rate).astype(np.int64)


class Sinusoids:
    """Makes a sinusoid of its own in every pixel, and its events in closed form.

    L = ln 71 + A sin(2 pi f t + phi); A uniform in 0.25 to 1.25, f log-uniform in 1 to 20 Hz, phi uniform."""

    def __init__(self, height: int, width: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.shape = (height, width)
        self.amplitude = rng.uniform(0.25, 1.25, self.shape)
        self.frequency = np.exp(rng.uniform(0, math.log(20), self.shape))
        self.phase = rng.uniform(0, 2 * np.pi, self.shape)

    def record(self, rate: float, duration_s: float) -> Recording:
        """Draws frames at `rate` Hz from t = 0."""
        t = stamps(rate, duration_s)
        luminance, slope = (np.empty((len(t), *self.shape), np.float32) for _ in range(2))
        omega = 2 * np.pi * self.frequency
        for k, now in enumerate(t / SECOND):
            angle = omega * now + self.phase
            luminance[k] = 71 * np.exp(self.amplitude * np.sin(angle))
            slope[k] = self.amplitude * omega * np.cos(angle)
        return Recording(luminance, slope, t)

    def events(self, threshold: float, end_ns: int) -> EventStream:
        """Computes the events in (0, end_ns]: t_k = (j pi +- arcsin(sin phi + k C / A) - phi) / (2 pi f)."""
        a, phase = self.amplitude.ravel(), self.phase.ravel()
        omega = 2 * np.pi * self.frequency.ravel()
        last_angle = omega * end_ns / SECOND + phase
        half_wave = np.floor(phase / np.pi + 0.5)
        level = np.zeros(a.size, np.int64)
        pixels, times, signs = [], [], []
        while True:
            here = np.flatnonzero((half_wave - 0.5) * np.pi < last_angle)
            if not here.size:
                break
            j = half_wave[here]
            sign = np.where(j % 2 == 0, 1, -1)
            last = (j + 0.5) * np.pi > last_angle[here]
            peak = np.where(last, np.sin(last_angle[here]), sign)
            reach = np.floor(sign * a[here] * (peak - np.sin(phase[here])) / threshold).astype(np.int64)
            n = np.maximum(reach - sign * level[here], 0)
            of = np.repeat(np.arange(here.size), n)
            step = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n) + 1
            k = level[here][of] + sign[of] * step
            at = here[of]
            sine = np.clip(np.sin(phase[at]) + k * threshold / a[at], -1, 1)
            angle = j[of] * np.pi + sign[of] * np.arcsin(sine)
            pixels.append(at)
            times.append((angle - phase[at]) / omega[at] * SECOND)
            signs.append(sign[of])
            level[here] += sign * n
            half_wave += 1
        pixel, t = np.concatenate(pixels), np.rint(np.concatenate(times)).astype(np.int64)
        on = (np.concatenate(signs) > 0).astype(np.uint8)
        order = np.argsort(t, kind="stable")
        y, x = np.divmod(pixel[order], self.shape[1])
        return EventStream(t[order], x.astype(np.uint16), y.astype(np.uint16), on[order], self.shape[1], self.shape[0])


@dataclass(frozen=True)
class Form:
    """Describes one monotone signal.

    level(t): L(t) - L(0); slope(t): its derivative; crossing(k C): when L passes k C [s]."""

    name: str
    level: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    crossing: Callable[[np.ndarray], np.ndarray]

    def record(self, rate: float, duration_s: float) -> Recording:
        """Draws frames of one pixel at `rate` Hz."""
        t = stamps(rate, duration_s)
        luminance = np.exp(self.level(t / SECOND)).astype(np.float32)
        return Recording(luminance[:, None, None], self.slope(t / SECOND).astype(np.float32)[:, None, None], t)

    def events(self, threshold: float, end_ns: int) -> EventStream:
        """Computes the events in (0, end_ns]."""
        total = float(self.level(np.array([end_ns / SECOND]))[0])
        k = np.arange(1, int(abs(total) / threshold + 1e-9) + 1)
        t = np.rint(self.crossing(math.copysign(1, total) * k * threshold) * SECOND).astype(np.int64)
        zero = np.zeros(len(k), np.uint16)
        return EventStream(t, zero, zero, np.full(len(k), total > 0, np.uint8), 1, 1)


def _photoreceptor(height: float, tau: float) -> Form:
    return Form(
        f"exponential, {height:g} (1 - exp(-t / {tau * 1e3:g} ms))",
        lambda t: -height * np.expm1(-t / tau),
        lambda t: height / tau * np.exp(-t / tau),
        lambda level: -tau * np.log1p(-level / height),
    )


def _ramp(slope: float) -> Form:
    return Form(f"ramp, {slope:g} /s", lambda t: slope * t, lambda t: slope + 0 * t, lambda level: level / slope)


def _step(height: float, at: float) -> Form:
    """Between two frames a step has no time of its own; its middle frame is the half-way point of the ramp."""
    return Form(
        f"step of {height:g} at {at * 1e3:g} ms",
        lambda t: height * (t > at),
        lambda t: 0 * t,
        lambda level: at + 0 * level,
    )


FORMS = (_ramp(5.3), _ramp(-39.7), _step(4.1, 0.1003), _photoreceptor(3.1, 0.02), _photoreceptor(-3.1, 0.2))
