"""Fixed pattern: what differs from pixel to pixel and stays for the life of a sensor.

Drawn on the host in float64, so that it is the same on every device. Pixel i of environment e has the numbers of a
single sensor with seed + e.
"""

from __future__ import annotations

import numpy as np

GOLDEN = 0x9E3779B97F4A7C15
THRESHOLD_ON, THRESHOLD_OFF, LEAK, HOT = range(4)
"""What a number is for."""


def _mix(z: np.ndarray) -> np.ndarray:
    """SplitMix64's finalizer on uint64, as in random_kernels."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def uniforms(seed: int, envs: int, pixels: int, purpose: int, index: int = 0) -> np.ndarray:
    """float64 [E * pixels] in (0, 1): one number per pixel. purpose and index name independent sets."""
    seeds = np.array([(seed + e + GOLDEN) & 0xFFFFFFFFFFFFFFFF for e in range(envs)], np.uint64)
    pixel = np.arange(pixels, dtype=np.uint64) * np.uint64(GOLDEN) + np.uint64(3 + 8 * purpose + index)
    bits = _mix(_mix(seeds)[:, None] ^ pixel[None])
    return ((_mix(bits + np.uint64(GOLDEN)) >> np.uint64(11)).astype(np.float64).reshape(-1) + 0.5) * 2.0**-53


def normals(seed: int, envs: int, pixels: int, purpose: int) -> np.ndarray:
    """float64 [E * pixels], standard normal (Box and Muller)."""
    radius = np.sqrt(-2 * np.log(uniforms(seed, envs, pixels, purpose, 0)))
    return np.asarray(radius * np.cos(2 * np.pi * uniforms(seed, envs, pixels, purpose, 1)))


def thresholds(
    seed: int, envs: int, pixels: int, mean: tuple[float, float], sigma: float, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """float32 [E * pixels] ON and OFF thresholds, max(normal(mean, sigma), floor), drawn independently."""
    on, off = (
        np.maximum(m + sigma * normals(seed, envs, pixels, purpose), floor).astype(np.float32)
        for m, purpose in zip(mean, (THRESHOLD_ON, THRESHOLD_OFF))
    )
    return on, off


def leak_rates(seed: int, envs: int, pixels: int, rate: float, jitter: float) -> np.ndarray:
    """float32 [E * pixels]: rate * max(1 + jitter * normal, 0) [Hz]."""
    spread = 1 + jitter * normals(seed, envs, pixels, LEAK) if jitter > 0 else np.ones(envs * pixels)
    return np.asarray((rate * np.maximum(spread, 0)).astype(np.float32))


def hot_rates(seed: int, envs: int, pixels: int, fraction: float, rate: float) -> np.ndarray:
    """float32 [E * pixels]: `rate` [Hz] for each pixel that is hot, which it is with probability `fraction`; else 0."""
    return np.where(uniforms(seed, envs, pixels, HOT) < fraction, np.float32(rate), np.float32(0))
