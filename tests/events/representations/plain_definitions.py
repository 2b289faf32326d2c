"""The definitions of the representations, event by event in plain Python, and events to try them on."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Columns = dict[str, np.ndarray]


def some_events(n: int = 400, height: int = 6, width: int = 9, seed: int = 3) -> Columns:
    """Sorted events over 10 ms with gaps, several at one instant, and pixels that none of them hits."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(5_000_000, 15_000_000, n) // 40_000 * 40_000)
    x, y = rng.integers(0, width - 1, n), rng.integers(0, height - 1, n)
    return {"t": t, "x": x.astype(np.uint16), "y": y.astype(np.uint16), "p": rng.integers(0, 2, n).astype(np.uint8)}


def rows(events: Columns, window: tuple[int, int] | None) -> list[tuple[int, int, int, int]]:
    """(t, x, y, p) of the events in the window."""
    all_rows = [tuple(int(v) for v in row) for row in zip(*(events[name] for name in "txyp"))]
    return [r for r in all_rows if window is None or window[0] <= r[0] <= window[1]]  # type: ignore[misc]


def channel(polarity: str, p: int, b: int, bins: int) -> tuple[int, int]:
    """(channel, sign) of an event of polarity p in bin b."""
    return (b + bins * p if polarity == "split" else b), (-1 if polarity == "signed" and not p else 1)


def voxels(events: Columns, bins: int, shape: tuple[int, int], polarity: str, window: Any = None) -> np.ndarray:
    """Zhu et al., eqs. (1) and (2), over every bin."""
    chosen = rows(events, window)
    t0, t1 = window or (chosen[0][0], chosen[-1][0])
    grid = np.zeros(((2 if polarity == "split" else 1) * bins, *shape))
    for t, x, y, p in chosen:
        at = (bins - 1) * (t - t0) / max(t1 - t0, 1)
        for b in range(bins):
            c, sign = channel(polarity, p, b, bins)
            grid[c, y, x] += sign * max(0.0, 1.0 - abs(b - at))
    return grid


def counts(
    events: Columns, bins: int, shape: tuple[int, int], polarity: str, by: str, window: Any = None
) -> np.ndarray:
    """Slices whose borders are written out, by time in whole numbers."""
    chosen = rows(events, window)
    t0, t1 = window or (chosen[0][0], chosen[-1][0])
    grid = np.zeros(((2 if polarity == "split" else 1) * bins, *shape), int)
    for i, (t, x, y, p) in enumerate(chosen):
        if by == "time":
            b = next(b for b in range(bins) if b == bins - 1 or bins * (t - t0) < (b + 1) * (t1 - t0))
        else:
            b = next(b for b in range(bins) if bins * i < (b + 1) * len(chosen))
        c, sign = channel(polarity, p, b, bins)
        grid[c, y, x] += sign
    return grid


def surface(events: Columns, tau_ns: int, shape: tuple[int, int], polarity: str, decay: str, at: int) -> np.ndarray:
    """The latest event of each pixel, looked for in all of them."""
    result = np.zeros((2, *shape) if polarity == "split" else (1, *shape))
    for y in range(shape[0]):
        for x in range(shape[1]):
            here = [(t, p) for t, ex, ey, p in rows(events, None) if (ex, ey) == (x, y) and t <= at]
            for c in range(len(result)):
                seen = [e for e in here if polarity != "split" or e[1] == c]
                if seen:
                    t, p = max(seen)
                    age = (at - t) / tau_ns
                    value = math.exp(-age) if decay == "exponential" else max(0.0, 1.0 - age)
                    result[c, y, x] = -value if polarity == "signed" and not p else value
    return result if polarity == "split" else result[0]
