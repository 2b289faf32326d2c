"""Distances added up as events come are those of the whole trains; pairs are as many as there can be."""

import numpy as np
import pytest

from evis.events.measure.distance import EventStream, victor_purpura
from nodes.audit.comparison import WITHIN_NS, Comparison

PIXELS = 7


def train(rng: np.random.Generator, rate: float):
    """Events of some pixels in 100 ms, in the order of time."""
    count = rng.poisson(rate * 0.1 * PIXELS)
    t = np.sort(rng.integers(0, 100_000_000, count))
    return rng.integers(0, PIXELS, count), t, rng.integers(0, 2, count).astype(np.uint8)


def stream(events) -> EventStream:
    pixel, t, p = events
    return EventStream(t, pixel.astype(np.uint16), np.zeros(len(t), np.uint16), p, PIXELS, 1)


@pytest.mark.parametrize("rate", [20, 300, 3000])
def test_in_parts_as_in_one(rate) -> None:
    rng = np.random.default_rng(rate)
    a, b = train(rng, rate), train(rng, rate)
    found = Comparison(PIXELS)
    for low, high in ((0, 13), (13, 50), (50, 51), (51, 100)):
        parts = [tuple(column[(e[1] > low * 1_000_000) & (e[1] <= high * 1_000_000)] for column in e) for e in (a, b)]
        found.add(*parts, high * 1_000_000)
    found.finish(np.ones(PIXELS, bool))
    kept = [tuple(c[e[1] > 0] for c in e) for e in (a, b)]
    total = sum(len(e[0]) for e in kept)
    assert found.events.sum() == total
    assert found.vp.sum() / total == pytest.approx(victor_purpura(stream(kept[0]), stream(kept[1]), 1.0), rel=1e-12)


def most_pairs(a: np.ndarray, b: np.ndarray) -> int:
    """By augmenting paths."""
    taken: dict[int, int] = {}

    def place(i: int, seen: set[int]) -> bool:
        for j in np.flatnonzero(np.abs(b - a[i]) <= WITHIN_NS).tolist():
            if j not in seen:
                seen.add(j)
                if j not in taken or place(taken[j], seen):
                    taken[j] = i
                    return True
        return False

    return sum(place(i, set()) for i in range(len(a)))


def test_pairs_are_as_many_as_there_can_be() -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        a, b = (np.sort(rng.integers(1, 30_000_000, rng.integers(0, 25))) for _ in range(2))
        found = Comparison(1)
        found.add(*((t * 0, t, np.ones(len(t), np.uint8)) for t in (a, b)), 1 << 60)
        found.finish(np.ones(1, bool))
        assert found.unpaired[0] == len(a) + len(b) - 2 * most_pairs(a, b)


def test_an_ended_episode_leaves_others_alone() -> None:
    found = Comparison(2)
    pixel, t, p = np.array([0, 1]), np.array([1_000_000, 1_000_000]), np.ones(2, np.uint8)
    none = np.zeros(0, np.int64)
    found.add((pixel, t, p), (none, none, p[:0]), 1_500_000)
    found.finish(np.array([True, False]))
    assert found.vp.tolist() == [1.0, 0.0]
    found.clear(np.array([True, False]))
    found.finish(np.array([False, True]))
    assert found.vp.tolist() == [0.0, 1.0]
