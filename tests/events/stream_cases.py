"""Comparisons and random streams that the stream tests share."""

from __future__ import annotations

import hashlib

import numpy as np

from evis.events import Events, Triggers


def sha256_us(events: Events) -> str:
    """The ground truth's hash: t (us), x, y, p as little-endian arrays, one after the other."""
    digest = hashlib.sha256()
    for array in (events.t // 1000, events.x, events.y, events.p):
        digest.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def same(a: Events, b: Events) -> None:
    """Both have the same bits, triggers included."""
    for name in "txyp":
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
        assert getattr(a, name).dtype == getattr(b, name).dtype
    for name in ("t", "id", "value"):
        np.testing.assert_array_equal(getattr(a.triggers, name), getattr(b.triggers, name), err_msg=f"trigger {name}")


def random_events(seed: int, n: int, *, start_us: int = 0, step_us: int = 40, triggers: int = 0) -> Events:
    """Events with rows that fire together, repeats, and times that now and then step back by some us."""
    rng = np.random.default_rng(seed)
    t = start_us + np.sort(rng.integers(0, max(n * step_us // 8, 1), n))
    back = rng.integers(0, n, n // 20)
    t[back] = np.maximum(t[back] - rng.integers(1, 9, len(back)), start_us)
    x, y = rng.integers(0, 640, n), np.repeat(rng.integers(0, 480, n), rng.integers(1, 8, n))[:n]
    run = rng.random(n) < 0.6
    run[0] = False
    first = np.maximum.accumulate(np.where(run, 0, np.arange(n)))
    x = (x[first] + 2 * (np.arange(n) - first)) % 640
    t, p = t[first], rng.integers(0, 2, n)[first]
    events = Events.of(t * 1000, x, y[first], p)
    if triggers:
        edges = np.sort(rng.integers(start_us, int(t.max()) + 2, triggers))
        events.triggers = Triggers(
            edges * 1000, rng.integers(0, 16, triggers).astype(np.uint8), rng.integers(0, 2, triggers).astype(np.uint8)
        )
    return events
