"""Looks come close together where the light changes, and the sensor over them is the event sensor itself."""

import numpy as np
import pytest

from evis.scene.model import Waveform
from nodes.audit.brute_force.instants import Samples, Sampling, base_stamps, lamp_stamps, sample
from nodes.audit.sampled_sensor import SampledSensor
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.sensor import EventSensor
from nodes.renderer.lights.lights import waveform_strength

GAP = np.array([0, 33_333_333, 66_666_667])


def sampled(level):
    """Samples of one pixel whose ln I is `level(t [s])`, and how many looks that took."""
    looks = []

    def look(pixel, t):
        looks.append(len(t))
        return np.exp(level(t * 1e-9)).astype(np.float32), np.zeros(len(t), np.int32)

    first = look(np.zeros(1, np.int64), np.zeros(1, np.int64))
    start = Samples(np.zeros(1, np.int64), np.zeros(1, np.int64), *first)
    return sample(look, start, base_stamps(GAP, 500.0), Sampling(), 0.2), sum(looks)


def test_base_stamps_hold_all_keyframes_and_no_longer_steps() -> None:
    stamps = base_stamps(GAP, 500.0)
    assert set(GAP[1:]) <= set(stamps) and stamps[0] > 0
    assert (np.diff(np.append(0, stamps)) <= 2_000_000).all() and (np.diff(stamps) > 0).all()


def test_a_still_pixel_is_looked_at_no_more_than_that() -> None:
    found, looks = sampled(lambda t: 0 * t)
    assert looks == 1 + len(base_stamps(GAP, 500.0)) and (np.diff(found.t) > 0).all()


def test_a_step_is_placed_to_within_the_finest_interval() -> None:
    for at in (0.0101234, 0.0333333, 0.06):
        found, looks = sampled(lambda t, at=at: np.where(t < at, 0.0, 1.0))
        k = int(np.argmax(found.luminance > 2))
        assert found.t[k - 1] * 1e-9 <= at <= found.t[k] * 1e-9 + 1e-12
        assert found.t[k] - found.t[k - 1] <= Sampling().finest and looks < 60


def test_a_bend_is_followed_to_a_part_of_the_threshold() -> None:
    """A sine of 60 Hz: ln I between the looks is nowhere further from the line than the part of a threshold."""
    found, _ = sampled(lambda t: np.sin(2 * np.pi * 60 * t))
    t = np.linspace(found.t[0], found.t[-1], 20_001)
    line = np.interp(t, found.t, np.log(found.luminance))
    assert np.abs(line - np.sin(2 * np.pi * 60 * t * 1e-9)).max() < 0.03


def test_the_sampled_sensor_is_the_event_sensor() -> None:
    """On common stamps, in two calls, with light that is dark, clipped or not a number now and then."""
    rng = np.random.default_rng(5)
    pixels, count = 40, 300
    light = np.exp(np.cumsum(rng.normal(0, 0.15, (count, pixels)), 0)).astype(np.float32)
    light[rng.random(light.shape) < 0.02] = np.nan
    light[rng.random(light.shape) < 0.02] = 0.0
    light[rng.random(light.shape) < 0.02] = 1e-9
    t = np.cumsum(rng.integers(1, 3_000_000, count))
    given = {"threshold_on": 0.21, "threshold_off": 0.17, "dark_level": 0.0}
    parameters = resolve_sensor("sensor", "ideal", given)
    whole = EventSensor(1, pixels, **given).process(light[None, :, None], t, np.zeros(1, np.int32))
    mine, parts = SampledSensor(pixels, parameters), []
    for some in (slice(0, 120), slice(120, count)):
        number = np.repeat(np.arange(pixels), len(t[some]))
        parts.append(mine.sense(number, np.tile(t[some], pixels), light[some].T.reshape(-1)))
    pixel, at, p = (np.concatenate(column) for column in zip(*parts))
    order = np.lexsort((p, pixel, at))
    wanted = np.lexsort((whole.p, whole.x, whole.t))
    assert len(at) == len(whole.t) > 1000
    assert np.array_equal(at[order], whole.t[wanted])
    assert np.array_equal(pixel[order], whole.x[wanted]) and np.array_equal(p[order], whole.p[wanted])


@pytest.mark.parametrize("start", [0, 86_400_000_000_123])
def test_looks_hold_every_switch_and_every_turn_of_lamps(start: int) -> None:
    """Against the strengths at every 10 us: what is on for 20 us is never between two looks, nor is a sine's end."""
    pulse, sine = Waveform("square", 97.0, 0.9, -0.3, 0.002), Waveform("sine", 250.0, 0.9, 0.25)
    stamps = lamp_stamps([pulse, None, sine, Waveform("sine", 1e6)], start, start + 50_000_000)
    assert (np.diff(stamps) > 0).all() and start < stamps[0] and stamps[-1] < start + 50_000_000
    fine = np.arange(stamps[0], stamps[-1], 10_000)
    for wave in (pulse, sine):
        there, all_of_it = (np.array([waveform_strength(wave, int(t)) for t in at]) for at in (stamps, fine))
        np.testing.assert_allclose(np.interp(fine, stamps, there), all_of_it, atol=0.3)
        assert there.max() == pytest.approx(all_of_it.max()) and there.min() == pytest.approx(all_of_it.min(), abs=1e-6)
