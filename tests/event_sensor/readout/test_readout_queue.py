"""The readout: rate limit against queueing theory, nothing lost, and no dependence on how the stream is cut."""

import math

import numpy as np
import pytest

from evis.config.params import ParamError
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.readout.readout import Readout

MS = 1_000_000
WIDTH, HEIGHT = 40, 30


def stream(n, end_ns, seed=0, colour=False):
    """n events at random times in (0, end_ns], sorted by t, y, x."""
    rng = np.random.default_rng(seed)
    events = {
        "t": rng.integers(1, end_ns + 1, n),
        "x": rng.integers(0, WIDTH, n).astype(np.uint16),
        "y": rng.integers(0, HEIGHT, n).astype(np.uint16),
        "p": rng.integers(0, 2, n).astype(np.uint8),
    }
    if colour:
        events["c"] = rng.integers(0, 3, n).astype(np.uint8)
    order = np.lexsort((events["x"], events["y"], events["t"]))
    return {name: column[order] for name, column in events.items()}


def at_times(t):
    """One event per time, walking over the pixels."""
    n = np.arange(len(t))
    return {
        "t": np.asarray(t, np.int64), "x": (n % WIDTH).astype(np.uint16),
        "y": (n // WIDTH % HEIGHT).astype(np.uint16), "p": (n % 2).astype(np.uint8),
    }  # fmt: skip


def read(readout, events, edges, t_base=0):
    """All that comes out of packets that end at `edges`, flush included; every packet is checked."""
    packets = []
    for edge in edges:
        inside = (events["t"] > t_base) & (events["t"] <= edge)
        part = {name: column[inside] for name, column in events.items()}
        out, offsets = readout.apply(part, np.array([0, inside.sum()]), t_base, edge)
        assert offsets.tolist() == [0, len(out["t"])]
        assert ((out["t"] > t_base) & (out["t"] <= edge)).all()
        order = np.lexsort((out["x"], out["y"], out["t"]))
        assert all((out[name] == out[name][order]).all() for name in ("t", "y", "x"))
        packets.append(out)
        t_base = edge
    rest = readout.flush()
    if rest is not None:
        assert (rest[0]["t"] > t_base).all()
        packets.append(rest[0])
    return {name: np.concatenate([p[name] for p in packets]) for name in events}


def lindley(t, service):
    """Departure times in float64, one event after the other."""
    out, ready = [], -math.inf
    for arrival in t:
        leaves = max(float(arrival), ready)
        ready = leaves + service
        out.append(leaves)
    return np.array(out)


def test_below_the_rate_nothing_is_changed():
    events = stream(3000, 20 * MS, colour=True)
    for readout in (Readout(WIDTH, HEIGHT), Readout(WIDTH, HEIGHT, readout_rate=1e12)):
        got = read(readout, events, [20 * MS])
        assert all((got[name] == events[name]).all() for name in events)
    lone = at_times(np.arange(1, 100) * 10_000)
    got = read(Readout(WIDTH, HEIGHT, readout_rate=100_000), lone, [MS])
    assert (got["t"] == lone["t"]).all(), "events spaced by exactly the service time do not wait"


@pytest.mark.parametrize("rate", [1e6, 3e6, 7e7, 1.066e9])
def test_times_are_those_of_a_single_server(rate):
    events = stream(5000, MS)
    readout = Readout(WIDTH, HEIGHT, readout_rate=rate)
    got = read(readout, events, [MS])
    want = lindley(events["t"], 1e9 / rate)
    # Up to the next whole ns, and the service time is rounded to 5e-7 of itself.
    late = np.sort(got["t"]) - want
    assert late.min() > -1e-3 - 5e-7 * want[-1] and late.max() < 1 + 5e-7 * want[-1]
    for name in ("x", "y", "p"):
        assert np.bincount(got[name]).tolist() == np.bincount(events[name]).tolist()


def test_a_burst_leaves_at_the_rate_in_the_order_of_rows():
    """All 1200 pixels at once: the k-th leaves k service times later, row by row."""
    events = at_times(np.full(WIDTH * HEIGHT, 5000))
    readout = Readout(WIDTH, HEIGHT, readout_rate=1e7)
    got = read(readout, events, np.arange(1, 11) * 20_000)
    k = np.arange(WIDTH * HEIGHT)
    assert (got["t"] == 5000 + 100 * k).all()
    assert (got["y"] * WIDTH + got["x"] == k).all()
    assert readout.counts() == {"delayed": 1199, "delay_ns": 100 * 1199 * 1200 // 2, "dropped": 0, "cut": 0}
    assert readout.longest_ns == 119_900


def test_an_overload_grows_linearly_and_drains():
    """Arrivals at twice the rate for 1 ms: the n-th waits n times half a service time; all are out after 2 ms."""
    t = 1 + np.arange(1000) * 1000
    readout = Readout(WIDTH, HEIGHT, readout_rate=500_000)
    events = at_times(t)
    first, _ = readout.apply(events, np.array([0, 1000]), 0, MS)
    assert len(first["t"]) == 500 and readout.waiting == 500
    nothing = {name: column[:0] for name, column in events.items()}
    second, _ = readout.apply(nothing, np.zeros(2, np.int64), MS, 2 * MS)
    assert readout.waiting == 0 and readout.flush() is None
    assert (np.concatenate((first["t"], second["t"])) == 1 + 2000 * np.arange(1000)).all()
    assert readout.delay_ns == 1000 * 999 * 1000 // 2


def test_poisson_arrivals_wait_as_in_the_m_d_1_queue():
    """Mean wait of M/D/1 (Pollaczek-Khinchine): rho / (2 (1 - rho)) service times."""
    rng = np.random.default_rng(3)
    n, rho, service = 400_000, 0.7, 1000
    t = np.cumsum(rng.exponential(service / rho, n)).astype(np.int64) + 1
    readout = Readout(WIDTH, HEIGHT, readout_rate=1e9 / service)
    events = at_times(t)
    read(readout, events, [int(t[-1])])
    want = rho / (2 * (1 - rho)) * service
    assert abs(readout.delay_ns / n - want) < 0.03 * want


@pytest.mark.parametrize("jitter", [0.0, 30.0])
@pytest.mark.parametrize("rate", [0.0, 4e5, 1.066e9])
def test_packets_may_be_cut_anywhere(rate, jitter):
    events = stream(4000, 10 * MS, seed=5, colour=True)
    whole = read(Readout(WIDTH, HEIGHT, 1, rate, jitter, seed=9), events, [10 * MS])
    for edges in (np.arange(1, 11) * MS, np.arange(1, 1001) * 10_000, [1, 2, 3_333_333, 10 * MS]):
        got = read(Readout(WIDTH, HEIGHT, 1, rate, jitter, seed=9), events, [int(e) for e in edges])
        assert all(got[name].tobytes() == whole[name].tobytes() for name in events)
    assert len(whole["t"]) == 4000


def test_jitter_is_normal_about_three_sigma():
    t = np.arange(1, 200_001, dtype=np.int64) * 1_000_000
    readout = Readout(WIDTH, HEIGHT, timestamp_jitter_us=20, seed=4)
    got = read(readout, at_times(t), [int(t[-1])])
    delay = (np.sort(got["t"]) - t) / 1e3
    # 200,000 draws: the mean is known to 20 / 447, the deviation to 20 / 632; the cut at 3 sigma takes 0.25 % of it.
    assert abs(delay.mean() - 60) < 5 * 20 / 447
    assert abs(delay.std() - 20 * 0.9975) < 5 * 20 / 632
    assert delay.min() == 0 and delay.max() == 120
    below = np.mean(delay < 60 - 20), np.mean(delay < 60), np.mean(delay < 60 + 40)
    np.testing.assert_allclose(below, [0.15866, 0.5, 0.97725], atol=5e-3)
    assert abs(np.corrcoef(delay[1:], delay[:-1])[0, 1]) < 0.012


def test_times_below_zero_have_the_same_law():
    """A stream that begins at -10 ms: jitter of 3 sigma and 1 sigma, and a queue of 2 that is full."""
    t = np.sort(np.random.default_rng(3).integers(-9 * MS, -1 * MS, 4000))
    got = read(Readout(WIDTH, HEIGHT, timestamp_jitter_us=20.0), at_times(t), [2 * MS], -10 * MS)
    assert got["t"].mean() - t.mean() == pytest.approx(60_000, abs=5 * 20_000 / 4000**0.5)
    limited = Readout(WIDTH, HEIGHT, readout_rate=1e6, queue=2)
    left = read(limited, at_times(np.full(10, -5 * MS)), [0], -10 * MS)
    assert left["t"].tolist() == [-5 * MS, -5 * MS + 1000, -5 * MS + 2000] and limited.dropped == 7


def test_the_same_seed_gives_the_same_jitter_and_environment_k_that_of_seed_plus_k():
    events = stream(500, MS)
    ends = [int(e) for e in (MS, 2 * MS)]
    one, same, other = (read(Readout(WIDTH, HEIGHT, 1, 0, 5, seed=s), events, ends)["t"] for s in (7, 7, 8))
    assert one.tobytes() == same.tobytes() and one.tobytes() != other.tobytes()
    three = Readout(WIDTH, HEIGHT, 3, 0, 5, seed=6)
    columns = {name: np.tile(column, 3) for name, column in events.items()}
    out, offsets = three.apply(columns, np.arange(4) * 500, 0, 2 * MS)
    assert offsets.tolist() == [0, 500, 1000, 1500]
    assert out["t"][500:1000].tobytes() == one.tobytes() and out["t"][1000:].tobytes() == other.tobytes()


def test_jitter_is_that_of_the_episode_and_of_the_time_since_it_began():
    events, late = stream(500, MS), 3_000 * MS
    moved = {**events, "t": events["t"] + late}
    zeroth, again, moved_on, next_one = (Readout(WIDTH, HEIGHT, 1, 0, 5, seed=7) for _ in range(4))
    for readout, stamp, number in ((again, 0, 0), (moved_on, late, 0), (next_one, 0, 1)):
        readout.begin(np.ones(1, bool), stamp, np.array([number]))
    expected = read(zeroth, events, [2 * MS])["t"]
    assert (read(again, events, [2 * MS])["t"] == expected).all()
    assert (read(moved_on, moved, [late + 2 * MS], late)["t"] - late == expected).all()
    assert (read(next_one, events, [2 * MS])["t"] != expected).any()


def test_environments_queue_apart():
    quick, slow = at_times(np.arange(1, 11) * 10_000), at_times(np.full(50, 1000))
    columns = {name: np.concatenate((quick[name], slow[name], quick[name])) for name in quick}
    readout = Readout(WIDTH, HEIGHT, 3, readout_rate=100_000)
    out, offsets = readout.apply(columns, np.array([0, 10, 60, 70]), 0, 200_000)
    assert offsets.tolist() == [0, 10, 30, 40] and readout.waiting == 30
    assert (out["t"][:10] == quick["t"]).all() and (out["t"][30:] == quick["t"]).all()
    assert (out["t"][10:30] == 1000 + 10_000 * np.arange(20)).all()
    none = {name: column[:0] for name, column in columns.items()}
    out, offsets = readout.apply(none, np.zeros(4, np.int64), 200_000, 300_000)
    assert offsets.tolist() == [0, 0, 10, 10] and (out["t"] == 1000 + 10_000 * np.arange(20, 30)).all()


def test_a_new_episode_starts_with_an_empty_queue_and_counts_what_it_cut():
    events = at_times(np.full(50, 1000))
    columns = {name: np.tile(column, 2) for name, column in events.items()}
    readout = Readout(WIDTH, HEIGHT, 2, readout_rate=100_000)
    readout.apply(columns, np.array([0, 50, 100]), 0, 101_000)
    assert readout.waiting == 2 * 39
    later = {name: np.tile(column, 2) for name, column in at_times(np.array([150_000])).items()}
    readout.begin(np.array([False, True]), 101_000, np.array([0, 1]))
    out, offsets = readout.apply(later, np.array([0, 1, 2]), 101_000, 10 * MS)
    assert readout.counts()["cut"] == 39 and offsets.tolist() == [0, 40, 41]
    assert out["t"][40] == 150_000 and out["t"][39] == 1000 + 10_000 * 50


def test_a_limited_queue_drops_and_counts():
    """A burst of 100 at a queue of 10: one leaves at once, 10 wait, 89 are lost; a queue of 0 loses none."""
    events = at_times(np.full(100, 1000))
    readout = Readout(WIDTH, HEIGHT, readout_rate=1e6, queue=10)
    got = read(readout, events, [MS])
    assert (got["t"] == 1000 * np.arange(1, 12)).all() and readout.dropped == 89
    assert (got["x"] == np.arange(11)).all()
    free = Readout(WIDTH, HEIGHT, readout_rate=1e6)
    assert len(read(free, events, [MS])["t"]) == 100 and free.dropped == 0


def test_late_stamps_are_exact():
    """At 2^61 ns the queue still counts in units below a ns."""
    start = 2**61
    events = at_times(start + np.full(1000, 7))
    got = read(Readout(WIDTH, HEIGHT, readout_rate=1.6e9), events, [start + 5, start + 300, start + MS], start)
    assert (np.sort(got["t"]) == start + 7 + np.ceil(np.arange(1000) * 0.625).astype(np.int64)).all()


def test_large_images_and_long_packets_are_sorted_too():
    """Where time, row and column do not fit one 63-bit key."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(1, 2**41, 2000))
    events = at_times(t)
    events["x"] = rng.integers(0, 65536, 2000).astype(np.uint16)
    events["y"] = rng.integers(0, 65536, 2000).astype(np.uint16)
    got = read(Readout(65536, 65536, timestamp_jitter_us=1e6), events, [2**41 // 3, 2**41])
    assert len(got["t"]) == 2000 and (np.diff(got["t"]) >= 0).all()


@pytest.mark.parametrize(
    "params, text",
    [
        ({"readout_rate": 0.5}, "readout_rate 0.5 must be 0"),
        ({"readout_rate": math.inf}, "readout_rate inf"),
        ({"timestamp_jitter_us": -1}, "timestamp_jitter_us -1"),
        ({"queue": -1}, "queue -1"),
    ],
)
def test_misuse_has_one_clear_line(params, text):
    with pytest.raises(ValueError, match=text):
        Readout(WIDTH, HEIGHT, **params)


def test_a_rate_below_one_event_a_second_is_refused_before_the_start():
    with pytest.raises(ParamError, match=r"sensor: readout_rate is 0\.5 1/s; it is 0"):
        resolve_sensor("sensor", "ideal", {"readout_rate": 0.5})


def test_what_the_clock_cannot_hold_is_refused():
    with pytest.raises(ValueError, match="too long for the readout"):
        Readout(4, 4, readout_rate=1e12).apply(at_times(np.array([5])), np.array([0, 1]), 0, 2**40)
