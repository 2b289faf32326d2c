"""Equations with more than one text: how far the texts are from the truth, and from each other."""

import numpy as np
import pytest
import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.cpu.simd_kernels import LOGARITHM
from nodes.event_sensor.model.crossing_kernels import crossing_on_line, root_of_line, stamp_of
from nodes.event_sensor.model.paper_kernels import ln_as_prescribed
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor, has_level, light_seen, log_level
from nodes.event_sensor.parameters import FLOOR

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

UNITS = (1, 1, 2)
"""Of the last place, what the vector code, the library and the series may each miss ln by; by their definitions."""


@wp.func_native(native_code([LOGARITHM], "return log_of(x);"))
def log_of(x: wp.float64) -> wp.float64: ...


@wp.kernel
def logarithms(
    # in
    sensor: Sensor,
    v: wp.array(dtype=wp.float32),
    # out
    light: wp.array(dtype=wp.float64),
    level: wp.array2d(dtype=wp.float64),
    good: wp.array(dtype=wp.bool),
):
    i = wp.tid()
    good[i] = has_level(sensor, v[i])
    if good[i]:
        light[i] = light_seen(sensor, v[i])
        level[0, i] = log_of(light[i])
        level[1, i] = log_level(sensor, v[i])
        level[2, i] = ln_as_prescribed(light[i])


def samples():
    """Random ones over the range of float32, powers of two, around one, and what is no light."""
    rng = np.random.default_rng(2)
    powers = 2.0 ** np.arange(-149, 128)
    around_one = 1 + np.concatenate([2.0**-k * np.array([-1.0, 1.0]) for k in range(1, 24)])
    v = np.concatenate([np.exp(rng.uniform(-103, 88.7, 200_000)), powers, powers * np.sqrt(0.5), around_one])
    tail = [1e-45, 1e-38, 1e-30, 1e-8, FLOOR, 1.0, 1e30, 3.4028235e38]
    bad = [np.nan, np.inf, -np.inf, -1.0, -1e-45]
    return np.concatenate([v.astype(np.float32), np.array([*tail, *bad], np.float32)]), len(bad)


@pytest.mark.parametrize("dark", [0.0, 1e-30, 1e-3, 1.0])
def test_three_texts_of_the_logarithm_agree_far_below_the_tolerance_of_a_crossing(dark):
    sensor = Sensor()
    sensor.dark_level, sensor.floor = dark, FLOOR
    v, bad = samples()
    light, levels, good = np.full(len(v), 1.0), np.zeros((3, len(v))), np.zeros(len(v), bool)
    outputs = [wp.array(a, dtype=t, device="cpu", copy=False)
               for a, t in ((light, wp.float64), (levels, wp.float64), (good, wp.bool))]  # fmt: skip
    wp.launch(logarithms, len(v), [sensor, wp.array(v, device="cpu", copy=False)], outputs, device="cpu")
    assert good[: len(v) - bad].all() and not good[-bad:].any()
    light, levels = light[:-bad], levels[:, :-bad]
    assert np.array_equal(light, np.maximum(v[:-bad].astype(np.float64) + dark, FLOOR))
    exact = np.log(light.astype(np.longdouble))
    unit = np.spacing(np.abs(exact).astype(np.float64))
    one = light == 1
    assert (levels[:, one] == 0).all()
    for level, units in zip(levels, UNITS, strict=True):
        assert (np.abs(level - exact) / unit)[~one].max() <= units
    apart = np.ptp(levels, axis=0)
    assert (apart / unit)[~one].max() < 4 and apart.max() < 1e-13 < 1e-5 * float(TOLERANCE)


@wp.kernel
def vector_logarithm(
    # in
    x: wp.array(dtype=wp.float64),
    # out
    y: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    y[i] = log_of(x[i])


def test_the_vector_logarithm_is_within_one_unit_in_the_last_place():
    """Of float64s that no float32 gives, too."""
    rng = np.random.default_rng(2)
    x = np.exp(rng.uniform(np.log(FLOOR), 88.7, 200_000))
    powers = 2.0 ** np.arange(-24, 128)
    around_one = 1 + np.concatenate([2.0**-k * np.array([-1.0, 1.0]) for k in range(1, 53)])
    x = np.concatenate([x, powers, powers * np.sqrt(0.5), np.nextafter(powers, 0), around_one, [1.0]])
    y = np.empty_like(x)
    inputs, outputs = ([wp.array(a, device="cpu", copy=False)] for a in (x, y))
    wp.launch(vector_logarithm, len(x), inputs, outputs, device="cpu")
    exact = np.log(x.astype(np.longdouble))
    assert y[-1] == 0
    assert (np.abs(y - exact)[:-1] / np.spacing(np.abs(exact[:-1]).astype(np.float64))).max() < 1


@wp.kernel
def line_both_ways(
    # in
    l0: wp.array(dtype=wp.float64),
    l1: wp.array(dtype=wp.float64),
    level: wp.array(dtype=wp.float64),
    span: wp.int64,
    # out
    ideal: wp.array(dtype=wp.int64),
    cut: wp.array(dtype=wp.int64),
):
    i = wp.tid()
    length = wp.float64(span)
    zero = wp.float64(0.0)
    ideal[i] = crossing_on_line(level[i], l0[i], length / (l1[i] - l0[i]), length)
    root = root_of_line(wp.vec4d(l0[i], l1[i] - l0[i], zero, zero), level[i], zero, wp.float64(1.0))
    cut[i] = wp.min(stamp_of(root, length, wp.int64(0)), span)


@pytest.mark.parametrize("span", [1, 2, 7, 1_000_000, 4_000_000_000, 1 << 50])
def test_both_texts_of_a_straight_line_are_within_a_nanosecond(span):
    """Half of one is their rounding of the time, and at 2^50 ns another half that of the quotient."""
    rng = np.random.default_rng(span % 1000)
    n = 100_000
    l0 = rng.uniform(np.log(FLOOR), 88.7, n)
    l1 = l0 + rng.choice([-1, 1], n) * 10.0 ** rng.uniform(-9, 2, n)
    part = rng.uniform(0, 1, n)
    part[:6] = 0, 1, 0.5, -1e-7, 1 + 1e-7, 1e-300
    level = l0 + part * (l1 - l0)
    # Beyond the line on either side, as far as there are numbers.
    level[6:10], l0[6:10], l1[6:10] = (np.inf, -np.inf, 1e300, -1e300), (0, 1, 0, 1), (1, 0, 1, 0)
    ideal, cut = np.zeros(n, np.int64), np.zeros(n, np.int64)
    inputs = [*(wp.array(a, device="cpu", copy=False) for a in (l0, l1, level)), span]
    wp.launch(line_both_ways, n, inputs, [wp.array(a, device="cpu", copy=False) for a in (ideal, cut)], device="cpu")
    assert np.abs(ideal - cut).max() <= 1
    for stamps in (ideal, cut):
        assert stamps.min() >= 1 and stamps.max() <= span and (stamps[6:10] == span).all()
        # The last bits of l0 and of the level, of up to 88, over what the line does in the step.
        off = np.abs(stamps - np.clip(part, 0, 1) * span)[10:]
        assert (off <= 1 + 4 * np.spacing(88.7) * span / np.abs(l1 - l0)[10:]).all()
