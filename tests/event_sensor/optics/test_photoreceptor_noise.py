"""The photoreceptor's noise against closed forms of the process, Rice's rate of crossings, and a double threshold over
paths that are drawn by their autocorrelation alone; and that it hangs on nothing but seed, pixel and time."""

import itertools
import math

import numpy as np
import pytest
import warp as wp
from scipy import special, stats

from evis.random_numbers import GOLDEN, mix
from nodes.event_sensor.input.batch import Batch, Size
from nodes.event_sensor.optics import photoreceptor_noise
from nodes.event_sensor.optics.filtered_noise_kernels import standard_normal
from nodes.event_sensor.optics.photoreceptor_noise import PhotoreceptorNoise
from nodes.event_sensor.parameters import resolve_sensor
from nodes.event_sensor.sensor import EventSensor, Further

S = 1_000_000_000
TAU = 5e-3
HZ = 1 / (2 * math.pi * TAU)
NONE = np.zeros(1, np.int32)


def autocorrelation(poles, s):
    """Of white noise through one pole, or two: exp(-s) and (1 + s) exp(-s)."""
    return np.exp(-s) * (1 + s * (poles - 1))


def noise_of(light, seconds, **params):
    """Noise of pixels in constant light [ln I], [instants, pixels], and from one instant to the next [ns]."""
    p = resolve_sensor("sensor", "ideal", {"bandwidth_hz": HZ, "photoreceptor_noise": 0.1, **params})
    size = Size(1, light.size, 1, 1)
    noise = PhotoreceptorNoise(size, 7, p, wp.get_device("cpu"))
    found = []
    t = np.arange(round(10 * seconds) + 1) * (S // 10 + 7)  # never at an instant of the noise but the first
    for k, stamp in enumerate(t):
        images = wp.array(light.astype(np.float32), device="cpu")
        begin = np.array([k == 0])
        batch = Batch(images, images, np.array([stamp]), 1, 1, int(t[max(k - 1, 0)]), 0, begin, (NONE, NONE))
        for part in noise.parts(batch):
            if part.further is not None:
                found.append(part.further.value.numpy().reshape(light.size, -1).T.astype(np.float64))
    level = light.astype(np.float32).astype(np.float64) + p["dark_level"]
    return np.log(np.concatenate(found) / level), round(S * TAU / photoreceptor_noise.PARTS[p["bandwidth_poles"]])


@pytest.mark.parametrize("poles", [1, 2])
def test_variance_and_autocorrelation_are_those_of_the_poles(poles):
    n, step = noise_of(np.full(1500, 3.0), 2.0, bandwidth_poles=poles)
    z = n / 0.1
    # Of 1500 paths of 400 tau, 600,000 tau in all: about 300,000 independent values.
    assert abs(z.mean()) < 4 * math.sqrt(2 * poles / 6e5)
    for lag in (0, 1, 2, 5, 10, 20, 40):
        s = lag * step * 1e-9 / TAU
        found = (z[lag:] * z[: len(z) - lag]).mean()
        assert abs(found - autocorrelation(poles, s)) < 5 * math.sqrt(2 * (poles + 1) / 6e5), lag
    assert stats.kstest(z[:: 40 * poles].ravel()[:20_000], "norm").pvalue > 1e-3
    # It is stationary from its first instant on.
    first = z[0]
    assert abs(first.var() - 1) < 5 * math.sqrt(2 / 1500) and np.abs(np.corrcoef(z[0], z[200])[0, 1]) < 0.13


@pytest.mark.parametrize(
    "params",
    [
        {"bandwidth_level": 1.0},
        {"bandwidth_level": 1.0, "photoreceptor_noise_level": 0.1},
        {"bandwidth_level": 1.0, "bandwidth_exponent": 0.5, "photoreceptor_noise_level": 2.0},
        {"photoreceptor_noise_level": 2.0, "dark_level": 0.05},
        {"bandwidth_level": 1.0, "photoreceptor_noise_level": 10.0, "bandwidth_poles": 2},
    ],
)
def test_its_strength_and_its_corner_follow_the_light(params):
    """sigma^2 goes with corner over light, and never above 1; the corner is the photoreceptor's."""
    poles, lights = params.get("bandwidth_poles", 1), np.array([0.003, 0.05, 0.5, 1.0, 4.0, 40.0])
    light = np.repeat(lights, 400)
    n, step = noise_of(light, 4.0, **params)
    dark, level, power = params.get("dark_level", 0.0), params.get("bandwidth_level", 0.0), params.get(
        "bandwidth_exponent", 1.0
    )  # fmt: skip

    def corner(i):
        return np.minimum(1.0, i / level) ** power if level else np.ones_like(i)

    seen, at = lights + dark, params.get("photoreceptor_noise_level", 0.0)
    sigma = np.full(lights.shape, 0.1)
    if at:
        sigma = np.minimum(1.0, 0.1 * np.sqrt(corner(seen) / corner(np.array(at)) * at / seen))
    for k in range(len(lights)):
        own = n[:, 400 * k : 400 * (k + 1)] / sigma[k]
        share = corner(seen)[k]
        independent = 400 * max(1.0, 4.0 * share / TAU / (2 * poles))
        assert abs(own.var() - 1) < 5 * math.sqrt(2 / independent), lights[k]
        lag = max(1, round(TAU / share / (step * 1e-9)))
        if lag < len(own) // 2:
            found = (own[lag:] * own[:-lag]).mean()
            assert abs(found - autocorrelation(poles, lag * step * 1e-9 / TAU * share)) < 5 * math.sqrt(4 / independent)


def test_normal_numbers_are_the_inverse_of_their_distribution():
    """Against scipy, of the same uniform numbers; also far out."""

    @wp.kernel(enable_backward=False)
    def draw_all(stream: wp.uint64, out: wp.array(dtype=wp.float64)):
        i = wp.tid()
        out[i] = standard_normal(stream, wp.int64(i))

    count = 2_000_000
    out = wp.zeros(count, dtype=wp.float64, device="cpu")
    wp.launch(draw_all, count, [wp.uint64(77)], [out], device="cpu")
    with np.errstate(over="ignore"):
        bits = mix(np.uint64(77) + (np.arange(count, dtype=np.uint64) + np.uint64(1)) * GOLDEN)
    uniform = ((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    exact = special.ndtri(uniform)
    assert np.abs(out.numpy() - exact).max() < 1e-6 and np.abs(exact).max() > 4.9


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0])
def test_smooth_noise_crosses_a_level_at_rices_rate(level):
    """Two poles: 1 / (pi tau) exp(-u^2 / 2 sigma^2) crossings a second, up and down (Rice 1944; -R''(0) = 1 / tau^2).

    Lines between instants leave out the fastest turns: of a level in the middle arccos(R(h)) / (pi h) are left, 0.923
    of Rice's rate.
    """
    n, step = noise_of(np.full(1500, 1.0), 2.0, bandwidth_poles=2)
    crossed = np.diff(np.signbit(n - level * 0.1).astype(int), axis=0) != 0
    rate = crossed.mean() / (step * 1e-9)
    rice = math.exp(-(level**2) / 2) / (math.pi * TAU)
    # Of 1500 paths the rate is known to 0.25 %, at two standard deviations to 0.5 %.
    assert 0.90 * rice < rate < 0.95 * rice
    if level == 0:
        h = step * 1e-9
        assert abs(rate * math.pi * h / math.acos(autocorrelation(2, h / TAU)) - 1) < 0.01


def drawn_paths(poles, per_tau, seconds, count, seed):
    """Paths of unit variance, [instants, paths], by their autocorrelation alone (circulant embedding, float64)."""
    n = 1 << math.ceil(math.log2(2 * seconds / TAU * per_tau + 40 * per_tau))
    lag = np.minimum(np.arange(n), n - np.arange(n)) / per_tau
    power = np.fft.fft(autocorrelation(poles, lag)).real
    assert power.min() > -1e-9
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((n, count)) + 1j * rng.standard_normal((n, count))
    return np.fft.fft(white * np.sqrt(np.maximum(power, 0) / n)[:, None], axis=0).real[: round(seconds / TAU * per_tau)]


def double_threshold(paths, on, off):
    """Events, ON and OFF, of each path: whenever it has moved by a threshold from the last event's level."""
    reference, found = paths[0].copy(), np.zeros((2, paths.shape[1]))
    for level in paths[1:]:
        ups = np.floor(np.maximum(level - reference, 0) / on)
        downs = np.floor(np.maximum(reference - level, 0) / off)
        reference += ups * on - downs * off
        found += ups, downs
    return found


@pytest.mark.parametrize("poles", [1, 2])
@pytest.mark.parametrize("on, off", [(0.5, 0.5), (1.5, 1.5), (2.0, 3.0)])
def test_events_in_constant_light_come_at_the_rate_of_a_double_threshold(poles, on, off):
    """Thresholds in standard deviations of the noise."""
    sigma, seconds, count = 0.1, 0.5, 1600
    params = {"threshold_on": on * sigma, "threshold_off": off * sigma, "bandwidth_poles": poles}
    sensor = EventSensor(40, 40, seed=5, bandwidth_hz=HZ, photoreceptor_noise=sigma, **params)
    t = np.arange(0, S // 2 + 1, S // 30)
    events = sensor.process(np.full((1, len(t), 40, 40), 2.0, np.float32), t, NONE)
    pixel = events.y.astype(int) * 40 + events.x
    made = np.stack([np.bincount(pixel[events.p == p], minlength=count) for p in (1, 0)])
    per_tau = photoreceptor_noise.PARTS[poles]
    expected = double_threshold(drawn_paths(poles, per_tau, seconds, count, 1), on, off)
    for a, b in zip(made, expected):
        spread = math.sqrt((a.var() + b.var()) / count)
        assert a.sum() > 500 and abs(a.mean() - b.mean()) < 4.5 * spread
    # Of instants that come ever closer there would be more events, of two poles hardly any.
    finer = double_threshold(drawn_paths(poles, 64, seconds, 300, 2), on, off)
    share = made.sum() / count / (finer.sum() / 300)
    assert (0.5 < share < 0.95) if poles == 1 else (0.9 < share < 1.06)


def test_frames_do_not_change_it():
    """The same events of constant light at 30 and at 1000 frames a second; float32 light may move one by 1e-6 ln I."""
    params = {"threshold": 0.1, "bandwidth_hz": HZ, "photoreceptor_noise": 0.1, "bandwidth_poles": 2}
    found = []
    for hz in (30, 1000):
        t = np.arange(hz + 1) * S // hz
        events = EventSensor(20, 20, **params).process(np.full((1, hz + 1, 20, 20), 0.7, np.float32), t, NONE)
        order = np.lexsort((events.t, events.x, events.y))
        found.append([getattr(events, name)[order] for name in "yxpt"])
    assert len(found[0][0]) == len(found[1][0]) > 20_000
    assert all((a == b).all() for a, b in zip(found[0][:3], found[1][:3]))
    late = np.abs(found[0][3] - found[1][3])
    assert np.median(late) <= 1 and late.max() < 50_000


def walk(shape, seed=1):
    """Light that goes up and down, with some black and bad samples."""
    rng = np.random.default_rng(seed)
    light = np.exp(np.cumsum(rng.normal(0, 0.2, shape), 1)).astype(np.float32)
    light[rng.random(shape) < 0.02] = 0.0
    light[rng.random(shape) < 0.01] = np.nan
    return light


def told(events):
    env = np.repeat(np.arange(len(events.env_offsets) - 1), np.diff(events.env_offsets))
    c = np.zeros(len(env), np.int64) if events.c is None else events.c
    return sorted(zip(*(np.asarray(a).tolist() for a in (env, events.t, events.y, events.x, c, events.p))))


FAULTS = {"threshold_mismatch": 0.02, "refractory_us": 200, "leak_rate": 3, "shot_rate": 5, "readout_rate": 3e5}
KINDS = [
    {},
    {"bandwidth_poles": 2, "bandwidth_level": 1.5, "photoreceptor_noise_level": 1.0, "dark_level": 0.01},
    {"bandwidth_level": 1.5, "bandwidth_exponent": 0.5, "dark_level": 0.01, **FAULTS},
]


@pytest.mark.parametrize("params", KINDS)
@pytest.mark.parametrize("channels", [1, 3])
def test_the_same_bytes_of_any_message_and_beside_any_environments(params, channels, monkeypatch):
    params = {"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1, "threshold": 0.08, **params}
    shape = (2, 24, 3, 4, *([3] if channels == 3 else []))
    light, t = walk(shape), 5_000 + np.cumsum(np.random.default_rng(2).integers(1, 9_000_000, 24))

    def run(light, a_call, seed=7):
        sensor = EventSensor(3, 4, len(light), channels=channels, seed=seed, **params)
        found = []
        for k in range(0, 24, a_call):
            episodes = np.zeros(len(light), np.int32)
            found += told(sensor.process(light[:, k : k + a_call], t[k : k + a_call], episodes))
        return sorted(found + told(sensor.flush())), sensor.counts()

    whole, counts = run(light, 24)
    assert len(whole) > 500 and counts["nonfinite"] > 0
    for a_call in (1, 5):
        assert run(light, a_call) == (whole, counts)
    # In parts within a call, for want of memory.
    monkeypatch.setattr(photoreceptor_noise, "AT_ONCE", 500)
    assert run(light, 24) == (whole, counts)
    for env in range(2):
        alone, _ = run(light[env : env + 1], 7, seed=7 + env)
        assert [e[1:] for e in whole if e[0] == env] == [e[1:] for e in alone]


@pytest.mark.parametrize("poles", [1, 2])
def test_further_samples_go_on_from_part_to_part_of_a_message(poles, monkeypatch):
    """A message of eight frames, whole and in parts, has the events of eight messages with the samples of each."""
    params = {"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1, "threshold": 0.08, "bandwidth_poles": poles}
    rng = np.random.default_rng(5)
    gap, light = 5_000_000, walk((1, 9, 3, 4), seed=3)
    t = gap * np.arange(9)
    # Of a pixel up to four in a gap, of some pixels none at all.
    there = rng.random((8, 3, 4, 4)) < 0.5 * (np.arange(12).reshape(3, 4) % 3 > 0)[..., None]
    k, y, x, _ = np.nonzero(there)
    offset = np.unique(rng.integers(1, gap, 4 * len(k)))[rng.permutation(len(k))]  # no two alike
    value = np.exp(rng.normal(0, 0.3, len(k))).astype(np.float32)
    value[rng.random(len(k)) < 0.05] = np.nan

    def run(cuts):
        sensor = EventSensor(3, 4, seed=7, **params)
        found = told(sensor.process(light[:, :1], t[:1], NONE))
        for first, end in itertools.pairwise(cuts):
            own = (k >= first) & (k < end)
            after = gap * (k[own] - first) + offset[own]
            further = Further.of_pixels((3, 4), y[own], x[own], after, value[own])
            found += told(sensor.process(light[:, first + 1 : end + 1], t[first + 1 : end + 1], NONE, further=further))
        return sorted(found), sensor.counts()

    apart, counts = run(range(9))
    assert len(apart) > 100 and counts["nonfinite"] > 0
    assert run([0, 8]) == (apart, counts)
    monkeypatch.setattr(photoreceptor_noise, "AT_ONCE", 100)
    assert run([0, 8]) == (apart, counts) == run([0, 3, 8])


def test_an_environment_that_begins_anew_changes_no_other_and_has_other_noise():
    params = {"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1, "threshold": 0.1}
    t = np.arange(1, 9) * 10_000_000
    light = np.ones((2, 8, 4, 5), np.float32)

    def run(second):
        sensor = EventSensor(4, 5, 2, **params)
        return [told(sensor.process(light, t + k * 80_000_000, np.array([0, second * k], np.int32))) for k in range(2)]

    on, anew = run(0), run(1)
    assert on[0] == anew[0] and len(on[1]) > 200
    assert [e for e in on[1] if e[0] == 0] == [e for e in anew[1] if e[0] == 0]
    assert [e for e in on[1] if e[0] == 1] != [e for e in anew[1] if e[0] == 1]
    # No event before its first frame; and a sensor that begins there alone has the same.
    begun = [e[1:] for e in anew[1] if e[0] == 1]
    assert begun[0][0] > t[0] + 80_000_000
    alone = EventSensor(4, 5, seed=1, **params).process(light[:1], t + 80_000_000, np.array([1], np.int32))
    assert begun == [e[1:] for e in told(alone)]


@pytest.mark.parametrize("poles", [1, 2])
def test_further_samples_along_the_line_change_nothing_but_rounding(poles):
    """Of a constant corner; the photoreceptor's own samples lie within a fiftieth of a threshold of its output."""
    params = {"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1, "threshold": 0.15, "bandwidth_poles": poles}
    rng, t = np.random.default_rng(4), np.arange(1, 13) * 10_000_000
    level = np.cumsum(rng.normal(0, 0.02, (13, 4, 5)), 0)
    light = np.exp(level[1:])[None].astype(np.float32)
    offsets = np.sort(rng.choice(11_000, 60, replace=False)) * 10_000 + t[0] + 4_321
    y, x = (a.ravel() for a in np.mgrid[:4, :5])
    many = np.tile(offsets - t[0], 20)
    lines = np.stack([np.interp(offsets, t, level[1:, a, b]) for a, b in zip(y, x)])
    further = Further.of_pixels(
        (4, 5), np.repeat(y, 60), np.repeat(x, 60), many.astype(np.int32), np.exp(lines).ravel().astype(np.float32)
    )
    with_lists = told(EventSensor(4, 5, **params).process(light, t, NONE, further=further))
    without = told(EventSensor(4, 5, **params).process(light, t, NONE))
    assert len(without) > 100 and abs(len(with_lists) - len(without)) <= 0.02 * len(without)
    near = {(y, x, p, t // 1_000_000) for _, t, y, x, _, p in with_lists}
    hit = sum(any((y, x, p, t // 1_000_000 + d) in near for d in (-1, 0, 1)) for _, t, y, x, _, p in without)
    assert hit > 0.97 * len(without)


def test_noise_in_the_dark_goes_below_the_dark_current():
    """Black pixels have as many OFF as ON events, and those of bright ones with the same dark current."""
    params = {"bandwidth_hz": HZ, "photoreceptor_noise": 0.1, "threshold": 0.15, "dark_level": 0.01}
    t = np.arange(0, S + 1, S // 30)
    found = []
    for light in (0.0, 5.0):
        events = EventSensor(30, 30, **params).process(np.full((1, 31, 30, 30), light, np.float32), t, NONE)
        found.append(np.bincount(events.p, minlength=2))
    assert found[0].sum() > 10_000 and abs(found[0][0] / found[0][1] - 1) < 0.05
    assert np.abs(found[0] / found[1] - 1).max() < 0.01


def test_without_it_nothing_changes():
    light, t = walk((1, 30, 6, 7)), np.arange(30) * 3_000_000
    for params in ({"bandwidth_hz": 60.0}, {"preset": "davis346", "dark_level": 0.01}):
        plain = told(EventSensor(6, 7, **params).process(light, t, NONE))
        assert plain == told(EventSensor(6, 7, photoreceptor_noise=0.0, **params).process(light, t, NONE))
        assert plain != told(EventSensor(6, 7, photoreceptor_noise=0.02, **params).process(light, t, NONE))


@pytest.mark.parametrize(
    "params, message",
    [
        ({"bandwidth_hz": 0.0}, "photoreceptor_noise is 0.1 and bandwidth_hz 0: it has .*; give one"),
        ({"crossing": "cubic"}, "photoreceptor_noise is 0.1 and crossing cubic: .*take crossing linear"),
        ({"model": "evis-paper"}, "photoreceptor_noise is 0.1, which event model evis-paper has none of; take"),
        ({"marked": True}, "light and noise make each crossing together"),
    ],
)
def test_what_does_not_go_together_is_refused(params, message):
    with pytest.raises(ValueError, match=message):
        EventSensor(4, 4, **{"bandwidth_hz": 60.0, "photoreceptor_noise": 0.1, **params})


def test_frames_that_are_too_far_apart_are_refused_before_anything_moves():
    params = {"bandwidth_hz": 1e5, "photoreceptor_noise": 0.1}
    sensor = EventSensor(40, 40, **params)
    ones = np.ones((1, 1, 40, 40), np.float32)
    sensor.process(ones, np.array([0]), NONE)
    with pytest.raises(ValueError, match=r"every 199 ns: 8.04e\+08 of them from 0 ns .*put frames between the two"):
        sensor.process(ones, np.array([100_000_000]), NONE)
    with pytest.raises(ValueError, match=r"bandwidth_hz 0.1 .* 2.15 s between two frames"):
        slow = EventSensor(4, 4, bandwidth_hz=0.1, photoreceptor_noise=0.1)
        slow.process(np.ones((1, 2, 4, 4), np.float32), np.array([0, 3 * S]), NONE)


@pytest.mark.parametrize("hz", [1e-12, 1e-320])
def test_a_corner_that_nothing_passes_gives_no_events(hz):
    """What moves by less than 1e-10 ln I in the time of these frames, light and noise, crosses nothing."""
    sensor = EventSensor(4, 4, bandwidth_hz=hz, bandwidth_poles=2, photoreceptor_noise=0.5, threshold=0.01)
    t = np.array([0, 1, 2]) * 2 * S
    assert len(sensor.process(walk((1, 3, 4, 4)), t, NONE).t) == 0
