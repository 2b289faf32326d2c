"""The metrics against values worked out by hand, and the spike-train distance against a direct recursion."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evis.events.measure.distance import (
    EventStream,
    count_error,
    event_frame_error,
    log_error,
    time_error,
    victor_purpura,
)


def stream(*events: tuple[float, int, int, int]) -> EventStream:
    """Events (t in us, x, y, p) on a 4 x 3 sensor."""
    rows = sorted(events)
    t, x, y, p = (np.array([r[i] for r in rows]) for i in range(4)) if rows else (np.zeros(0),) * 4
    return EventStream(
        np.round(t * 1000).astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8), 4, 3
    )


BASE = stream((100, 0, 0, 1), (200, 0, 0, 1), (300, 1, 2, 0))


def test_equal_streams_have_no_error() -> None:
    assert count_error(BASE, BASE) == victor_purpura(BASE, BASE, 1.0) == event_frame_error(BASE, BASE) == 0.0
    assert time_error(BASE, BASE) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("test", "expected"),
    [
        (stream((100, 0, 0, 1), (300, 1, 2, 0)), 1 / 3),  # one missing
        (stream((100, 0, 0, 1), (200, 0, 0, 0), (300, 1, 2, 0)), 2 / 3),  # wrong polarity: one missing, one too many
        (stream(), 1.0),
    ],
)
def test_count(test: EventStream, expected: float) -> None:
    assert count_error(test, BASE) == pytest.approx(expected)


def test_victor_purpura_by_hand() -> None:
    """A shift of 0.5 ms costs 0.5 at 1/ms; at 10/ms it is cheaper to delete and insert (2)."""
    a, b = stream((1000, 0, 0, 1)), stream((1500, 0, 0, 1))
    assert victor_purpura(a, b, 1.0) == pytest.approx(0.5 / 2)
    assert victor_purpura(a, b, 10.0) == pytest.approx(2.0 / 2)
    assert victor_purpura(stream((1000, 0, 0, 1)), stream((1000, 0, 0, 0)), 1.0) == pytest.approx(1.0)
    assert victor_purpura(stream(), b, 1.0) == pytest.approx(1.0)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 5000), max_size=6), st.lists(st.integers(0, 5000), max_size=6), st.floats(0.1, 10))
def test_victor_purpura_is_the_recursion(a: list[int], b: list[int], q: float) -> None:
    a, b = sorted(a), sorted(b)

    @functools.cache
    def g(i: int, j: int) -> float:
        if not i or not j:
            return i + j
        return min(g(i - 1, j) + 1, g(i, j - 1) + 1, g(i - 1, j - 1) + q * abs(a[i - 1] - b[j - 1]) * 1e-3)

    streams = [stream(*((t, 2, 1, 1) for t in train)) for train in (a, b)]
    n = len(a) + len(b)
    assert victor_purpura(*streams, q) == pytest.approx(g(len(a), len(b)) / n if n else 0.0)


def test_event_frames_by_hand() -> None:
    """Moved over a bin's edge: frames (1) and (0, 1) differ by two cells of one; sqrt(2) / 1."""
    assert event_frame_error(stream((100, 0, 0, 1), (1200, 0, 0, 1)), stream((100, 0, 0, 1), (200, 0, 0, 1))) == (
        pytest.approx(np.sqrt(1 + 1) / 2)
    )
    assert event_frame_error(stream((100, 0, 0, 0)), stream((100, 0, 0, 1))) == pytest.approx(2.0)


def test_event_frames_are_those_of_a_dictionary(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random events, every event frame summed by itself, with as few at a time as can be."""
    monkeypatch.setattr("evis.events.measure.distance.CELLS_AT_ONCE", 1)
    rng = np.random.default_rng(3)
    pair = [
        stream(*zip(rng.integers(1000, 9000, n), rng.integers(0, 4, n), rng.integers(0, 3, n), rng.integers(0, 2, n)))
        for n in (90, 70)
    ]
    first = min(s.t[0] for s in pair)
    sums: list[dict[tuple[int, int, int], int]] = [{}, {}]
    for s, total in zip(pair, sums):
        for t, x, y, p in zip(s.t, s.x, s.y, s.p):
            key = (int(t - first) // 1_000_000, int(x), int(y))
            total[key] = total.get(key, 0) + (1 if p else -1)
    keys = {*sums[0], *sums[1]}
    difference = sum((sums[0].get(key, 0) - sums[1].get(key, 0)) ** 2 for key in keys)
    expected = np.sqrt(difference / sum(v**2 for v in sums[1].values()))
    assert event_frame_error(*pair) == pytest.approx(expected, rel=1e-12) and expected > 0.5


def test_time_error_by_hand() -> None:
    test = stream((130, 0, 0, 1), (190, 0, 0, 1), (300, 1, 2, 0))
    median, most = time_error(test, BASE)
    assert median == pytest.approx(10.0) and 10.0 < most <= 30.0
    assert time_error(stream((0, 3, 2, 1)), BASE) == (0.0, 0.0)


@given(st.lists(st.tuples(st.integers(0, 10**14), st.integers(0, 3)), min_size=1, max_size=12), st.integers(0, 10**14))
@settings(deadline=None)
def test_time_error_over_hours_on_a_large_sensor(events: list[tuple[int, int]], later: int) -> None:
    """A day in ns times the pixels of 1280 x 720 is more than an int64 holds; against a search in plain numbers."""

    def on_a_large_sensor(rows: list[tuple[int, int]]) -> EventStream:
        t, corner = (np.array([row[i] for row in sorted(rows)]) for i in range(2))
        x, y = ((corner % 2 * 1279).astype(np.uint16), (corner // 2 * 719).astype(np.uint16))
        return EventStream(t.astype(np.int64), x, y, np.ones(len(t), np.uint8), 1280, 720)

    rest = [(t // 2 + later, corner) for t, corner in events]
    nearest = [min(abs(t - other) for other, place in rest if place == corner) / 1e3 for t, corner in sorted(events)]
    found = time_error(on_a_large_sensor(rest), on_a_large_sensor(events))
    assert found == pytest.approx((np.quantile(nearest, 0.5), np.quantile(nearest, 0.9)), rel=1e-12)


def test_log_error_by_hand() -> None:
    """Two of four lit pixels are e times too bright: rms of (1, 1, 0, 0) over a threshold of 0.5; sky is left out."""
    reference = np.array([[2.0, 3.0, 0.5, 1e-3, 0.0]], np.float32)
    frames = reference * np.array([np.e, 1 / np.e, 1, 1, 1], np.float32)
    assert log_error(frames, reference, 0.5) == pytest.approx(np.sqrt(0.5) / 0.5, rel=1e-6)
    assert log_error(reference, reference, 0.5) == 0.0
    assert not np.isfinite(log_error(np.zeros_like(reference), reference, 0.5))
