"""Bursts of a stream that is written down."""

import numpy as np

from evis.events.measure.bursts import GAP_NS, bursts_of

MS = 1_000_000


def test_bursts_and_their_intervals():
    """Pixel 7 fires ON at 1, 2, 4 ms, OFF at 10, 11, 13, 16 ms, ON twice later; pixel 9 in between, too few."""
    rows = [(1, 7, 1), (2, 7, 1), (3, 9, 1), (4, 7, 1), (10, 7, 0), (11, 7, 0), (12, 9, 1), (13, 7, 0), (16, 7, 0)]
    rows += [(200, 7, 1), (201, 7, 1)]
    t, pixel, p = np.array(rows).T
    found = bursts_of(t * MS, pixel, p)
    assert found.pixel.tolist() == [7, 7] and found.p.tolist() == [1, 0]
    assert (found.start // MS).tolist() == [1, 10] and (found.length // MS).tolist() == [3, 6]
    assert found.count.tolist() == [3, 4]
    assert (found.interval // MS).tolist() == [1, 2, 1, 2, 3] and found.interval_p.tolist() == [1, 1, 0, 0, 0]


def test_a_gap_ends_a_burst():
    t = np.array([0, 1, 2, 2 + GAP_NS, 3 + GAP_NS, 4 + 2 * GAP_NS, 5 + 2 * GAP_NS, 6 + 2 * GAP_NS])
    found = bursts_of(t, np.zeros(len(t), int), np.ones(len(t), int))
    assert found.count.tolist() == [5, 3]
    assert not len(bursts_of(t[:0], t[:0], t[:0]).start)
