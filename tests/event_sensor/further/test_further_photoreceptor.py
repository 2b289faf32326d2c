"""The photoreceptor with further samples at a coarse rate of 30 Hz: closed forms, and the same at any coarse rate."""

import math
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from further_rig import Gap, in_parts, random_gaps, sensed

from nodes.event_sensor.input.batch import Size
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.optics.photoreceptor import Photoreceptor

S = 1_000_000_000
TAU = 1e-3
HZ = 1 / (2 * math.pi * TAU)
C = 0.2


def gaps_of(log_light, further_t, coarse_hz, seconds) -> list[Gap]:
    """Messages of one frame each of a single pixel that sees exp(log_light(t)), t [ns], and further samples at a list
    of instants."""
    step = S // coarse_hz
    made = []
    for k in range(round(seconds * coarse_hz) + 1):
        start = (k - 1) * step if k else 0
        own = further_t[(further_t > start) & (further_t < k * step)] if k else further_t[:0]
        light = np.exp(log_light(np.array([k * step]))).astype(np.float32).reshape(1, 1, 1, 1)
        further = Further(np.array([0, len(own)]), (own - start).astype(np.int32), np.exp(log_light(own)))
        made.append(Gap(start, np.array([k * step]), light, further))
    return made


def traced(gaps, **params):
    """Instants [ns] and ln of the output, all samples."""
    receptor = Photoreceptor(1, 1, bandwidth_hz=params.pop("hz", HZ), **params)
    t, y = [], []
    for gap in gaps:
        lists = gap.further.on(Size(1, 1, 1, 1), wp.get_device("cpu"))
        frames, made = receptor.trace(
            wp.array(gap.frames.ravel(), device="cpu"), lists, gap.t, gap.start, np.array([gap.start == gap.t[0]])
        )
        if made is not None:
            t += (gap.start + made.offset.numpy().astype(np.int64)).tolist()
            y += np.log(made.value.numpy().astype(np.float64)).tolist()
        t.append(int(gap.t[-1]))
        y.append(float(np.log(frames.numpy()[-1])))
    return np.array(t), np.array(y)


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("times_corner", [0.1, 0.5, 1.0, 2.0, 10.0])
def test_bode_curve_at_30_frames_a_second(poles, times_corner):
    """Gain and phase of 1 / (1 + i f / fc)^poles, for a sinusoid of 120 further samples a period."""
    f = HZ * times_corner
    periods = 12 if times_corner < 1 else 40
    seconds = max(periods / f, 0.1)
    t = np.arange(1, seconds * 120 * f).astype(np.float64) * S / (120 * f)
    t = np.setdiff1d(np.rint(t).astype(np.int64), np.arange(0, int(seconds * 30) + 2) * (S // 30))
    omega = 2 * math.pi * f * 1e-9
    gaps = gaps_of(lambda ns: np.sin(omega * ns), t, 30, int(seconds * 30) / 30)
    at, y = traced(gaps, poles=poles, chord=C / 50)
    late = np.linspace(at[-1] / 2, at[-1], 200_000)
    level = np.interp(late, at, y)
    basis = np.stack([np.sin(omega * late), np.cos(omega * late), np.ones_like(late)], 1)
    a, b, _ = np.linalg.lstsq(basis, level, rcond=None)[0]
    closed = 1 / (1 + 1j * times_corner) ** poles
    # The input's chords are short of the sinusoid by 3e-4, the output's by a fraction of C / 50.
    assert abs(complex(a, b) - closed) < 0.002


@pytest.mark.parametrize("coarse_hz", [10, 30, 1000])
def test_a_step_crosses_levels_at_the_closed_form_times(coarse_hz):
    """A jump of 1.95 within a nanosecond, of two further samples: t = -tau ln(1 - k C / 1.95) at any coarse rate."""
    jump = 2_345_678
    further = np.array([jump, jump + 1])
    gaps = gaps_of(lambda ns: np.where(ns > jump, 1.95, 0.0), further, coarse_hz, 0.1)
    events, _ = sensed(gaps, threshold=C, bandwidth_hz=HZ)
    k = np.arange(1, 10)
    closed = jump - TAU * S * np.log(1 - k * C / 1.95)
    slope = (1.95 - k * C) / (TAU * S)
    # A chord of the output lies within C / 50 of it, and float32 within 1e-6.
    error = np.array([e[1] for e in events]) - closed
    assert len(events) == 9 and (np.abs(error) < (C / 50 + 1e-6) / slope + 1).all()


@pytest.mark.parametrize("coarse_hz", [10, 1000])
@pytest.mark.parametrize("level", [0.0, 0.5])
def test_the_output_goes_on_while_samples_are_bad(coarse_hz, level):
    """After the jump all samples are black without dark current: the input is held, and levels are crossed as above."""
    jump = 2_345_678
    further = np.concatenate([[jump, jump + 1], np.arange(4, 60) * 1_100_000 + 7])

    def log_light(ns):
        return np.select([ns <= jump, ns == jump + 1], [0.0, 1.95], -np.inf)

    events, _ = sensed(gaps_of(log_light, further, coarse_hz, 0.1), threshold=C, bandwidth_hz=HZ, bandwidth_level=level)
    k = np.arange(1, 10)
    closed = jump - TAU * S * np.log(1 - k * C / 1.95)
    slope = (1.95 - k * C) / (TAU * S)
    error = np.array([e[1] for e in events]) - closed
    assert len(events) == 9 and (np.abs(error) < (C / 50 + 1e-6) / slope + 1).all()


def test_events_hang_little_on_the_coarse_rate():
    """Coarse frames at 30 and 240 Hz of the same lines: the same events to a fiftieth of a threshold."""
    rng = np.random.default_rng(1)
    knots = np.sort(rng.choice(np.arange(1, S // 5), 300, replace=False))
    heights = np.cumsum(rng.normal(0, 0.3, 302))
    ends = np.concatenate(([0], knots, [S // 5 + 1]))
    found = []
    for coarse_hz in (30, 240):
        gaps = gaps_of(lambda ns: np.interp(ns, ends, heights), knots, coarse_hz, 6 / 30)
        found.append(sensed(gaps, threshold=C, bandwidth_hz=300.0)[0])
    a, b = ([e[1] for e in events] for events in found)
    assert len(a) == len(b) > 50 and [e[5] for e in found[0]] == [e[5] for e in found[1]]
    assert np.median(np.abs(np.array(a) - b)) < 10_000


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("level", [0.0, 3.0])
def test_lines_between_the_samples_are_the_output(poles, level):
    """Against the filter at 2,000 frames for each line of the input; the corner follows the light, or does not."""
    rng = np.random.default_rng(7)
    gap = S // 30
    further = np.sort(rng.choice(np.arange(1, gap), 12, replace=False))
    heights = rng.normal(0, 1, 14)
    ends = np.concatenate(([0], further, [gap]))
    fine = np.unique(np.concatenate([np.linspace(a, b, 2000) for a, b in pairwise(ends)]).astype(np.int64))
    params = {"bandwidth_hz": 200.0, "bandwidth_level": level, "poles": poles}
    dense = Photoreceptor(1, 1, **params)
    luminance = np.exp(np.interp(fine, ends, heights)).astype(np.float32)
    exact = np.log(dense.advance(wp.array(luminance, device="cpu"), fine, 0, np.array([True])).numpy())
    gaps = gaps_of(lambda ns: np.interp(ns, ends, heights), further, 30, 1 / 30)
    at, y = traced(gaps, hz=200.0, bandwidth_level=level, poles=poles, chord=C / 50)
    deviation = np.abs(np.interp(fine, at, y) - exact).max()
    # Where 1 / tau changes along a line, it is taken as constant over a tenth in ln I.
    assert deviation < (C / 50 + 1e-6 if level == 0 else 0.02)
    assert (np.diff(at) > 0).all() and len(at) < 40 * 14


def test_nothing_hangs_on_other_environments_or_on_the_message():
    """An environment beside others, and a gap cut in two, to the byte; also where a gap has no further sample."""
    gaps = random_gaps(np.random.default_rng(3), (3, 2, 4), 3, 6, 5.0, 0.03)
    params = {"bandwidth_hz": 150.0, "bandwidth_level": 1.0, "threshold": 0.15}
    together, _ = sensed(gaps, **params)
    for env in range(3):
        alone = []
        for gap in gaps:
            first = np.asarray(gap.further.first)[env * 8 : env * 8 + 9]
            own = slice(first[0], first[-1])
            further = Further(first - first[0], gap.further.offset[own], gap.further.value[own])
            alone.append(Gap(gap.start, gap.t, gap.frames[env : env + 1], further))
        found, _ = sensed(alone, **params)
        assert [e[1:] for e in together if e[0] == env] == [e[1:] for e in found]
        if env == 2:
            none = Further(np.zeros(9, int), np.zeros(0, int), np.zeros(0))
            quiet = [Gap(g.start, g.t, g.frames, none) for g in alone]
            halves = in_parts(quiet, 3)
            assert sensed(halves, **params)[0] == sensed(quiet, **params)[0]


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("level", [0.0, 1.0])
def test_pixels_that_bend_are_filtered_as_those_that_do_not(poles, level):
    """Light that changes little, so that most pixels bend in some steps alone: any split gives the same bytes."""
    rng = np.random.default_rng(11)
    gaps = random_gaps(rng, (1, 12, 20), 6, 8, 0.3, bad=0.0)
    light = np.cumsum(rng.normal(0, 0.03, (1, 1 + 6 * 8, 12, 20)) * rng.uniform(0, 2, (12, 20)), 1)
    light = np.exp(np.where(rng.random(light.shape) < 0.01, light + 0.3, light)).astype(np.float32)
    for k, gap in enumerate(gaps):
        gap.frames = np.ascontiguousarray(light[:, :1] if k == 0 else light[:, 1 + 8 * (k - 1) : 1 + 8 * k])
        gap.further.value[:] = np.exp(0.1 * np.log(gap.further.value))
    params = {"bandwidth_hz": 60.0, "bandwidth_level": level, "bandwidth_poles": poles, "threshold": 0.05}
    found = sensed(gaps, **params)[0]
    assert len(found) > 1000
    for size in (1, 3):
        assert sorted(sensed(in_parts(gaps, size), **params)[0]) == sorted(found)


def test_bad_samples_and_many_of_its_own():
    """Many samples of the output, with NaN among the input, in lists that grow."""
    gaps = random_gaps(np.random.default_rng(8), (1, 10, 20), 3, 4, 30.0, 0.05)
    found, sensor = sensed(gaps, bandwidth_hz=100.0, threshold=0.02)
    assert len(found) > 20_000 and sensor.counts()["nonfinite"] > 100
    first = sensed(gaps[:2], bandwidth_hz=100.0, threshold=0.02)[0]
    assert found[: len(first)] == first
