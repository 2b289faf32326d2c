"""Describes events about a pivot: histograms of angle per ring, polarity and millisecond, in angular harmonics."""

from __future__ import annotations

import numpy as np

STEP_NS = 1_000_000
"""Length of one descriptor."""
ANGLES = 128
HARMONICS = 40
RINGS = 5


def rings_of(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Computes the edges [RINGS + 1, px] that share the events out equally, without the 4 px next to the pivot.

    u, v: places in the plane of the rotation, from its pivot [n, px].
    """
    radius = np.hypot(u, v)
    radius = radius[radius > 4]
    if len(radius) < RINGS:
        return np.linspace(4, 40, RINGS + 1)
    edges = np.quantile(radius, np.linspace(0, 1, RINGS + 1))
    edges[0], edges[-1] = 4, edges[-1] + 1
    return np.maximum.accumulate(edges + np.arange(RINGS + 1) * 1e-6)


def harmonics_of(
    step: np.ndarray, steps: int, u: np.ndarray, v: np.ndarray, p: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes the Fourier coefficients of the angle histograms of each step, and the events in each.

    step: int [n], which of the `steps` descriptors an event belongs to. u, v: from the pivot [px], p: [n]. Returns
    complex64 [HARMONICS, steps, 2 RINGS], orders 1 to HARMONICS, and float [steps]. A turn by a multiplies order m by
    e^(-i m a).
    """
    ring = np.searchsorted(edges, np.hypot(u, v)) - 1
    angle = np.floor(np.arctan2(v, u) * (ANGLES / (2 * np.pi))).astype(np.int64) % ANGLES
    inside = (ring >= 0) & (ring < RINGS)
    key = ((step * RINGS + ring) * 2 + p) * ANGLES + angle
    counts = np.bincount(key[inside], minlength=steps * RINGS * 2 * ANGLES).astype(np.float32)
    histogram = counts.reshape(steps, 2 * RINGS, ANGLES)
    coefficients = np.fft.rfft(histogram, axis=2)[:, :, 1 : HARMONICS + 1].transpose(2, 0, 1)
    return np.ascontiguousarray(coefficients, np.complex64), histogram.sum((1, 2), dtype=np.float64)


def order_weights(width: float) -> np.ndarray:
    """Computes the weights of the orders, a Gaussian of `width` about 0: [HARMONICS]. Narrow is coarse and sure, wide
    is fine.
    """
    return np.exp(-0.5 * (np.arange(1, HARMONICS + 1) / width) ** 2)


def time_weights(counts: np.ndarray) -> np.ndarray:
    """Computes a Hann taper over the steps of a window; busy steps weigh little more than quiet ones.

    Without that, a window in which the rotation gathers speed measures its faster end, where most events are.
    """
    taper = np.hanning(len(counts) + 2)[1:-1]
    return taper / (counts + 0.2 * counts.mean() + 1) ** 0.75


def turns(omegas: np.ndarray, steps: int, orders: int) -> np.ndarray:
    """Computes the factors that turn each step of a window back at each speed [rad/s]: complex64 [orders, speeds,
    steps].
    """
    tau = (np.arange(steps) - (steps - 1) / 2) * (STEP_NS * 1e-9)
    m = np.arange(1, orders + 1)
    return np.exp(1j * m[:, None, None] * omegas[None, :, None] * tau).astype(np.complex64)


def contrast(coefficients: np.ndarray, weights: np.ndarray, turned: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Computes the energy of the angle histograms of a window when its steps are turned back at each speed: float
    [speeds].

    coefficients: [HARMONICS, steps, columns]; weights: [steps]; turned: of `turns`; orders: weights [HARMONICS].
    """
    weighted = coefficients * weights.astype(np.float32)[:, None]
    return (orders[:, None] * (np.abs(turned @ weighted) ** 2).sum(2)).sum(0)


def peak(at: np.ndarray, values: np.ndarray) -> float:
    """Finds the place of the largest value, between the samples by a parabola through three; at: equally spaced [n]."""
    i = int(values.argmax())
    if not 0 < i < len(values) - 1:
        return float(at[i])
    left, middle, right = (float(v) for v in values[i - 1 : i + 2])
    bend = left - 2 * middle + right
    return float(at[i] + (0.5 * (left - right) / bend if bend < 0 else 0.0) * (at[1] - at[0]))
