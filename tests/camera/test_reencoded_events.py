"""What a recording holds that a camera's wire does not: left out and counted, put in order, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from usb_rig import joined, played, run

from evis.events import Events, open_writer
from evis.events.arrays import Triggers

US = 1000


def recorded(path, t_us, edges_us=(), values=()) -> Events:
    """One event per time on a 128x128 sensor, and triggers of channel 0; what was written."""
    n = len(t_us)
    events = Events.of(np.array(t_us) * US, np.arange(n) % 128, np.arange(n) // 128, np.arange(n) % 2)
    edges = np.array(edges_us, np.int64) * US
    events.triggers = Triggers(edges, np.zeros(len(edges), np.uint8), np.array(values, np.uint8))
    with open_writer(path, 128, 128) as writer:
        writer.write(events)
    return events


def test_falling_edges_are_left_out_of_a_dvs128(tmp_path):
    """Its wire has rising ones only: the others are counted, and all events come."""
    sent = recorded(tmp_path / "a.h5", range(1, 2000), range(10, 90, 10), [0, 1] * 4)
    driver = played("dvs128", tmp_path / "a.h5")
    got = joined(run(driver))
    assert got.triggers.t.tolist() == [t * US for t in range(20, 90, 20)] and got.triggers.value.all()
    np.testing.assert_array_equal(got.t, sent.t)
    assert driver.counters() == {"triggers_left_out": 4}


def test_a_dvs128_gets_events_and_triggers_in_order(tmp_path):
    """Also where they step back over a turn of its counter and from one stretch of 20 ms to the next."""
    t = [*range(100_000, 100_500), *range(1000, 61_000, 100)]
    recorded(tmp_path / "a.h5", t, [60_000, 30_000, 500], [1] * 3)
    driver = played("dvs128", tmp_path / "a.h5")
    got = joined(run(driver))
    assert got.t.tolist() == [v * US for v in sorted(t)]
    assert got.triggers.t.tolist() == [500 * US, 30_000 * US, 60_000 * US]
    assert driver.counters() == {"events_reordered": 600, "triggers_reordered": 2}


@pytest.mark.parametrize("name", ["dvxplorer_mini", "dvxplorer_micro", "dvxplorer", "davis346", "dvs128", "evk4"])
def test_negative_times_are_refused(name, tmp_path):
    """By every wire, none moves them to 0."""
    recorded(tmp_path / "a.npz", range(-50, 50))
    with pytest.raises(ValueError, match=r"negative time -50000 ns; use --rebase"):
        run(played(name, tmp_path / "a.npz"))
