"""Draws random numbers by counting, in numpy: a number is a hash of what it is for, never of what was drawn before.

The hash is SplitMix64 (Steele, Lea and Flood, OOPSLA 2014), whose stream s has the n-th number mix(s + n GOLDEN). In
kernels it stands in evis.random_number_kernels, in C++ in readout.h; a test holds them together.
"""

from __future__ import annotations

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FACTORS = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
"""Of the two rounds of `mix`."""


def mix(z: np.ndarray) -> np.ndarray:
    """Returns SplitMix64's finalizer of uint64 numbers."""
    z = (z ^ (z >> np.uint64(30))) * FACTORS[0]
    z = (z ^ (z >> np.uint64(27))) * FACTORS[1]
    return z ^ (z >> np.uint64(31))


def seed_of_camera(seed: int, camera: str) -> int:
    """Gives the seed of the sensors of a camera: no two of a rig have the same noise, as no two that are built have.

    camera: with its namespace, where it has one, as `Node.below` gives it. cam0, as a camera is called that is alone,
    has that of the run. The result goes up by one from environment to environment as `seed` does.
    """
    if camera == "cam0":
        return seed
    key = np.zeros(1, np.uint64)
    for byte in camera.encode():
        key = mix((key ^ np.uint64(byte)) + GOLDEN)
    return seed + (int(key[0]) >> 2)


def seed_of_time(seed: int, number: int) -> int:
    """Gives the seed of the random numbers that are keyed by time: it differs after each reset, where time is 0 again.

    number: of the reset, 0 at the start of a run. The result goes up by one from environment to environment as `seed`
    does.
    """
    return seed if not number else (seed + int(mix(np.array([number], np.uint64))[0])) % 2**64


def open_uniform(bits: np.ndarray) -> np.ndarray:
    """Returns float64 in (0, 1) from the upper 53 of 64 bits."""
    return np.asarray(((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53)


def standard_normal(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Computes standard normal numbers, float64, of two uniform ones in (0, 1) (Box and Muller, 1958)."""
    return np.asarray(np.sqrt(-2.0 * np.log(first)) * np.cos(2.0 * np.pi * second))
