"""The sensor on a stream of frames: one at a time or many, from a generator, with its errors."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from nodes.event_sensor.simulate import Simulation, simulate, simulate_frames

MS = 1_000_000


def video(n=40, shape=(5, 6), seed=13):
    rng = np.random.default_rng(seed)
    level = np.cumsum(rng.normal(0, 0.15, (n, *shape)), axis=0)
    return np.exp(level).astype(np.float32), np.cumsum(rng.integers(1, 2 * MS, n))


def together(packets, names="txyp"):
    packets = list(packets)
    return {name: np.concatenate([getattr(p, name) for p in packets]) for name in names}


def same(a, b):
    for name in "txyp":
        np.testing.assert_array_equal(a[name], b[name])


@pytest.mark.parametrize("crossing", ["frame", "linear", "cubic"])
def test_single_frames_and_blocks_give_the_same_events(crossing):
    """(t, image) one by one, blocks of any size, all at once."""
    frames, t = video()
    whole = simulate_frames(frames, t, crossing=crossing)
    assert len(whole["t"]) > 300
    same(together(simulate(zip(t.tolist(), frames), crossing=crossing)), whole)
    cuts = [0, 1, 2, 9, 10, 33, 40]
    blocks = ((t[a:b], frames[a:b]) for a, b in itertools.pairwise(cuts))
    same(together(simulate(blocks, crossing=crossing)), whole)


def test_events_come_while_frames_do():
    """A generator is taken frame by frame: events of frame k are there before frame k + 1 is asked for."""
    asked = []

    def frames():
        for k in range(5):
            asked.append(k)
            yield k * MS, np.full((2, 2), np.exp(0.25 * k), np.float32)

    simulation = Simulation(threshold=0.2)
    for k, events in zip(range(5), simulation.events(frames())):
        assert asked == list(range(k + 1)) and simulation.frames == k + 1 and simulation.until_ns == k * MS
        assert len(events.t) == (0 if k == 0 else 4 * (int(0.25 * k / 0.2 + 1e-6) - int(0.25 * (k - 1) / 0.2 + 1e-6)))


def test_float64_and_colour_and_counts():
    """float64 frames are taken; colour gives c; counts are told."""
    frames, t = video()
    same(simulate_frames(frames.astype(np.float64), t), simulate_frames(frames, t))
    rgb = np.stack([frames, frames[::-1], frames * 0 + 1], axis=-1)
    rgb[3, 2, 2, 2] = np.inf
    colour = simulate_frames(rgb, t)
    assert int(colour["nonfinite"]) == 1
    for c, channel in enumerate((frames, frames[::-1])):
        here = colour["c"] == c
        want = simulate_frames(channel, t)
        same({name: colour[name][here] for name in "txyp"}, want)
    assert not (colour["c"] == 2).any()


def test_parameters_come_from_the_table():
    """Given over preset over default; a wrong name or value is an error before any frame."""
    assert Simulation(threshold=None).parameters["threshold"] == 0.2
    assert Simulation(threshold="0.3", refractory_us=5).parameters["threshold"] == 0.3
    for options, text in (
        ({"treshold": 0.3}, "no parameter 'treshold'; did you mean 'threshold'"),
        ({"threshold": -1}, "the least is 0.001"),
        ({"preset": "ideel"}, "preset is 'ideel'"),
    ):
        with pytest.raises(ValueError, match=text):
            Simulation(**options)


GOOD = np.ones((2, 3), np.float32)


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ([(0, GOOD), (5, np.ones((3, 2), np.float32))], "a frame of 3 x 2 at 5 ns, the frames before are 2 x 3"),
        ([(0, GOOD), (0, GOOD)], "after one at 0 ns"),
        ([(0, GOOD), (-1, GOOD)], "-1 ns after one at 0 ns"),
        ([(0.5, GOOD)], "t is float64, must be whole nanoseconds"),
        ([(0, np.ones((2, 3), np.uint8))], "a frame of uint8, must be float32 and linear"),
        ([(0, np.ones((2, 3, 2), np.float32))], r"a frame must be \[H, W\] or \[H, W, 3\]"),
        ([(0, np.ones(3, np.float32))], "a frame must be"),
        ([(np.arange(2), GOOD[None])], "a frame must be"),
        ([GOOD], "frames must be tuples"),
        ([(0, GOOD, np.ones((3, 2)))], "must have the same shape"),
    ],
)
def test_frames_that_do_not_fit(frames, text):
    """One error each, after the events of the frames before."""
    simulation = Simulation()
    with pytest.raises(ValueError, match=text):
        list(simulation.events(iter(frames)))
    assert simulation.frames == len(frames) - 1


def test_a_failing_source_ends_after_its_good_frames():
    """Events of all frames before the failure come first, also those that look-ahead holds."""
    frames, t = video()

    def broken():
        yield from zip(t[:20].tolist(), frames[:20])
        raise OSError("the disk is gone")

    for crossing in ("linear", "cubic"):
        seen = []
        with pytest.raises(OSError, match="the disk is gone"):
            for events in simulate(broken(), crossing=crossing):
                seen.append(events)
        same(together(seen), simulate_frames(frames[:20], t[:20], crossing=crossing))
