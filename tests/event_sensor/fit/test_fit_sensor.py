"""A sensor that is known, recorded by the simulator: the fit must find the scene and the sensor again."""

import math

import numpy as np
import pytest
import wheel_film as film

from nodes.event_sensor.fit.clip import MANY_PIXELS, read_clip, simulate_motion
from nodes.event_sensor.fit.fit import fit_sensor, light_of, relative_deviations
from nodes.event_sensor.fit.motion import LEAST_CONTRAST, MOST_CONTRAST, bounds, sensor_of
from nodes.event_sensor.fit.report import report
from nodes.event_sensor.fit.search import STEP
from nodes.event_sensor.fit.wheel import NoWheel, find_wheel
from nodes.event_sensor.parameters import resolve_sensor

TRUE = {
    "threshold_on": 0.26, "threshold_off": 0.31, "threshold_mismatch": 0.02, "bandwidth_hz": 50.0,
    "refractory_us": 400.0, "leak_rate": 0.1, "shot_rate": 2.0, "shot_white": 1.0,
}  # fmt: skip
FEW_EVENTS = {
    "threshold_on": 0.40, "threshold_off": 0.45, "threshold_mismatch": 0.02, "bandwidth_hz": 200.0,
    "refractory_us": 10.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded():
    return film.record(**TRUE, seed=3)


def test_the_scene_is_found(recorded):
    wheel = find_wheel(*recorded)
    assert math.dist(wheel.hub, film.HUB) < 0.4
    assert wheel.turning == 1 and wheel.gathered > 0.95 and wheel.mask.mean() > 0.99
    inside = (wheel.at > (film.STILL_S + 0.03) * 1e9) & (wheel.at < (film.STILL_S + film.MOVING_S - 0.03) * 1e9)
    want = film.FASTEST * np.exp(-film.SLOWING * (wheel.at[inside] * 1e-9 - film.STILL_S))
    assert np.median(np.abs(wheel.speed[inside] / want - 1)) < 0.03
    # what leads to an event takes a few ms, in which the border goes on
    behind = film.angle(wheel.at[inside] * 1e-9 - film.STILL_S) - wheel.angle[inside]
    behind = (behind + math.pi) % (2 * math.pi) - math.pi
    assert (behind > -0.05).all() and (behind < 0.006 * film.FASTEST).all()


def test_the_sensor_is_found(recorded):
    clip = read_clip("film", *recorded)
    fit = fit_sensor([clip], [], light_of(film.CONTRAST))
    got, spread = fit.values, fit.motion.deviation
    for name in ("threshold_on", "threshold_off", "bandwidth_hz"):
        assert abs(got[name] / TRUE[name] - 1) < max(0.05, 3 * spread[name]), name
        assert spread[name] < 0.1
    assert "bandwidth_exponent" not in got and fit.laws["proportional"] > 3 * fit.laws["constant"]
    assert TRUE["refractory_us"] <= got["refractory_us"] < 1.1 * TRUE["refractory_us"] + 60
    # Of a Poisson process, over all still pixels; the white sees 1 - 0.889 of the rate.
    black, white = fit.noise.black, fit.noise.white
    seconds, count = black.seconds, black.on + black.off
    share = 1 - film.WHITE * math.exp(-film.CONTRAST) / TRUE["shot_white"]
    want = (TRUE["leak_rate"] + TRUE["shot_rate"] * share) * seconds
    assert abs(count - want) < 4.5 * math.sqrt(want)
    want = (TRUE["leak_rate"] + TRUE["shot_rate"] * (1 - film.WHITE)) * white.seconds
    assert abs(white.on + white.off - want) < 4.5 * math.sqrt(want)
    assert all(abs(value) < 0.1 for value in relative_deviations(fit.compared[0]).values())


@pytest.mark.slow
def test_a_dead_time_below_the_least_interval_is_found():
    """Edges are slow for thresholds of that size: no interval is near the dead time."""
    true = {
        "threshold_on": 0.33, "threshold_off": 0.22, "threshold_mismatch": 0.03, "bandwidth_hz": 120.0,
        "refractory_us": 100.0,
    }  # fmt: skip
    clip = read_clip("film", *film.record(**true, seed=11))
    assert clip.least_interval_us > 2 * true["refractory_us"]
    fit = fit_sensor([clip], [], light_of(film.CONTRAST))
    got, spread = fit.values, fit.motion.deviation
    for name in ("threshold_on", "threshold_off", "bandwidth_hz"):
        assert abs(got[name] / true[name] - 1) < min(0.08, 3 * spread[name]), name
        assert spread[name] < 0.1
    assert abs(got["refractory_us"] - true["refractory_us"]) < 60


@pytest.mark.slow
@pytest.mark.parametrize(("true", "seed"), [(TRUE, 5), (TRUE, 6), (FEW_EVENTS, 2), (FEW_EVENTS, 3), (FEW_EVENTS, 4)])
def test_a_sensor_is_found_from_any_seed(true, seed):
    """One has edges that hardly tell its dead time, the other few events, of which a part in a hundred counts."""
    fit = fit_sensor([read_clip("film", *film.record(**true, seed=seed))], [], light_of(film.CONTRAST))
    got, spread = fit.values, fit.motion.deviation
    for name, most in (("threshold_on", 0.08), ("threshold_off", 0.08), ("bandwidth_hz", 0.07)):
        assert abs(got[name] / true[name] - 1) < min(most, 3 * spread[name]), name
        assert spread[name] < 0.1
    assert "bandwidth_exponent" not in got


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (4, 5))])
def test_recording_and_simulation_count_the_same_part_of_the_motion(seed):
    """What the border passes before the first angle that is known, or after the last, is counted on neither side."""
    clip = read_clip("film", *film.record(**FEW_EVENTS, seed=seed))
    made = simulate_motion(clip, light_of(film.CONTRAST), 0.6, FEW_EVENTS, most=MANY_PIXELS)
    for name in ("on_per_turn", "off_per_turn"):
        assert abs(made[name] / clip.real[name] - 1) < 0.004, name


@pytest.mark.slow
def test_a_photoreceptor_that_follows_the_light_is_told_from_one_that_does_not():
    quiet = {name: value for name, value in TRUE.items() if name not in ("shot_rate", "shot_white", "leak_rate")}
    slow = {**quiet, "bandwidth_hz": 300.0, "bandwidth_level": film.WHITE}
    t, x, y, p = film.record(**slow, seed=4)
    moving = (t > film.STILL_S * 1e9) & (t < (film.STILL_S + film.MOVING_S) * 1e9)  # and never still
    fit = fit_sensor([read_clip("film", *(c[moving] for c in (t, x, y, p)))], [], light_of(film.CONTRAST))
    assert not fit.noise.sensor and "nothing stands still" in report(fit, light_of(), 0.4, "", 500)["warnings"][0]
    assert fit.laws["constant"] > 3 * fit.laws["power"]
    assert 0.7 < fit.values["bandwidth_exponent"] <= 1.2


def test_what_is_no_wheel_is_refused_in_one_line():
    rng = np.random.default_rng(1)
    t = np.sort(rng.integers(0, 10**9, 200_000))
    x, y = rng.integers(0, 60, (2, len(t)))
    with pytest.raises(NoWheel, match=r"nothing moves long enough|no turning wheel"):
        find_wheel(t, x, y, rng.integers(0, 2, len(t)))
    # a bar that goes to and fro: bursts, but about no hub
    frames = [np.where(np.abs(np.arange(64) - 32 - 25 * math.sin(k / 60)) < 4, 1.0, 0.2) for k in range(800)]
    from nodes.event_sensor.simulate import simulate_frames

    bar = np.repeat(np.array(frames, np.float32)[:, None], 48, 1)
    events = simulate_frames(bar, np.arange(800) * 1_000_000, bandwidth_hz=60.0, refractory_us=300)
    with pytest.raises(NoWheel, match="no turning wheel"):
        find_wheel(*(events[c] for c in "txyp"))
    with pytest.raises(NoWheel, match="too few"):
        find_wheel(t[:10], x[:10], y[:10], x[:10])


@pytest.mark.parametrize("contrast", [LEAST_CONTRAST, 0.4, MOST_CONTRAST])
def test_every_sensor_that_is_searched_is_one(contrast):
    """At both ends of what is searched, and a step beyond where slopes are taken."""
    light = light_of(contrast, 5e4)
    low, high = bounds(light, 0)
    for values in (low, high, high + STEP):
        sensor = sensor_of(values, light, 100.0, 0.0)
        assert resolve_sensor("fit", "ideal", sensor)["threshold_on"] == sensor["threshold_on"]
