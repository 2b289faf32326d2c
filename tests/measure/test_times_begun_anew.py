"""A stream whose times begin anew, as those of a bag of several episodes: measured as if one came behind the other."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import pytest
from rotating_events import texture, turning_edges

from evis.bag.writer import BagWriter
from evis.cli.events import info
from evis.events.measure import Measurement
from evis.events.stretches import Stretches
from msgs.camera import EventPacket
from msgs.header import Header

MS = 1_000_000
SIZE = (32, 24)


def even(events: int, length_ns: int, begin_ns: int = 0) -> np.ndarray:
    """Events at equal distances, one at each end."""
    return begin_ns + np.linspace(0, length_ns, events).astype(np.int64)


def measured(*stretches: np.ndarray, block: int = 700) -> dict:
    """Of events that go round over the pixels, in blocks that know nothing of stretches."""
    measurement = Measurement(*SIZE, rotation=False)
    t = np.concatenate(stretches)
    k = np.arange(len(t))
    x, y = (k * 7 % 32).astype(np.uint16), (k * 5 % 24).astype(np.uint16)
    for a in range(0, len(t), block):
        part = slice(a, a + block)
        measurement.add(t[part], x[part], y[part], (k[part] % 2).astype(np.uint8))
    return measurement.report()


@pytest.mark.parametrize("block", [700, 1001, 10_000])
def test_rates_of_episodes_are_those_of_one_behind_the_other(block: int) -> None:
    """1,001 events in 500 ms, three times, of which the second began later and the third is the shortest."""
    episodes = even(1001, 500 * MS), even(1001, 500 * MS, 30 * MS), even(601, 300 * MS)
    result = measured(*episodes, block=block)
    assert (result["times_begun_anew"], result["time_steps_back"], result["events"]) == (2, 0, 2603)
    assert result["duration_s"] == pytest.approx(1.3)
    assert result["event_rate_hz"] == pytest.approx(2603 / 1.3)
    # One event ends an episode where the next one begins, and one the last window.
    assert all(1900 <= rate <= 2300 for _, rate in result["rate"]["series"][:-1])
    assert result["t_last_ns"] == 1300 * MS


def test_events_out_of_order_begin_nothing() -> None:
    t = even(1001, 500 * MS)
    t[500] -= 90 * MS
    result = measured(t)
    assert (result["times_begun_anew"], result["time_steps_back"]) == (0, 1)


def test_a_rotation_does_not_reach_over_the_end_of_an_episode() -> None:
    """Each turns by 45 rad/s from its own start on; as one path the angle would leap."""
    t, x, y, p = turning_edges(lambda t: 45 * t, 0.4, texture(count=12))
    measurement = Measurement(120, 100)
    for _ in range(2):
        measurement.add(np.asarray(t), np.asarray(x, np.uint16), np.asarray(y, np.uint16), np.asarray(p, np.uint8))
    result = measurement.report()
    assert result["rotation"]["omega_rad_s"] == pytest.approx(45, rel=0.01)
    assert result["times_begun_anew"] == 1


@pytest.mark.parametrize("ends", [(-(2**63), 2**63 - 1), (2**63 - 1, -(2**63)), (0, 2**63 - 1)])
def test_times_at_the_ends_of_what_there_is_do_not_wrap(ends: tuple[int, int]) -> None:
    t = np.array([*ends, *ends, 5, 5 + 10**9, 7], np.int64)
    stretches, last = Stretches(), None
    found = [(times, anew) for _, times, anew in stretches.parts(t)]
    assert sum(len(times) for times, _ in found) == len(t) and sum(anew for _, anew in found) == stretches.begun_anew
    for times, anew in found:
        assert not anew or (last is not None and times[0] >= last)
        last = int(times.max())


def test_info_of_a_bag_of_two_episodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with BagWriter(tmp_path / "run.mcap") as bag:
        for k in range(20):
            stamp, n = (k % 10 + 1) * 20 * MS, 40
            t, zeros, on = even(n, 19 * MS, stamp - 20 * MS), np.zeros(n, np.uint16), np.ones(n, np.uint8)
            header, offsets = Header(stamp, k, episode=k // 10), np.array([0, n])
            packet = EventPacket(header, offsets, t=t, x=zeros, y=zeros, p=on, width=4, height=3)
            bag.write("/cam0/events", packet)
    parser = argparse.ArgumentParser()
    info.add_arguments(parser)
    result = info.run(parser.parse_args([str(tmp_path / "run.mcap")]))
    counts, bin_ns = result["rate_histogram"]["counts"], result["rate_histogram"]["bin_ns"]
    assert result["times_begun_anew"] == 1 and result["events"] == sum(counts) == 800
    assert (len(counts) - 1) * bin_ns <= 398 * MS < len(counts) * bin_ns  # 199 ms twice
    assert max(counts) < 2.5 * 800 / len(counts)
    assert json.dumps(result) and not capsys.readouterr().err
