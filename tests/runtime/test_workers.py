"""CPU time that threads spend for a node counts as that node's; shares of work are whole."""

import threading
import time

import numpy as np
import pytest

from evis.runtime import workers as module
from evis.runtime.profile import Profile
from evis.runtime.workers import Workers, edges_of, spent_by_workers

EACH_S = 0.05


def busy(seconds: float) -> None:
    began = time.thread_time()
    while time.thread_time() - began < seconds:
        pass


@pytest.mark.parametrize(("count", "parts"), [(0, 3), (2, 5), (7, 7), (260, 16), (1 << 31, 3)])
def test_shares_are_equal_and_leave_nothing_out(count: int, parts: int) -> None:
    edges = edges_of(count, parts)
    sizes = np.diff(edges)
    assert len(sizes) == parts and edges[0] == 0 and edges[-1] == count
    assert sizes.min() >= 0 and sizes.max() - sizes.min() <= 1


def test_the_node_that_gives_work_is_charged_for_it() -> None:
    profile, workers = Profile(), Workers(2)
    began = time.process_time()
    with profile.inside("interpolator") as interpolator:
        list(workers.map(busy, [EACH_S] * 4))
    whole = time.process_time() - began
    with profile.inside("sensor") as sensor:
        busy(EACH_S)
    assert 4 * EACH_S <= interpolator.cpu_s <= whole + 1e-3
    assert EACH_S <= sensor.cpu_s < 2 * EACH_S


def test_what_other_threads_give_counts_for_them() -> None:
    workers, found = Workers(1), []
    before = spent_by_workers()

    def give() -> None:
        list(workers.map(busy, [EACH_S]))
        found.append(spent_by_workers())

    other = threading.Thread(target=give)
    other.start()
    other.join()
    assert found[0] >= EACH_S and spent_by_workers() == before


def test_a_call_that_fails_fails_where_it_was_given() -> None:
    def fails() -> None:
        busy(EACH_S)
        raise ValueError("no light")

    before = spent_by_workers()
    with pytest.raises(ValueError, match="no light"):
        Workers(1).submit(fails).result()
    assert spent_by_workers() - before >= EACH_S


def test_nothing_piles_up_where_nobody_asks() -> None:
    spent_by_workers()
    workers = Workers(1)
    for _ in range(1000):
        workers.submit(busy, 0.0).result()
    assert len(module._ledger.fresh) <= 1
