"""Computes what an accelerometer and a gyroscope at a moving body read.

Ideal readings: f = R^T (a - g), the specific force, and R^T omega, both in the body's frame; a is the acceleration of
the frame's origin. Each reading has white noise of density sigma, that is sigma sqrt(rate) per sample, and a bias that
walks with sigma_b / sqrt(rate) per sample (Woodman, An introduction to inertial navigation, 2007; Crassidis, IEEE TAES
2006, on the discrete forms).

Acceleration is the derivative of the velocities at the sub-steps, by the polynomial through the five nearest: of
fourth order in the sub-step, also at the end of a message. Positions are not used: an integrator of first order (most
physics engines) makes them disagree with the velocities by half a sub-step, which a second derivative turns into an
error as large as the acceleration itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from evis.geometry import se3
from evis.geometry.interpolate import pose_at
from evis.runtime import clock
from nodes.imu.noise import normals

KNOTS = 5
LEAST_GAP_NS = 1000
"""Velocities closer in time than this say nothing about acceleration but their rounding; a stamp can fall right beside
a sub-step."""


@dataclass(frozen=True)
class ImuModel:
    """Describes an inertial unit. rate [Hz]; gravity [m/s^2], along the world's -z where nobody tells another.

    accel_noise [m/s^2/sqrt(Hz)], gyro_noise [rad/s/sqrt(Hz)]: densities of the white noise. accel_bias
    [m/s^3/sqrt(Hz)], gyro_bias [rad/s^2/sqrt(Hz)]: those of the biases' random walk, which starts from 0 in every
    episode. accel_range [m/s^2], gyro_range [rad/s]: largest reading, 0 = no limit.
    """

    rate: float = 1000.0
    gravity: float = 9.81
    accel_noise: float = 0.0
    gyro_noise: float = 0.0
    accel_bias: float = 0.0
    gyro_bias: float = 0.0
    accel_range: float = 0.0
    gyro_range: float = 0.0
    seed: int = 0


@dataclass
class Readings:
    """Holds samples of accelerometer and gyroscope.

    t int64 [n] ns; acceleration float64 [n, 3] m/s^2 and angular_velocity float64 [n, 3] rad/s, in body axes.
    """

    t: np.ndarray
    acceleration: np.ndarray
    angular_velocity: np.ndarray


class InertialUnit:
    """Reads the inertial unit on one body.

    `clipped` counts components that went past a range, `nonfinite` samples with a NaN or inf.

    Raises ValueError for a rate below 1e-6 or above 1e9, and for negative densities or ranges.
    """

    def __init__(self, model: ImuModel) -> None:
        if not (math.isfinite(model.rate) and 1e-6 <= model.rate <= 1e9):
            raise ValueError(f"IMU rate {model.rate:g} Hz must lie between 1e-6 and 1e9")
        limits = ("accel_noise", "gyro_noise", "accel_bias", "gyro_bias", "accel_range", "gyro_range")
        for name in limits:
            if not (math.isfinite(getattr(model, name)) and getattr(model, name) >= 0):
                raise ValueError(f"IMU {name} {getattr(model, name):g} must be finite and not negative")
        self.model = model
        self.clipped = self.nonfinite = 0
        self._period = Fraction(10**9) / clock.rate(model.rate)
        self._restart(0)

    def _restart(self, episode: int) -> None:
        self._episode = episode
        self._bias = np.zeros(6)
        self._forget()

    def _forget(self) -> None:
        self._times, self._twists = np.zeros(0, np.int64), np.zeros((0, 6))
        self._end = -1

    def advance(
        self, t: np.ndarray, pose: np.ndarray, twist: np.ndarray, episode: int = 0, gravity: np.ndarray | None = None
    ) -> Readings:
        """Computes the readings in (t[0], t[-1]], at round(k 1e9 / rate) ns; none for a single instant.

        t: int64 [S] ns, ascending, starting where the last call's ended. pose float64 [S, 7], twist float64 [S, 6] of
        the body at these times, world frame (position and quaternion x y z w; velocity of the origin and angular
        velocity). A new episode starts with zero bias and other noise. gravity [3] m/s^2, world: None = the unit's.
        """
        t, pose, twist = np.asarray(t, np.int64), np.asarray(pose, np.float64), np.asarray(twist, np.float64)
        if episode != self._episode:
            self._restart(episode)
        if self._end != t[0]:
            self._forget()
        self._end = int(t[-1])
        news = t > (self._times[-1] if len(self._times) else -1)
        times, twists = np.concatenate((self._times, t[news])), np.concatenate((self._twists, twist[news]))
        kept = spaced(times)
        times, twists = times[kept], twists[kept]
        self._times, self._twists = times[-KNOTS:], twists[-KNOTS:]
        counters = self._counters(int(t[0]), int(t[-1]))
        if not counters:
            return Readings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
        at = np.array([self._stamp(k) for k in counters], np.int64)
        value, slope = polynomial(at, times, twists)
        inverse = se3.conjugate(pose_at(at, t, pose[:, None], twist[:, None])[:, 0, 3:])
        up = np.array([0.0, 0.0, self.model.gravity]) if gravity is None else -gravity
        ideal = np.concatenate((se3.rotate(inverse, slope[:, :3] + up), se3.rotate(inverse, value[:, 3:])), axis=1)
        return self._measure(at, ideal, np.array(counters, np.int64))

    def _stamp(self, k: int) -> int:
        """round(k 1e9 / rate), exactly."""
        return (2 * k * self._period.numerator + self._period.denominator) // (2 * self._period.denominator)

    def _counters(self, start: int, end: int) -> range:
        """Numbers k of the samples in (start, end]."""

        def first_after(ns: int) -> int:
            # A stamp is up to half a ns from k periods.
            k = (ns * self._period.denominator) // self._period.numerator
            return next(n for n in range(k - 1, k + 3) if self._stamp(n) > ns)

        return range(first_after(start), first_after(end)) if end > start else range(0)

    def _measure(self, t: np.ndarray, ideal: np.ndarray, counters: np.ndarray) -> Readings:
        """Bias, noise and limits on ideal readings [n, 6]."""
        m = self.model
        density, walk, limit = (
            np.repeat([getattr(m, f"accel_{name}"), getattr(m, f"gyro_{name}")], 3)
            for name in ("noise", "bias", "range")
        )
        read = ideal
        if density.any() or walk.any():
            draws = normals(m.seed, self._episode, counters, 12)
            steps = np.concatenate((self._bias[None], walk / math.sqrt(m.rate) * draws[:, 6:]))
            bias = np.cumsum(steps, axis=0)[1:]
            self._bias = bias[-1]
            read = ideal + bias + density * math.sqrt(m.rate) * draws[:, :6]
        self.nonfinite += int((~np.isfinite(read)).any(axis=1).sum())
        limit = np.where(limit > 0, limit, np.inf)
        self.clipped += int((np.abs(read) > limit).sum())
        read = np.clip(read, -limit, limit)
        return Readings(t, np.ascontiguousarray(read[:, :3]), np.ascontiguousarray(read[:, 3:]))


def spaced(times: np.ndarray) -> np.ndarray:
    """Marks ascending int64 times so that at least LEAST_GAP_NS lies between those that stay, the first among them."""
    kept = np.ones(len(times), bool)
    if len(times) > 1 and np.diff(times).min() < LEAST_GAP_NS:
        last = times[0]
        for i in range(1, len(times)):
            kept[i] = times[i] - last >= LEAST_GAP_NS
            last = times[i] if kept[i] else last
    return kept


def polynomial(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interpolates [N, D] known at int64 [N] ns: value and time derivative [1/s], [n, D] each, at int64 [n] ns.

    Lagrange's polynomial through the KNOTS known times around each wanted one (all of them where there are fewer), on
    both sides where possible.
    """
    count = min(KNOTS, len(times))
    first = np.searchsorted(times, at) - count // 2
    index = np.clip(first, 0, len(times) - count)[:, None] + np.arange(count)
    # Seconds from the wanted time, so that large stamps cost no digits.
    x = (times[index] - at[:, None]) * 1e-9
    value = np.zeros((len(at), values.shape[1]))
    slope = np.zeros_like(value)
    for i in range(count):
        others = [j for j in range(count) if j != i]
        scale = np.prod([x[:, i] - x[:, j] for j in others], axis=0)
        weight = np.prod([-x[:, j] for j in others], axis=0) / scale
        rate = sum((np.prod([-x[:, j] for j in others if j != m], axis=0) for m in others), np.zeros(len(at))) / scale
        value += weight[:, None] * values[index[:, i]]
        slope += rate[:, None] * values[index[:, i]]
    return value, slope
