"""The photoreceptor against closed forms: step, ramp, two poles, any step length, intensity-dependent corner."""

import itertools
import math

import numpy as np
import pytest
import warp as wp
from scipy.integrate import solve_ivp

from nodes.event_sensor.optics.photoreceptor import Photoreceptor

# A float32 luminance is known to 6e-8 of itself, which is 6e-8 in L; input and output are both rounded.
ROUNDING = 1.5e-7
MS = 1_000_000
TAU = 1e-3
HZ = 1 / (2 * math.pi * TAU)


def run(log_input, t, dark=0.0, parts=None, t_base=0, **params):
    """Filtered L of one pixel that sees I = exp(log_input) - dark; the first sample is the state."""
    receptor = Photoreceptor(1, 1, bandwidth_hz=params.pop("hz", HZ), dark_level=dark, **params)
    luminance = (np.exp(np.asarray(log_input, np.float64)) - dark).astype(np.float32)
    return np.log(filtered(receptor, luminance, t, parts, t_base).astype(np.float64) + dark)


def filtered(receptor, luminance, t, parts=None, t_base=0):
    """Output samples [T, ...] of one environment, given in messages cut at `parts`."""
    out = []
    for n, part in enumerate(np.split(np.arange(len(t)), parts or [])):
        images = wp.array(np.ascontiguousarray(luminance[part]).ravel(), dtype=wp.float32)
        out.append(receptor.advance(images, t[part], t_base, np.array([n == 0])).numpy().copy())
        t_base = int(t[part][-1])
    return np.concatenate(out).reshape(luminance.shape)


def step_times(tau, count, step_ns):
    """Stamps of a jump at t = 1 ns (between the first two) and of `count` samples after it."""
    return np.concatenate(([0, 1], 1 + np.arange(1, count + 1, dtype=np.int64) * step_ns))


@pytest.mark.parametrize("step_us", [10, 100, 700])
def test_step_response_crosses_levels_at_the_closed_form_times(step_us):
    amplitude, c = 2.0, 0.2
    t = step_times(TAU, 8000 // step_us, step_us * 1000)
    y = run(np.where(t > 0, amplitude, 0.0), t)
    after = (t - 1) * 1e-9
    np.testing.assert_allclose(y[1:], amplitude * -np.expm1(-after[1:] / TAU), atol=1e-6 * amplitude + ROUNDING)
    if step_us == 10:
        k = np.arange(1, 10)
        crossings = np.interp(k * c, y, after)
        # Linear between samples: curvature dt^2 / (8 tau) in time, and the rounding over the slope at the level.
        slope = (amplitude - k * c) / TAU
        assert (np.abs(crossings + TAU * np.log(1 - k * c / amplitude)) < 1e-10 / (8 * TAU) + 1e-6 / slope).all()


def test_step_down_is_the_mirror_of_step_up():
    t = step_times(TAU, 50, 100_000)
    up, down = (run(np.where(t > 0, s * 1.5, 0.0), t) for s in (1, -1))
    np.testing.assert_allclose(up, -down, atol=2 * ROUNDING)


def test_ramp_lags_by_tau():
    slope = 300.0
    t = np.arange(0, 20_000_001, 250_000, dtype=np.int64)
    seconds = t * 1e-9
    y = run(slope * seconds, t)
    want = slope * (seconds - TAU * -np.expm1(-seconds / TAU))
    np.testing.assert_allclose(y, want, atol=4 * ROUNDING)
    assert abs(slope * seconds[-1] - y[-1] - slope * TAU) < 4 * ROUNDING


def test_two_poles_have_the_response_of_a_cascade():
    t = step_times(TAU, 60, 130_000)
    x = (t[1:] - 1) * 1e-9 / TAU
    y = run(np.where(t > 0, 1.0, 0.0), t, poles=2)
    np.testing.assert_allclose(y[1:], 1 - (1 + x) * np.exp(-x), atol=1e-6 + ROUNDING)
    slope = 200.0
    seconds = np.arange(61) * 130e-6
    ramp = run(slope * seconds, np.arange(61, dtype=np.int64) * 130_000, poles=2)
    x = seconds / TAU
    np.testing.assert_allclose(ramp, slope * TAU * (x - 2 + (2 + x) * np.exp(-x)), atol=4 * ROUNDING)


@pytest.mark.parametrize("poles", [1, 2])
def test_the_response_to_a_piecewise_linear_input_does_not_depend_on_the_step(poles):
    rng = np.random.default_rng(0)
    knots = np.arange(0, 41, 4) * 1_000_000
    values = np.cumsum(rng.normal(0, 0.7, len(knots)))
    coarse = run(values, knots, poles=poles)
    for divide in (4, 40, 400):
        t = np.arange(0, knots[-1] + 1, 4_000_000 // divide)
        fine = run(np.interp(t, knots, values), t, poles=poles)
        np.testing.assert_allclose(fine[::divide], coarse, atol=6 * ROUNDING)


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("ratio", [1e-6, 1e-4, 0.0199, 0.0201, 1.0, 30.0, 1e3, 1e6])
def test_any_ratio_of_step_to_time_constant(ratio, poles):
    """1000 equal steps after a jump of 1: the sum of all steps is the closed form, to float32 of the output."""
    step_ns = 1_000_000
    hz = ratio / (2 * math.pi * step_ns * 1e-9)
    t = step_times(TAU, 1000, step_ns)
    y = run(np.where(t > 0, 1.0, 0.0), t, poles=poles, hz=hz)
    n = np.arange(1001) * ratio
    want = -np.expm1(-n) if poles == 1 else 1 - (1 + n) * np.exp(-n)
    if ratio >= 1:  # the jump itself took 1 ns, ratio * 1e-6 of a time constant
        jump = ratio * 1e-6 * 0.5
        assert np.abs(y[1:] - want).max() < max(jump, ROUNDING) * 2
        assert abs(y[-1] - 1) < ROUNDING
    else:
        assert np.abs(y[1:] - want).max() < ROUNDING + ratio * 1e-6


def test_very_long_steps_follow_a_ramp_at_once_and_very_short_ones_hardly():
    t = np.arange(5, dtype=np.int64) * 10_000_000_000
    np.testing.assert_allclose(run(np.arange(5.0), t, hz=1e9), np.arange(5.0), atol=1e-6)
    t = np.arange(5, dtype=np.int64)
    assert np.abs(run(np.arange(5.0), t, hz=1e-3)).max() < ROUNDING


def test_messages_may_be_cut_anywhere():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.integers(1000, 3_000_000, 60))
    signal = np.cumsum(rng.normal(0, 0.4, 60))
    signal[20:40] = signal[20]
    for poles, level in ((1, 0.0), (2, 2.0)):
        options = {"poles": poles, "bandwidth_level": level, "t_base": int(t[0])}
        whole = run(signal, t, **options)
        for parts in ([1], [1, 2, 3, 25], list(range(1, 60))):
            assert run(signal, t, parts=parts, **options).tobytes() == whole.tobytes()


def test_environments_and_pixels_are_independent():
    rng = np.random.default_rng(2)
    frames = np.exp(rng.normal(0, 1, (3, 7, 4, 5, 3))).astype(np.float32)
    t = np.arange(1, 8, dtype=np.int64) * 300_000
    together = Photoreceptor(4, 5, 3, 3, HZ, 1.0, 2, 0.01)
    images = wp.array(frames.ravel())
    first = together.advance(images, t, 0, np.ones(3, bool)).numpy().reshape(frames.shape).copy()
    again = together.advance(images, t + 3_000_000, int(t[-1]), np.array([0, 1, 0], bool)).numpy().reshape(frames.shape)
    assert again[1].tobytes() == first[1].tobytes(), "a new episode starts from its first sample"
    for e, y, x, c in ((0, 0, 0, 0), (2, 3, 4, 2), (1, 2, 1, 1)):
        alone = Photoreceptor(1, 1, 1, 1, HZ, 1.0, 2, 0.01)
        assert filtered(alone, frames[e, :, y, x, c], t).tobytes() == first[e, :, y, x, c].tobytes()
    assert again[0].tobytes() != first[0].tobytes()


def test_shape_and_dtype_are_those_of_the_input():
    images = wp.array(np.ones((6, 4, 5, 1), np.float32))
    out = Photoreceptor(4, 5, 2).advance(images, np.arange(3), 0, np.ones(2, bool))
    assert out.shape == (6, 4, 5, 1) and out.dtype == wp.float32
    with pytest.raises(ValueError, match="expected 2 x 4 x 20 samples"):
        Photoreceptor(4, 5, 2).advance(images, np.arange(4), 0, np.ones(2, bool))


@pytest.mark.parametrize("exponent", [0.2, 0.5, 1.7])
@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("hz, jump", [(300.0, 0.02), (300.0, 3.0), (1e6, 2.0)])
def test_pixels_whose_corner_is_a_power_of_the_light_follow_the_equations_in_numpy(hz, jump, poles, exponent):
    rng = np.random.default_rng(5)
    luminance = (20 * np.exp(np.cumsum(rng.normal(0, jump, (30, 53)), 0))).astype(np.float32)
    t = np.cumsum(rng.integers(100_000, 2_000_000, 30))
    receptor = Photoreceptor(1, 53, 1, 1, hz, 30.0, poles, 0.1, exponent=exponent)
    want = ode_in_numpy(luminance, t, hz, 30.0, poles, 0.1, exponent)
    np.testing.assert_allclose(filtered(receptor, luminance, t, [1, 5, 17]), want, rtol=2e-7, atol=2e-8)


def test_a_power_of_0_is_a_corner_that_light_does_not_change():
    t = np.arange(20, dtype=np.int64) * MS
    luminance = np.exp(np.random.default_rng(6).normal(0, 1, (20, 19))).astype(np.float32)
    without, with_level = (Photoreceptor(1, 19, bandwidth_hz=HZ, **more) for more in
                           ({}, {"bandwidth_level": 50.0, "exponent": 0.0}))  # fmt: skip
    assert (filtered(without, luminance, t) == filtered(with_level, luminance, t)).all()


@pytest.mark.parametrize("dark", [0.0, 0.3])
def test_the_corner_is_proportional_to_the_light(dark):
    """Constant tau within each step: a small step at brightness I relaxes with tau level / (I + dark)."""
    level = 10.0
    t = step_times(TAU, 40, 300_000)
    for brightness in (0.01, 0.5, 9.0, 40.0):
        before = math.log(brightness + dark)
        signal = np.where(t > 0, before + 1e-3, before)
        y = run(signal, t, dark=dark, bandwidth_level=level) - before
        tau = TAU / min(1.0, (brightness + dark) * math.exp(1e-3) / level)
        want = 1e-3 * -np.expm1(-(t - 1) * 1e-9 / tau)
        assert np.abs(y - want)[1:].max() < 2 * ROUNDING


def test_a_corner_that_changes_within_steps_converges_in_second_order():
    """L swings by +-2 nat in a few time constants; reference: the differential equation solved to 1e-11."""
    level, period = 3.0, 20e-3
    signal = lambda s: 2 * np.sin(2 * np.pi * s / period)
    rate = lambda s: np.minimum(1.0, np.exp(signal(s)) / level) / TAU
    end = 0.05
    exact = solve_ivp(
        lambda s, y: (signal(s) - y) * rate(s), (0, end), [0.0], rtol=1e-11, atol=1e-11, dense_output=True
    )
    errors = []
    for step_us in (1000, 500, 250, 125):
        t = np.arange(0, 50_000_001, step_us * 1000, dtype=np.int64)
        errors.append(np.abs(run(signal(t * 1e-9), t, bandwidth_level=level) - exact.sol(t * 1e-9)[0]).max())
    assert errors[-1] < 1e-3
    assert all(a / b > 3 for a, b in itertools.pairwise(errors)) and errors[0] / errors[-1] > 40


def test_a_pixel_that_has_arrived_gives_its_input_to_the_last_bit():
    """So a signal that returns to its old value returns exactly: no event is gained or lost on the way back."""
    values = np.array([0.7, 13.37, 0.7], np.float32)
    luminance = np.repeat(values, 400)
    t = np.arange(1200, dtype=np.int64) * 100_000
    for poles in (1, 2):
        y = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ, poles=poles), luminance, t)
        assert y[399] == values[0] and y[799] == values[1] and y[1199] == values[2]
        assert (np.diff(y[400:800]) >= 0).all() and (np.diff(y[800:]) <= 0).all()


@pytest.mark.parametrize("bad", [np.nan, -1.0, np.inf, -np.inf, 0.0])
def test_a_bad_sample_is_not_a_number_and_holds_the_input(bad):
    luminance = np.array([1, 5, 5, 5, 2, 2, 2], np.float32)
    t = np.arange(7, dtype=np.int64) * 500_000
    good = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ), luminance, t)
    for at in (2, 3, 5):
        spoilt = luminance.copy()
        spoilt[at] = bad
        got = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ), spoilt, t)
        assert np.isnan(got[at])
        assert np.delete(got, at).tobytes() == np.delete(good, at).tobytes()


def test_bad_samples_at_the_start_do_not_make_a_state():
    luminance = np.array([np.nan, -2, 3, 3, 7], np.float32)
    t = np.arange(5, dtype=np.int64) * 500_000
    got = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ), luminance, t)
    assert np.isnan(got[:2]).all() and got[2] == got[3] == 3 and 3 < got[4] < 7


def test_a_black_pixel_wakes_up():
    """Next to no light, no dark current: the corner is 0 Hz there, and must not stay so when light returns."""
    luminance = np.array([1e-30, 1e-30, 4, 4, 4, 4, 4, 4], np.float32)
    t = np.arange(8, dtype=np.int64) * 20_000_000
    got = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ, bandwidth_level=4.0), luminance, t)
    assert got[0] == luminance[0] and abs(got[-1] - 4) < 1e-5
    dark = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ, bandwidth_level=4.0), luminance[::-1].copy(), t)
    assert np.isfinite(dark).all() and (np.diff(dark) <= 0).all()


def test_a_step_of_1_to_1e9_stays_finite_and_monotone():
    luminance = np.array([1e-3] * 3 + [1e6] * 40, np.float32)
    t = np.arange(43, dtype=np.int64) * 200_000
    for poles in (1, 2):
        y = filtered(Photoreceptor(1, 1, bandwidth_hz=HZ, bandwidth_level=1.0, poles=poles), luminance, t)
        assert (np.diff(y) >= 0).all() and 0.9e6 < y[-1] <= 1e6


@pytest.mark.gpu
@pytest.mark.parametrize("poles, level, power", [(1, 0.0, 1), (2, 0.0, 1), (1, 2.0, 1), (2, 2.0, 1), (1, 2.0, 0.3)])
def test_gpu_gives_what_the_cpu_gives(poles, level, power):
    """exp and log differ in the last bit of float64; a float32 result then moves by one of its own at most."""
    rng = np.random.default_rng(6)
    frames = np.exp(rng.normal(0, 1, (2, 9, 31, 17, 3))).astype(np.float32)
    frames[:, 3:6] = frames[:, 3:4]
    frames[rng.random(frames.shape) < 0.01] = np.nan
    t = np.arange(1, 10, dtype=np.int64) * 300_000
    cpu, gpu = (
        Photoreceptor(31, 17, 2, 3, HZ, level, poles, 0.01, d, exponent=power)
        .advance(wp.array(frames.ravel(), device=d), t, 0, np.ones(2, bool))
        .numpy()
        for d in ("cpu", "cuda")
    )
    np.testing.assert_allclose(gpu, cpu, rtol=2.5e-7)


@pytest.mark.parametrize(
    "params, text",
    [
        ({"bandwidth_hz": 0}, "bandwidth_hz 0 must be above 0"),
        ({"bandwidth_hz": math.nan}, "bandwidth_hz nan"),
        ({"bandwidth_level": -1}, "bandwidth_level -1"),
        ({"dark_level": math.inf}, "dark_level inf"),
        ({"poles": 3}, "bandwidth_poles 3 must be 1 or 2"),
    ],
)
def test_misuse_has_one_clear_line(params, text):
    with pytest.raises(ValueError, match=text):
        Photoreceptor(2, 2, **params)


def test_events_of_a_step_come_at_minus_tau_ln_1_minus_k_c_over_a():
    """Through the whole sensor: samples every 20 us, L linear between them, so late by dt^2 / (8 tau) = 50 ns."""
    from nodes.event_sensor.sensor import EventSensor

    amplitude, c = 2.0, 0.2
    t = step_times(TAU, 500, 20_000)
    frames = np.exp(np.where(t > 0, amplitude, 0.0)).astype(np.float32)[None, :, None, None]
    for parts in ([], [2], [100, 101, 300]):
        sensor = EventSensor(1, 1, threshold=c, bandwidth_hz=HZ)
        packets = [
            sensor.process(frames[:, part], t[part], np.zeros(1, np.int32))
            for part in np.split(np.arange(len(t)), parts)
        ]
        got = np.concatenate([p.t for p in packets])
        k = np.arange(1, 10)
        want = 1 - 1e9 * TAU * np.log(1 - k * c / amplitude)
        # The frames' rounding is 1e-7 in L, over the slope at the level.
        tolerance = 60 + 1e9 * 2e-7 * TAU / (amplitude - k * c)
        assert len(got) == 9 and (np.abs(got - want) < tolerance).all()
        assert all(p.p.all() for p in packets)


def test_the_sensor_counts_and_skips_what_the_photoreceptor_marks():
    from nodes.event_sensor.sensor import EventSensor

    frames = np.full((1, 6, 1, 2), 2.0, np.float32)
    frames[0, 2, 0, 0] = np.nan
    frames[0, 3:, 0, :] = 9.0
    t = np.arange(6, dtype=np.int64) * 5_000_000
    sensor = EventSensor(1, 2, threshold=0.2, bandwidth_hz=HZ)
    packet = sensor.process(frames, t, np.zeros(1, np.int32))
    assert sensor.counts()["nonfinite"] == 1
    assert np.bincount(packet.x, minlength=2).tolist() == [7, 7], "ln 4.5 / 0.2 = 7.5"


@pytest.mark.parametrize("further", [False, True])
def test_black_without_dark_current_fires_nothing_and_is_counted(further):
    """0 has no logarithm: such a sample is skipped, as by a sensor of infinite bandwidth."""
    from nodes.event_sensor.sensor import EventSensor, Further

    t = np.arange(5, dtype=np.int64) * 10_000_000
    light = np.ones(5, np.float32)
    black = None
    if further:
        black = Further(np.array([0, 1], np.int32), np.array([15_000_000], np.int32), np.zeros(1, np.float32))
    else:
        light[2] = 0.0
    for hz in (0.0, 1000.0):
        sensor = EventSensor(1, 1, threshold=0.2, bandwidth_hz=hz)
        packet = sensor.process(light.reshape(1, 5, 1, 1), t, np.zeros(1, np.int32), further=black)
        assert len(packet.t) == 0 and sensor.counts()["nonfinite"] == 1


def ode_in_numpy(light, t, hz, level, poles, dark, exponent=1.0):
    """The same equations from numpy's log, exp and expm1, in float64: light [T, N] -> output [T, N]."""
    e1 = e2 = np.zeros(light.shape[1])
    out, rate = [light[0].astype(np.float64)], 2 * math.pi * hz
    for k in range(1, len(t)):
        before, now = (light[i].astype(np.float64) + dark for i in (k - 1, k))
        share = 0.5 * sum(np.minimum(1, light / level) ** exponent for light in (before, now)) if level else 1.0
        a = rate * share * (t[k] - t[k - 1]) * 1e-9 * np.ones(light.shape[1])
        decay, f, grown = np.exp(-a), -np.expm1(-a) / a, np.log(now / before)
        e1, e2 = e1 * decay - grown * f, e2 * decay + e1 * a * decay + grown * (decay - 2 * f)
        out.append(now * np.exp(e1 if poles == 1 else e2) - dark)
    return np.array(out)


@pytest.mark.parametrize("level", [0.0, 30.0])
@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("hz, jump", [(0.5, 0.7), (300.0, 0.02), (300.0, 3.0), (3000.0, 0.7), (1e6, 2.0)])
def test_pixels_in_a_row_follow_the_equations_in_numpy(hz, jump, poles, level):
    """Rows go through polynomials good to 1e-9, sixteen pixels at a time: float32 but for its last bit."""
    rng = np.random.default_rng(4)
    luminance = (20 * np.exp(np.cumsum(rng.normal(0, jump, (30, 53)), 0))).astype(np.float32)
    luminance[10, 5], luminance[11, 5] = 1e-7, 1e9
    t = np.cumsum(rng.integers(100_000, 2_000_000, 30))
    got = filtered(Photoreceptor(1, 53, 1, 1, hz, level, poles, 0.1), luminance, t, [1, 5, 17])
    want = ode_in_numpy(luminance, t, hz, level, poles, 0.1)
    np.testing.assert_allclose(got, want, rtol=2e-7, atol=2e-8)


@pytest.mark.parametrize("level", [0.0, 30.0])
@pytest.mark.parametrize("poles", [1, 2])
def test_a_pixel_gives_the_same_wherever_it_lies(poles, level):
    rng = np.random.default_rng(5)
    luminance = (20 * np.exp(np.cumsum(rng.normal(0, 0.7, (30, 50)), 0))).astype(np.float32)
    luminance[rng.random(luminance.shape) < 0.01] = np.nan
    t = np.cumsum(rng.integers(100_000, 2_000_000, 30))
    together = filtered(Photoreceptor(1, 50, 1, 1, 300.0, level, poles, 0.1), luminance, t, [1, 5, 17])
    for x in (0, 15, 16, 33, 47, 48, 49):
        alone = filtered(Photoreceptor(1, 1, 1, 1, 300.0, level, poles, 0.1), luminance[:, x : x + 1], t)
        assert together[:, x].tobytes() == alone.tobytes()


def test_in_place_gives_the_same():
    """Black, bad and first samples included, which are done one by one after the others of their frame."""
    rng = np.random.default_rng(7)
    luminance = np.exp(rng.normal(0, 2, (20, 7, 11))).astype(np.float32)
    for value in (0.0, np.nan, np.inf, -1.0):
        luminance[rng.random(luminance.shape) < 0.03] = value
    t = np.arange(20, dtype=np.int64) * MS
    apart, same = (Photoreceptor(7, 11, 1, 1, 300.0, 2.0, 2, 0.0) for _ in range(2))
    for part in (slice(0, 1), slice(1, 12), slice(12, 20)):
        fresh, base = np.array([part.start == 0]), int(t[max(part.start - 1, 0)])
        want = apart.advance(wp.array(luminance[part].ravel()), t[part], base, fresh)
        images = wp.array(luminance[part].ravel())
        assert same.advance(images, t[part], base, fresh, in_place=True) is images
        assert images.numpy().tobytes() == want.numpy().tobytes()


@pytest.mark.parametrize("step_ns", [1_000, 1_000_000, 1_000_000_000])
@pytest.mark.parametrize("hz", [1.0, 1e6])
@pytest.mark.parametrize("level", [0.0, 5.0])
@pytest.mark.parametrize("poles", [1, 2])
def test_slow_and_fast_receptors_at_short_and_long_steps(hz, step_ns, level, poles):
    """1 Hz and 1 MHz at 1 us, 1 ms and 1 s: a dt of 6e-6 to 6e6 time constants."""
    rng = np.random.default_rng(6)
    luminance = np.exp(rng.normal(0, 2, (40, 20))).astype(np.float32)
    luminance[:, 3] = np.where(np.arange(40) < 3, 1e-3, 1e6)
    t = np.arange(40, dtype=np.int64) * step_ns
    got = filtered(Photoreceptor(1, 20, 1, 1, hz, level, poles, 0.0), luminance, t)
    np.testing.assert_allclose(got, ode_in_numpy(luminance, t, hz, level, poles, 0.0), rtol=2.5e-7)


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("dark", [0.0, 1e-3])
def test_a_dark_pixel_that_a_light_of_any_strength_meets_begins_where_it_was(dark, poles):
    """Just after the jump the output is many powers of ten below its input."""
    luminance = np.ones((3, 20), np.float32) * np.float32(1e-3)
    luminance[1:] *= np.logspace(0, 38, 20, dtype=np.float32)
    t = np.array([0, 1000, 2000])
    got = filtered(Photoreceptor(1, 20, 1, 1, 300.0, 0.0, poles, dark), luminance, t)
    np.testing.assert_allclose(got, ode_in_numpy(luminance, t, 300.0, 0.0, poles, dark), rtol=2e-7)
