"""Lone events, against all pairs of events and against the statistics of Poisson noise."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from evis.events import Events
from evis.events.filters import ActivityFilter


def beside_another(events: Events, within_ns: int) -> np.ndarray:
    """Looks at every pair: the latest event before, in order of coming, of each of the eight neighbours."""
    kept = []
    for i in range(len(events)):
        dx = np.abs(events.x[:i].astype(int) - int(events.x[i]))
        dy = np.abs(events.y[:i].astype(int) - int(events.y[i]))
        latest: dict[tuple[int, int], int] = {}
        for j in np.flatnonzero((dx <= 1) & (dy <= 1) & (dx + dy > 0)):
            latest[int(events.x[j]), int(events.y[j])] = int(events.t[j])
        kept.append(any(int(events.t[i]) - t <= within_ns for t in latest.values()))
    return np.array(kept)


@pytest.mark.parametrize("within_ns", [1, 300, 5000])
def test_every_pair_of_events(within_ns):
    """Times with repetitions and some steps back, in blocks of any length, to the sides of the sensor."""
    rng = np.random.default_rng(2)
    t = np.sort(rng.integers(0, 40_000, 800))
    late = rng.random(800) < 0.02
    t[late] -= rng.integers(0, 500, int(late.sum()))
    events = Events.of(t - 10_000, rng.integers(0, 9, 800), rng.integers(0, 7, 800), rng.integers(0, 2, 800))
    truth = beside_another(events, within_ns)
    assert 0 < truth.sum() < 800
    quiet = ActivityFilter(9, 7, within_ns)
    cuts = [0, 1, 1, 130, 131, 600, 800]
    assert np.concatenate([quiet.keep(events[a:b]) for a, b in pairwise(cuts)]).tolist() == truth.tolist()


def test_noise_is_left_out_as_chance_has_it():
    """Independent Poisson noise of rate f: an event stays with probability 1 - exp(-8 f T), for all neighbours must be
    silent during T. 200,000 events; five standard deviations."""
    rng = np.random.default_rng(3)
    side, rate_hz, seconds, within_ns = 66, 5.0, 10.0, 10_000_000
    n = rng.poisson(rate_hz * seconds * side * side)
    t = np.sort(rng.integers(0, int(seconds * 1e9), n))
    events = Events.of(t, rng.integers(0, side, n), rng.integers(0, side, n), rng.integers(0, 2, n))
    kept = ActivityFilter(side, side, within_ns).keep(events)
    inner = (events.x > 0) & (events.x < side - 1) & (events.y > 0) & (events.y < side - 1) & (events.t > within_ns)
    stays = 1 - np.exp(-8 * rate_hz * within_ns * 1e-9)
    spread = np.sqrt(stays * (1 - stays) / inner.sum())
    assert kept[inner].mean() == pytest.approx(stays, abs=5 * spread)


def test_a_moving_edge_stays():
    """Columns that fire one after another, 1 ms apart: all but the first one's first event has a neighbour."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(40), np.arange(30), indexing="ij"))
    events = Events.of(x * 1_000_000, x, y, np.ones(1200, int))
    assert ActivityFilter(40, 30, 1_000_000).keep(events).tolist() == [False, *[True] * 1199]
    alone = ActivityFilter(40, 30, 999_999).keep(events)  # too short for the column before, not for the row above
    assert np.flatnonzero(~alone).tolist() == list(range(0, 1200, 30))


def test_events_outside_of_the_sensor_are_kept_and_touch_nothing():
    """The first that is inside, at the corner, is alone though one outside lies beside it."""
    events = Events.of([0, 1, 2], [3, 9, 2], [0, 9, 0], [1, 1, 1])
    assert ActivityFilter(3, 2, 100).keep(events).tolist() == [True, True, False]


def test_a_time_without_length_is_refused():
    with pytest.raises(ValueError, match="within_ns is 0"):
        ActivityFilter(3, 2, 0)
