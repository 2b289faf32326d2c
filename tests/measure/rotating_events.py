"""Events of patterns that turn by a known angle theta(t): crossing times in closed form or to 1 us."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def turning_edges(
    theta: Callable[[np.ndarray], np.ndarray],
    duration_s: float,
    edges: list[tuple[float, float, float, int]],
    pivot: tuple[float, float] = (60.0, 50.0),
    size: tuple[int, int] = (120, 100),
    jitter_us: float = 200.0,
    seed: int = 0,
    tilt_deg: float = 0.0,
) -> tuple[np.ndarray, ...]:
    """A pixel has an event whenever a radial edge of the pattern passes over it.

    theta(t): angle [rad] at t [s]. edges: (angle, inner radius, outer radius, polarity of an edge that turns
    positively). tilt_deg: of the pattern's plane about the x axis, seen from far. Returns t int64 [n, ns] ascending,
    x, y uint16, p uint8.
    """
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[0 : size[1], 0 : size[0]]
    down = (rows - pivot[1]) / np.cos(np.radians(tilt_deg))
    radius, angle = np.hypot(columns - pivot[0], down), np.arctan2(down, columns - pivot[0])
    grid = np.arange(0, duration_s, 1e-5)
    turned = theta(grid)
    parts = []
    for start, inner, outer, polarity in edges:
        inside = (radius > inner) & (radius < outer)
        aim = angle[inside] - start
        low, high = turned.min(), turned.max()
        for turn in range(int(np.floor((low - np.pi) / (2 * np.pi))) - 1, int((high + np.pi) / (2 * np.pi)) + 2):
            wanted = aim + 2 * np.pi * turn
            for sign, k in _passes(turned, wanted):
                t = grid[k[0]] + random.normal(0, jitter_us * 1e-6, len(k[0]))
                p = np.full(len(t), polarity if sign > 0 else 1 - polarity)
                parts.append((t, columns[inside][k[1]], rows[inside][k[1]], p))
    t, x, y, p = (np.concatenate([part[i] for part in parts]) for i in range(4))
    keep = (t >= 0) & (t < duration_s)
    order = np.argsort(t[keep], kind="stable")
    t, x, y, p = (v[keep][order] for v in (t, x, y, p))
    return np.round(t * 1e9).astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)


def _passes(turned: np.ndarray, wanted: np.ndarray) -> list[tuple[int, tuple[np.ndarray, np.ndarray]]]:
    """(direction, (index in time, index of the pixel)) of every passage of theta through the wanted angles."""
    corners = np.flatnonzero(np.diff(np.sign(np.diff(turned))) != 0) + 1
    result = []
    for first, last in zip([0, *corners.tolist()], [*corners.tolist(), len(turned) - 1]):
        piece = turned[first : last + 1]
        rising = piece[-1] > piece[0]
        hit = np.flatnonzero((wanted > piece.min()) & (wanted <= piece.max()))
        at = np.interp(
            wanted[hit], piece if rising else piece[::-1], np.arange(first, last + 1)[:: 1 if rising else -1]
        )
        result.append((1 if rising else -1, (np.round(at).astype(int), hit)))
    return result


def texture(seed: int = 3, count: int = 24) -> list[tuple[float, float, float, int]]:
    """Radial edges at random places: repeats only after a full turn."""
    random = np.random.default_rng(seed)
    inner = random.uniform(5, 35, count)
    return [
        (float(a), float(i), float(i + w), int(p))
        for a, i, w, p in zip(
            random.uniform(0, 2 * np.pi, count), inner, random.uniform(6, 14, count), random.integers(0, 2, count)
        )
    ]


def spokes(count: int) -> list[tuple[float, float, float, int]]:
    """Black and white sectors, `count` of each: repeats `count` times on a turn."""
    return [(np.pi * k / count, 6.0, 44.0, k % 2) for k in range(2 * count)]


def poisson_events(
    rate_hz: float, duration_s: float, size: tuple[int, int], seed: int = 1
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """Independent noise of a known rate per pixel."""
    random = np.random.default_rng(seed)
    n = random.poisson(rate_hz * duration_s * size[0] * size[1])
    t = np.sort(random.integers(0, round(duration_s * 1e9), n))
    x, y, p = random.integers(0, size[0], n), random.integers(0, size[1], n), random.integers(0, 2, n)
    return t, x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8)
