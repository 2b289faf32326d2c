"""Draws the fixed pattern: what differs from pixel to pixel and stays for the life of a sensor.

Drawn on the host in float64, so that it is the same on every device. Pixel i of environment e has the numbers of a
single sensor with seed + e.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.random_numbers import GOLDEN, mix, open_uniform, standard_normal
from nodes.event_sensor.input.batch import Size
from nodes.event_sensor.model.features import has_noise

THRESHOLD_ON, THRESHOLD_OFF, LEAK, HOT, HOT_RATE = range(5)
"""What a number is for."""


def uniforms(seed: int, envs: int, pixels: int, purpose: int, index: int = 0) -> np.ndarray:
    """Draws float64 [E * pixels] in (0, 1): one number per pixel. purpose and index name independent sets."""
    seeds = np.array([(seed + e + int(GOLDEN)) & 0xFFFFFFFFFFFFFFFF for e in range(envs)], np.uint64)
    pixel = np.arange(pixels, dtype=np.uint64) * GOLDEN + np.uint64(3 + 8 * purpose + index)
    bits = mix(mix(seeds)[:, None] ^ pixel[None])
    return open_uniform(mix(bits + GOLDEN)).reshape(-1)


def normals(seed: int, envs: int, pixels: int, purpose: int) -> np.ndarray:
    """Draws float64 [E * pixels], standard normal (Box and Muller)."""
    return standard_normal(uniforms(seed, envs, pixels, purpose, 0), uniforms(seed, envs, pixels, purpose, 1))


def thresholds(
    seed: int, envs: int, pixels: int, mean: tuple[float, float], sigma: float, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Draws float32 [E * pixels] ON and OFF thresholds, max(normal(mean, sigma), floor), drawn independently."""
    on, off = (
        np.maximum(m + sigma * normals(seed, envs, pixels, purpose), floor).astype(np.float32)
        for m, purpose in zip(mean, (THRESHOLD_ON, THRESHOLD_OFF))
    )
    return on, off


def leak_rates(seed: int, envs: int, pixels: int, rate: float, jitter: float) -> np.ndarray:
    """Draws float32 [E * pixels]: rate * max(1 + jitter * normal, 0) [Hz]."""
    spread = 1 + jitter * normals(seed, envs, pixels, LEAK) if jitter > 0 else np.ones(envs * pixels)
    return np.asarray((rate * np.maximum(spread, 0)).astype(np.float32))


def hot_rates(
    seed: int, envs: int, pixels: int, fraction: float, rate: float, spread: float = 0.0
) -> np.ndarray:  # fmt: skip
    """Draws float32 [E * pixels], the rate [Hz] of each pixel that is hot, which it is with probability `fraction`;
    else 0.

    Rates are log-normal with the mean `rate`; spread: standard deviation of their logarithms.
    """
    hot = uniforms(seed, envs, pixels, HOT) < fraction
    if spread <= 0:
        return np.where(hot, np.float32(rate), np.float32(0))
    own = rate * np.exp(spread * normals(seed, envs, pixels, HOT_RATE) - spread**2 / 2)
    return np.where(hot, own, 0).astype(np.float32)


def pattern_of(size: Size, seed: int, p: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Draws the fixed pattern of a sensor: float32 [E * pixels] by the field of state_kernels.Rare that holds it; only
    what pixels differ in."""
    envs, pixels = size.envs, size.pixels
    pattern: dict[str, np.ndarray] = {}
    if p["threshold_mismatch"] > 0:
        mean = (p["threshold_on"], p["threshold_off"])
        on, off = thresholds(seed, envs, pixels, mean, p["threshold_mismatch"], p["threshold_floor"])
        pattern |= {"c_on": on, "c_off": off}
    if p["leak_rate"] > 0:
        pattern["leak_rate"] = leak_rates(seed, envs, pixels, p["leak_rate"], p["leak_jitter"])
    if has_noise(p):
        fraction, rate, spread = (p[f"hot_pixel_{name}"] for name in ("fraction", "rate", "spread"))
        pattern["hot_rate"] = hot_rates(seed, envs, pixels, fraction, rate, spread)
    return pattern
