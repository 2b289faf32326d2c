"""Faults with further samples: the same pixel as on frames at all of its samples; rates and dead times as they were."""

import math

import numpy as np
import pytest
from further_rig import Gap, random_gaps, sensed, sensed_alone

from nodes.event_sensor.input.further import Further

S = 1_000_000_000
FAULTS = {
    "dead time": {"refractory_us": 300.0, "shot_rate": 20.0},
    "leak": {"leak_rate": 30.0, "leak_jitter": 0.3},
    "coin": {"leak_rate": 50.0, "leak_model": "bernoulli"},
    "noise": {"shot_rate": 200.0, "shot_white": 3.0, "dark_level": 0.01},
    "all": {
        "threshold_mismatch": 0.05, "leak_rate": 5.0, "shot_rate": 50.0, "refractory_us": 100.0, "marked": True,
        "hot_pixel_fraction": 0.2, "hot_pixel_rate": 300.0, "event_cap": 3,
    },
    "readout": {"readout_rate": 1e6, "timestamp_jitter_us": 5.0, "shot_rate": 20.0},
}  # fmt: skip


@pytest.mark.parametrize("fault", [name for name in FAULTS if name != "readout"])
@pytest.mark.parametrize(("shape", "length"), [((2, 3, 4), 33_333_333), ((1, 2, 3, 3), 5_000_000), ((2, 1, 20), 60)])
def test_events_are_those_of_frames_at_all_samples(fault, shape, length):
    gaps = random_gaps(np.random.default_rng(1), shape, 3, 4, 8.0, 0.05, length)
    found, sensor = sensed(gaps, seed=7, **FAULTS[fault])
    expected, counts = sensed_alone(gaps, seed=7, **FAULTS[fault])
    assert len(found) > 20 and sorted(found) == sorted(expected)
    # Of the other pixels of those sensors noise makes events, which a cap may drop.
    assert all(sensor.counts()[name] == counts[name] for name in ("nonfinite", "clipped"))


def constant(pixels: int, gaps: int, light: float, rng: np.random.Generator) -> list[Gap]:
    """Constant light, at 30 Hz, with 0 to 40 further samples a gap that show the same light."""
    made, step = [], S // 30
    for k in range(gaps + 1):
        counts = rng.integers(0, 40, pixels) * (k > 0)
        offset = [np.sort(rng.choice(step - 1, n, replace=False)) + 1 for n in counts]
        first = np.concatenate(([0], np.cumsum(counts))).astype(np.int32)
        values = np.full(first[-1], light, np.float32)
        further = Further(first, np.concatenate(offset).astype(np.int32), values)
        t = np.array([k * step])
        made.append(Gap((k - 1) * step if k else 0, t, np.full((1, 1, 1, pixels), light, np.float32), further))
    return made


@pytest.mark.parametrize(
    ("params", "rate"),
    [
        ({"leak_rate": 8.0}, 8.0),
        ({"leak_rate": 8.0, "leak_model": "bernoulli"}, 8.0),
        ({"shot_rate": 40.0, "shot_white": 2.0}, 40.0 * (1 - 0.5 / 2.0)),
        ({"hot_pixel_fraction": 1.0, "hot_pixel_rate": 25.0}, 25.0),
        ({"shot_rate": 400.0, "shot_white": 1e9, "refractory_us": 10_000.0}, 400.0 / (1 + 400.0 * 0.01)),
    ],
)  # fmt: skip
def test_rates_in_constant_light(params, rate):
    """A Poisson count within four standard deviations; with a dead time, of a renewal process."""
    pixels, gaps = 300, 60
    found, _ = sensed(constant(pixels, gaps, 0.5, np.random.default_rng(2)), seed=3, **params)
    expected = rate * pixels * gaps / 30
    assert abs(len(found) - expected) < 4 * math.sqrt(expected) + (pixels if "leak_rate" in params else 0) * 0.5
    if "refractory_us" in params:
        for x in range(20):
            assert np.diff([e[1] for e in found if e[3] == x]).min() >= 10_000_000


def test_a_dead_time_ends_where_it_should_between_further_samples():
    """A rise of 30/s, in lines of further samples: events 1/30 C after the end of each dead time, to the ns."""
    slope, dead, threshold = 30.0, 700_000, 0.1
    offset = np.sort(np.random.default_rng(4).choice(np.arange(1, 33_000_000), 25, replace=False)).astype(np.int32)
    end = 33_333_333
    light = np.exp(slope * np.array([0, end]) * 1e-9).astype(np.float32).reshape(2, 1, 1, 1, 1)
    further = Further(np.array([0, 25]), offset, np.exp(slope * offset * 1e-9).astype(np.float32))
    none = Further(np.zeros(2, np.int32), np.zeros(0, np.int32), np.zeros(0, np.float32))
    gaps = [Gap(0, np.array([0]), light[0], none), Gap(0, np.array([end]), light[1], further)]
    found, _ = sensed(gaps, threshold=threshold, refractory_us=dead / 1000, shot_rate=1e-6)
    t = np.array([event[1] for event in found])
    period = threshold / slope * S + dead
    assert len(t) == int((end + dead) / period)
    # float32 light is a level within 6e-8, that is 2 ns of this rise.
    assert np.abs(np.diff(t) - period).max() <= 6 and abs(t[0] - threshold / slope * S) <= 3


def test_the_readout_comes_after_all():
    """Its queue and its jitter see the events that frames at the same instants would give."""
    gaps = random_gaps(np.random.default_rng(6), (1, 1, 1), 3, 4, 30.0)
    found, _ = sensed(gaps, seed=5, **FAULTS["readout"])
    expected, _ = sensed_alone(gaps, seed=5, **FAULTS["readout"])
    assert len(found) > 100 and found == expected
