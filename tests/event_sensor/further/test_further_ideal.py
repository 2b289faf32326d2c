"""Further samples between frames: a pixel has the events that frames at all of its samples would give it."""

import math

import numpy as np
import pytest
from further_rig import WRONG, Gap, in_parts, merged, no_further, random_gaps, sensed, sensed_alone
from hypothesis import given, settings
from hypothesis import strategies as st

from nodes.event_sensor.sensor import EventSensor, Further

SHAPES = st.sampled_from([(1, 3, 4), (3, 2, 3), (2, 1, 20), (1, 2, 2, 3), (2, 1, 2, 3)])


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32), SHAPES, st.sampled_from([1, 2, 9, 20]), st.sampled_from([0.5, 4.0, 40.0]),
       st.sampled_from([33_333_333, 41, 12]), st.sampled_from([0.0, 0.1]))  # fmt: skip
def test_events_are_those_of_frames_at_all_samples(seed, shape, frames, rate, length, dark):
    gaps = random_gaps(np.random.default_rng(seed), shape, 2, frames, rate, 0.08, length)
    params = {"dark_level": dark, "threshold": 0.3}
    found, sensor = sensed(gaps, **params)
    expected, counts = sensed_alone(gaps, **params)
    assert sorted(found) == sorted(expected)
    assert sensor.counts() == counts


def exact_events(t, light, threshold):
    """(t, p) in float64, one sample after the other: equations (3) and (4), crossings on lines of ln I."""
    found, reference, before = [], math.log(light[0]), (t[0], math.log(light[0]))
    for now, value in zip(t[1:].tolist(), np.log(light[1:].astype(np.float64)).tolist()):
        while abs(value - reference) >= threshold - 2.0**-21:
            reference += math.copysign(threshold, value - reference)
            place = (reference - before[1]) / (value - before[1])
            found.append((before[0] + max(min(place, 1.0) * (now - before[0]), 0.0), int(value > before[1])))
        before = (now, value)
    return found


def test_events_against_float64():
    """Of 60 pixels with 0 to 40 samples a gap; the sensor rounds to ns, and never to the step's start."""
    gaps = random_gaps(np.random.default_rng(5), (2, 5, 6), 3, 4, 20.0, bad=0.0)
    found, _ = sensed(gaps, threshold=0.15)
    for env, y, x in np.ndindex(2, 5, 6):
        lists = [merged(gap, env, y, x) for gap in gaps]
        expected = exact_events(*(np.concatenate(part) for part in zip(*lists)), 0.15)
        mine = [(e[1], e[5]) for e in found if (e[0], e[2], e[3]) == (env, y, x)]
        assert [p for _, p in mine] == [p for _, p in expected]
        assert max(abs(a[0] - b[0]) for a, b in zip(mine, expected)) <= 0.51 + 1e-6


def test_pixels_without_any_are_as_in_frames_alone():
    """The same bytes, beside others that have further samples and beside none."""
    gaps = random_gaps(np.random.default_rng(2), (1, 20, 30), 2, 9, 6.0)
    bare = [Gap(gap.start, gap.t, gap.frames, no_further((1, 20, 30))) for gap in gaps]
    found, plain = sensed(gaps)[0], sensed(bare)[0]
    sensor, frames = EventSensor(20, 30), []
    for gap in gaps:
        frames.append(sensor.process(gap.frames, gap.t, np.zeros(1, np.int32)))
    assert [event[1] for event in plain] == np.concatenate([e.t for e in frames]).tolist()
    with_some = {(y, x) for gap in gaps for y, x in np.argwhere(np.diff(gap.further.first).reshape(20, 30)).tolist()}
    some = [event for event in plain if (event[2], event[3]) not in with_some]
    assert len(some) > 1000
    assert some == [event for event in found if (event[2], event[3]) not in with_some]


@pytest.mark.parametrize("split", [1, 2, 5])
def test_any_split_of_a_gap_gives_the_same(split):
    gaps = random_gaps(np.random.default_rng(9), (2, 4, 5), 3, 10, 12.0)
    assert sorted(sensed(in_parts(gaps, split))[0]) == sorted(sensed(gaps)[0])


def test_an_episode_begins_with_its_first_frame():
    """Further samples after it count from it; those of an environment that goes on, from the stamp before."""
    rng = np.random.default_rng(3)
    sensor = EventSensor(1, 1, 2)
    first = rng.uniform(1, 2, (2, 2, 1, 1)).astype(np.float32)
    further = Further(np.array([0, 1, 2]), np.array([40, 60]), np.array([9.0, 0.1]))
    events = sensor.process(first, np.array([1000, 1100]), np.array([0, 0], np.int32), further=further)
    assert ((events.t > 1000) & (events.t <= 1100)).all() and len(events.t) > 20
    late = Further(np.array([0, 1, 2]), np.array([10, 160]), np.array([9.0, 0.1]))
    again = sensor.process(first, np.array([1200, 1300]), np.array([0, 1], np.int32), further=late)
    assert again.t[: again.env_offsets[1]].min() < 1110
    assert again.t[again.env_offsets[1] :].min() > 1200
    early = Further(np.array([0, 0, 1]), np.array([10]), np.array([9.0]))
    with pytest.raises(ValueError, match="x 0, y 0 of environment 1 are before the first frame of its episode"):
        sensor.process(first, np.array([1400, 1500]), np.array([0, 2], np.int32), further=early)


def test_more_events_than_there_is_room_for():
    """Two hundred thresholds a sample: lists grow and the launch goes on."""
    gaps = random_gaps(np.random.default_rng(4), (1, 3, 4), 1, 3, 30.0)
    found, _ = sensed(gaps, threshold=0.005)
    expected, _ = sensed_alone(gaps, threshold=0.005)
    assert len(found) > 50_000 and sorted(found) == sorted(expected)


@pytest.mark.parametrize(("first", "offset", "value", "text"), WRONG)
def test_what_is_wrong_is_named(first, offset, value, text):
    sensor = EventSensor(1, 2)
    frames = np.ones((1, 2, 1, 2), np.float32)
    sensor.process(frames[:, :1], np.array([100]), np.zeros(1, np.int32))
    further = Further(np.array(first), np.array(offset), np.array(value))
    with pytest.raises(ValueError, match=text):
        sensor.process(frames, np.array([104, 110]), np.zeros(1, np.int32), further=further)
    events = sensor.process(frames, np.array([104, 110]), np.zeros(1, np.int32))
    assert len(events.t) == 0  # nothing of the wrong message is left


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"crossing": "cubic"}, "crossing=cubic is for frames alone"),
        ({"crossing": "frame"}, "crossing=frame is for frames alone"),
        ({"defocus_px": 1.0}, "blurs whole frames"),
        ({"model": "evis-paper", "leak_model": "bernoulli"}, "event model evis-paper takes frames alone"),
    ],
)
def test_who_takes_frames_alone(params, text):
    sensor = EventSensor(1, 2, **params)
    further = Further(np.array([0, 0, 1]), np.array([3]), np.array([1.0]))
    with pytest.raises(ValueError, match=text):
        sensor.process(np.ones((1, 1, 1, 2), np.float32), np.array([10]), np.zeros(1, np.int32), further=further)
