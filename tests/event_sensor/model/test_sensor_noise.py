"""The sensor's faults against their closed forms; every statistical bound is 4.5 standard deviations of its law."""

import math

import numpy as np
import pytest

from nodes.event_sensor.engines import nonideal
from nodes.event_sensor.model.faults import fixed_pattern
from nodes.event_sensor.sensor import EventSensor
from nodes.event_sensor.simulate import simulate_frames

MS = 1_000_000
COLUMNS = ("t", "x", "y", "p")


def constant(level, step_ms, seconds, shape=(40, 50)):
    """(frames, stamps) of constant light."""
    count = round(seconds * 1e3 / step_ms) + 1
    t = np.arange(count, dtype=np.int64) * round(step_ms * MS)
    return np.broadcast_to(np.float32(level), (count, *shape)), t


def spread(count, expected):
    """Deviation of a Poisson count in standard deviations."""
    return abs(count - expected) / math.sqrt(expected)


def ramp(slope, seconds, step_ms):
    t = np.arange(round(seconds * 1e3 / step_ms) + 1, dtype=np.int64) * round(step_ms * MS)
    return np.exp(slope * 1e-9 * t)[:, None, None], t


# -- threshold mismatch ------------------------------------------------------------------------------------------------


def test_thresholds_are_normal_with_a_floor_and_independent():
    on, _ = fixed_pattern.thresholds(3, 1, 200_000, (0.2, 0.3), 0.04, 0.15)
    free_on, free_off = fixed_pattern.thresholds(3, 1, 200_000, (0.2, 0.3), 0.04, 0.0)
    assert (on == np.maximum(free_on, np.float32(0.15))).all()
    for got, mean in ((free_on, 0.2), (free_off, 0.3)):
        z = (np.sort(got.astype(np.float64)) - mean) / 0.04
        normal = 0.5 * (1 + np.vectorize(math.erf)(z[::100] / math.sqrt(2)))
        assert np.abs(normal - np.arange(0, len(z), 100) / len(z)).max() < 2.2 / math.sqrt(len(z))  # Kolmogorov, 1e-4
    assert abs(np.corrcoef(free_on, free_off)[0, 1]) < 4.5 / math.sqrt(len(on))


def test_each_pixel_counts_by_its_own_threshold():
    frames = np.exp(np.array([0, 2.0, 0.5]))[:, None, None] * np.ones((3, 30, 40))
    events = simulate_frames(frames, np.arange(3) * MS, threshold_mismatch=0.03, seed=5)
    on, off = (v.astype(np.float64) for v in fixed_pattern.thresholds(5, 1, 1200, (0.2, 0.2), 0.03, 0.01))
    index = events["y"].astype(int) * 40 + events["x"]
    ups = np.floor((2 + 2**-21) / on)
    downs = np.floor((ups * on - 0.5 + 2**-21) / off)
    assert np.bincount(index[events["p"] == 1], minlength=1200).tolist() == ups.tolist()
    assert np.bincount(index[events["p"] == 0], minlength=1200).tolist() == downs.tolist()


def test_a_fixed_pattern_that_pixels_have_no_field_for_is_refused(monkeypatch):
    """Without a word the fault would have no effect."""
    monkeypatch.setattr(nonideal, "pattern_of", lambda size, seed, p: {"c_of": np.ones(size.pixels, np.float32)})
    with pytest.raises(ValueError, match="c_of"):
        simulate_frames(np.ones((2, 3, 4)), np.arange(2) * MS, refractory_us=1.0)


# -- refractory period -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("crossing", ["linear", "cubic"])
@pytest.mark.parametrize("step_ms", [0.5, 7, 100])
def test_refractory_holds_in_reset(step_ms, crossing):
    """5 nat/s, C 0.2, 50 ms: 40 ms up to the threshold, then 50 ms dead, at any step, also one that holds both."""
    frames, t = ramp(5.0, 2.1, step_ms)
    events = simulate_frames(frames, t, crossing=crossing, refractory_us=50_000)
    want = 40 + 90 * np.arange(len(events["t"]))
    assert len(events["t"]) == math.floor((t[-1] / MS - 40) / 90) + 1
    assert np.abs(events["t"] / MS - want).max() < 1e-3


def test_refractory_holds_back_noise_as_well():
    """A Poisson process of rate r behind a dead time d fires at r / (1 + r d)."""
    frames, t = constant(0.5, 10, 5)
    events = simulate_frames(frames, t, hot_pixel_fraction=1, hot_pixel_rate=100, refractory_us=20_000, seed=1)
    expected = 2000 * 5 * 100 / (1 + 100 * 0.02)
    assert abs(len(events["t"]) - expected) < 0.01 * expected
    order = np.lexsort((events["t"], events["x"], events["y"]))
    pixel = (events["y"].astype(int) * 50 + events["x"])[order]
    gaps = np.diff(events["t"][order])[pixel[1:] == pixel[:-1]]
    assert gaps.min() >= 20 * MS


def test_refractory_longer_than_the_run():
    frames, t = ramp(5.0, 1.0, 1)
    assert len(simulate_frames(frames, t, refractory_us=1e9)["t"]) == 1


# -- leak --------------------------------------------------------------------------------------------------------------


def by_pixel(events, width, pixels):
    """Times and polarities of each pixel's events: `pixels` pairs of arrays."""
    index = events["y"].astype(int) * width + events["x"]
    order = np.lexsort((events["t"], index))
    cuts = np.cumsum(np.bincount(index, minlength=pixels))[:-1]
    return list(zip(np.split(events["t"][order], cuts), np.split(events["p"][order], cuts)))


def leaked_before(rate, shape, **params):
    """u [pixels] in [0, 1): thresholds leaked before the first frame, from the first events in constant light."""
    frames, t = constant(0.7, 100, 1.1 / rate, shape)
    events = simulate_frames(frames, t, leak_rate=rate, **params)
    return np.array([1 - times[0] * 1e-9 * rate for times, _ in by_pixel(events, shape[1], math.prod(shape))])


@pytest.mark.parametrize("step_ms", [0.1, 10, 700])
def test_leak_fires_on_events_at_its_rate(step_ms):
    """5 Hz: every 200 ms from within the first 200 to within the last 200, whatever the frames.

    To 2^-23, the rounding within which a frame has reached a level, at 5 Hz x 0.2 = 1 / s: 120 ns.
    """
    frames, t = constant(0.7, step_ms, 2.1, (6, 8))
    events = simulate_frames(frames, t, leak_rate=5)
    assert (events["p"] == 1).all()
    for times, _ in by_pixel(events, 8, 48):
        assert 0 < times[0] <= 200 * MS and t[-1] - 200 * MS - 120 <= times[-1] <= t[-1]
        assert np.abs(times - times[0] - 200 * MS * np.arange(len(times))).max() <= 120


@pytest.mark.parametrize("seconds", [0.09, 0.99, 1.0, 1.99, 2.13])
def test_leak_has_its_rate_in_a_run_of_any_length(seconds):
    """A pixel has floor(5 T + u) events, u uniform: 5 T on average, with the variance f (1 - f) of its fraction f."""
    frames, t = constant(0.7, 10, seconds)
    events = simulate_frames(frames, t, leak_rate=5, seed=11)
    fraction = 5 * seconds % 1
    deviation = math.sqrt(2000 * fraction * (1 - fraction))
    assert abs(len(events["t"]) - 2000 * 5 * seconds) <= 4.5 * deviation + 1


def test_leak_phases_are_uniform_and_each_pixels_own():
    u = leaked_before(5, (40, 50))
    assert u.min() >= 0 and u.max() < 1
    assert np.abs(np.sort(u) - (np.arange(2000) + 0.5) / 2000).max() < 2.2 / math.sqrt(2000)  # Kolmogorov, 1e-4
    grid = u.reshape(40, 50)
    pairs = [(grid[:, 1:], grid[:, :-1]), (grid[1:], grid[:-1]), (u, leaked_before(5, (40, 50), seed=1))]
    for a, b in pairs:
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4.5 / math.sqrt(a.size)


def test_leak_phases_are_new_in_every_episode():
    """The same in a sensor that begins with that episode; the first frame never fires."""
    frames, t = constant(0.5, 10, 0.3)
    frames = np.ascontiguousarray(frames)[None]
    sensor = EventSensor(40, 50, leak_rate=5, seed=1)
    a, b = (sensor.process(frames, t, np.array([e])) for e in range(2))
    firsts = []
    for packet in (a, b):
        assert packet.t.min() > t[0]
        first = np.full(2000, t[-1])
        np.minimum.at(first, packet.y.astype(int) * 50 + packet.x, packet.t)
        firsts.append(first)
    assert first.max() <= 200 * MS and abs(np.corrcoef(*firsts)[0, 1]) < 4.5 / math.sqrt(2000)
    again = EventSensor(40, 50, leak_rate=5, seed=1).process(frames, t, np.array([1]))
    assert again.t.tolist() == b.t.tolist() and again.x.tolist() == b.x.tolist()


@pytest.mark.parametrize("slope,on,off", [(5.0, 0.2, 0.2), (-5.0, 0.2, 0.2), (-2.0, 0.1, 0.25), (0.0, 0.3, 0.2)])
@pytest.mark.parametrize("crossing", ["linear", "cubic"])
def test_leak_and_a_ramp_share_one_crossing(slope, on, off, crossing):
    """The reference begins u C_on low and falls at leak_rate C_on: their difference is u C_on + speed t.

    ON at (k - u) C_on / speed, OFF at (k C_off + u C_on) / speed, k = 1, 2 ...
    """
    frames, t = ramp(slope, 1.0, 3)
    frames = np.broadcast_to(frames, (len(t), 4, 5))
    thresholds = {"threshold_on": on, "threshold_off": off, "seed": 3}
    events = simulate_frames(frames, t, leak_rate=4, crossing=crossing, **thresholds)
    speed = slope + 4 * on
    for u, (times, polarities) in zip(leaked_before(4, (4, 5), **thresholds), by_pixel(events, 5, 20)):
        k = np.arange(1, 100)
        want = (k - u) * on / speed if speed > 0 else (k * off + u * on) / -speed
        # Stamps are known to 1e-6 / speed; the last may fall on either side of the end.
        least = np.count_nonzero(want < t[-1] * 1e-9 - 2e-6 / abs(speed))
        assert least <= len(times) <= np.count_nonzero(want < t[-1] * 1e-9 + 2e-6 / abs(speed))
        assert (polarities == (speed > 0)).all()
        assert np.abs(times * 1e-9 - want[: len(times)]).max() < 2e-6 / abs(speed)


@pytest.mark.parametrize("crossing", ["frame", "linear", "monotone"])
def test_a_leaking_pixel_meets_the_signal_where_its_reference_lies(crossing):
    """A rise by 2.3 C fires floor(2.3 + u), u uniform, and one less on the way back; a fall floor(2.3 - u), as back.

    A leak of 10 uHz does nothing in 10 ms but says where the reference lies; without leak it is 2 and 2.
    """
    rise = np.exp(0.2 * np.array([0, 2.3, 0]))
    t = np.arange(3) * 5 * MS
    counts = {}
    for name, light in (("rise", rise), ("fall", 1 / rise)):
        for rate in (0, 1e-5):
            frames = light[:, None, None] * np.ones((3, 40, 50))
            events = simulate_frames(frames, t, leak_rate=rate, threshold=0.2, crossing=crossing, seed=5)
            pixels = by_pixel(events, 50, 2000)
            counts[name, rate] = [np.array([np.count_nonzero(p == s) for _, p in pixels]) for s in (1, 0)]
    assert all((n == 2).all() for name in ("rise", "fall") for n in counts[name, 0])
    on, off = counts["rise", 1e-5]
    assert set(on.tolist()) == {2, 3} and (off == on - 1).all()
    assert abs((on == 3).mean() - 0.3) < 4.5 * math.sqrt(0.3 * 0.7 / 2000)
    back, down = counts["fall", 1e-5]
    assert set(down.tolist()) == {1, 2} and (back == down).all()
    assert abs((down == 2).mean() - 0.3) < 4.5 * math.sqrt(0.3 * 0.7 / 2000)


def test_leak_jitter_is_a_spread_over_pixels():
    frames, t = constant(0.7, 100, 20)
    events = simulate_frames(frames, t, leak_rate=10, leak_jitter=0.2, seed=2)
    counts = np.bincount(events["y"].astype(int) * 50 + events["x"], minlength=2000)
    rates = fixed_pattern.leak_rates(2, 1, 2000, 10, 0.2)
    assert np.abs(counts - 20 * rates).max() < 1.001
    assert abs(rates.std() / 10 - 0.2) < 4.5 * 0.2 / math.sqrt(2 * 2000)


def test_leak_as_a_coin_fires_at_most_once_a_step():
    for step_ms, rate, expected in ((1, 20, 20 * 0.5 * 2000), (100, 20, 5 * 2000)):
        frames, t = constant(0.7, step_ms, 0.5)
        events = simulate_frames(frames, t, leak_rate=rate, leak_model="bernoulli")
        assert (events["p"] == 1).all()
        assert len(events["t"]) == expected if step_ms == 100 else spread(len(events["t"]), expected) < 4.5
        assert len(np.unique(events["t"] % (step_ms * MS))) > 0.9 * len(events["t"])


# -- shot noise and hot pixels -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_ms", [0.1, 1, 10, 1000])
def test_shot_noise_is_poisson_at_any_frame_rate(step_ms):
    """30 Hz in the dark, half of it at half of white: also with 30 candidates a step."""
    frames, t = constant(0.5, step_ms, 1.0 if step_ms < 1 else 3.0, (20, 25) if step_ms < 1 else (40, 50))
    events = simulate_frames(frames, t, shot_rate=30, shot_white=1.0, seed=7)
    pixels, seconds = frames[0].size, t[-1] * 1e-9
    assert spread(len(events["t"]), 15 * pixels * seconds) < 4.5
    assert spread((events["p"] == 1).sum(), 7.5 * pixels * seconds) < 4.5
    counts = np.bincount(events["y"].astype(int) * frames.shape[2] + events["x"], minlength=pixels)
    assert abs(counts.var() / counts.mean() - 1) < 4.5 * math.sqrt(2 / pixels)


def test_noise_does_not_know_the_frames():
    """The very same events from 10 Hz and from 1 kHz frames of constant light."""
    some = {"shot_rate": 40, "shot_white": 2.0, "hot_pixel_fraction": 0.1, "hot_pixel_rate": 90, "seed": 3}
    runs = [simulate_frames(*constant(0.5, step, 1.0), **some) for step in (1, 100)]
    assert len(runs[0]["t"]) > 50_000
    assert all(runs[0][n].tolist() == runs[1][n].tolist() for n in COLUMNS)


@pytest.mark.parametrize("level,share", [(0.0, 1.0), (0.25, 0.75), (0.9, 0.1), (1.0, 0.0), (7.0, 0.0)])
def test_shot_noise_falls_with_light(level, share):
    frames, t = constant(level * 4, 10, 2.0)
    events = simulate_frames(frames, t, shot_rate=20, shot_white=4.0, dark_level=0.1)
    assert len(events["t"]) == 0 if share == 0 else spread(len(events["t"]), 20 * 2 * 2000 * share) < 4.5


def test_thinning_uses_the_light_between_frames():
    """Light from 0 to white in one step of 1 s: half of the rate, falling linearly, a quarter in the last half."""
    frames = np.zeros((2, 40, 50), np.float32)
    frames[1] = 1.0
    t = np.array([0, 1000 * MS])
    events = simulate_frames(frames, t, shot_rate=100, threshold=10, dark_level=0.5)
    assert spread(len(events["t"]), 100 * 2000 / 2) < 4.5
    assert spread((events["t"] > 500 * MS).sum(), 100 * 2000 / 8) < 4.5


def test_hot_pixels_are_few_and_fixed():
    frames, t = constant(0.5, 10, 2.0, (100, 100))
    events = simulate_frames(frames, t, hot_pixel_fraction=0.05, hot_pixel_rate=200, seed=4)
    counts = np.bincount(events["y"].astype(int) * 100 + events["x"], minlength=10_000)
    hot = np.flatnonzero(counts)
    assert hot.tolist() == np.flatnonzero(fixed_pattern.hot_rates(4, 1, 10_000, 0.05, 200)).tolist()
    assert abs(len(hot) - 500) < 4.5 * math.sqrt(500 * 0.95)
    assert spread(len(events["t"]), len(hot) * 400) < 4.5
    assert spread((events["p"] == 1).sum(), len(hot) * 200) < 4.5


def test_rates_of_hot_pixels_are_log_normal():
    frames, t = constant(0.5, 10, 2.0, (100, 100))
    given = {"hot_pixel_fraction": 0.05, "hot_pixel_rate": 200, "hot_pixel_spread": 0.8, "seed": 4}
    events = simulate_frames(frames, t, **given)
    counts = np.bincount(events["y"].astype(int) * 100 + events["x"], minlength=10_000)
    rates = fixed_pattern.hot_rates(4, 1, 10_000, 0.05, 200, 0.8)
    hot = rates > 0
    assert (hot == (fixed_pattern.hot_rates(4, 1, 10_000, 0.05, 200) > 0)).all() and not counts[~hot].any()
    assert abs(np.log(rates[hot]).std() - 0.8) < 4.5 * 0.8 / math.sqrt(2 * hot.sum())
    assert abs(rates[hot].mean() / 200 - 1) < 4.5 * math.sqrt(math.expm1(0.8**2) / hot.sum())
    span = (t[-1] - t[0]) * 1e-9
    assert np.abs((counts - rates * span) / np.sqrt(np.maximum(rates * span, 1))).max() < 5.5


def test_shot_noise_has_its_share_of_on():
    frames, t = constant(0.0, 10, 2.0, (40, 50))
    events = simulate_frames(frames, t, shot_rate=50, shot_on_share=0.7, threshold=10, dark_level=0.5)
    even = simulate_frames(frames, t, shot_rate=50, threshold=10, dark_level=0.5)
    assert (events["t"] == even["t"]).all() and (events["x"] == even["x"]).all(), "its times are the same"
    total = len(events["t"])
    assert abs(events["p"].sum() - 0.7 * total) < 4.5 * math.sqrt(0.21 * total)


def test_event_cap_counts_what_it_drops():
    frames = np.exp(np.array([0, 2.1, 0.0]))[:, None, None] * np.ones((3, 4, 5))
    events = simulate_frames(frames, np.arange(3) * MS, event_cap=3)
    assert len(events["t"]) == 20 * 6 and events["dropped"] == 20 * (20 - 6)
    assert (events["p"] == 1).sum() == (events["p"] == 0).sum()


# -- all together ------------------------------------------------------------------------------------------------------

ALL = {
    "threshold_mismatch": 0.03, "refractory_us": 500, "leak_rate": 8, "leak_jitter": 0.2, "shot_rate": 20,
    "shot_white": 3.0, "hot_pixel_fraction": 0.05, "hot_pixel_rate": 100,
}  # fmt: skip


def walk(seed, *shape):
    return np.exp(np.cumsum(np.random.default_rng(seed).normal(0, 0.1, shape), 0)).astype(np.float32)


@pytest.mark.parametrize("more", [{}, {"leak_model": "bernoulli"}, {"crossing": "cubic"}, {"model": "evis-paper"}])
def test_environments_are_single_runs_with_seed_plus_e(more):
    frames = walk(0, 40, 3, 6, 7).swapaxes(0, 1)
    t = np.arange(40, dtype=np.int64) * 5 * MS
    together = EventSensor(6, 7, 3, seed=10, **ALL, **more)
    packets = [together.process(frames[:, a : a + 8], t[a : a + 8], np.zeros(3, np.int32)) for a in range(0, 40, 8)]
    packets.append(together.flush())
    for e in range(3):
        single = simulate_frames(frames[e], t, seed=10 + e, **ALL, **more)
        mine = [slice(p.env_offsets[e], p.env_offsets[e + 1]) for p in packets]
        for name in COLUMNS:
            got = np.concatenate([getattr(p, name)[s] for p, s in zip(packets, mine)])
            assert got.tolist() == single[name].tolist()
    assert len(got) > 200
    other = simulate_frames(frames[2], t, seed=9, **ALL, **more)
    assert other["t"].tolist() != single["t"].tolist()


def test_a_new_episode_has_new_noise_and_the_old_pattern():
    frames, t = constant(0.5, 10, 0.5)
    sensor = EventSensor(40, 50, hot_pixel_fraction=0.1, hot_pixel_rate=50, seed=1)
    a, b = (sensor.process(np.ascontiguousarray(frames)[None], t, np.array([e])) for e in range(2))
    assert a.t.tolist() != b.t.tolist()
    pixels = [set((p.y.astype(int) * 50 + p.x).tolist()) for p in (a, b)]
    assert len(pixels[0] ^ pixels[1]) < 0.01 * len(pixels[0])
    again = EventSensor(40, 50, hot_pixel_fraction=0.1, hot_pixel_rate=50, seed=1)
    assert again.process(np.ascontiguousarray(frames)[None], t, np.array([1])).t.tolist() == b.t.tolist()


@pytest.mark.parametrize("origin", [36_000 * 10**9, 2**62])
def test_late_stamps_are_as_exact_as_early_ones(origin):
    frames = walk(1, 30, 6, 7)
    t = np.arange(30, dtype=np.int64) * 5 * MS
    early = simulate_frames(frames, t, **{**ALL, "crossing": "cubic"})
    late = simulate_frames(frames, t + origin, **{**ALL, "crossing": "cubic"})
    assert (late["t"] - origin).tolist() == early["t"].tolist() and late["p"].tolist() == early["p"].tolist()
    assert len(early["t"]) > 200


@pytest.mark.parametrize("more", [{}, {"crossing": "cubic"}, {"crossing": "monotone"}, {"crossing": "frame"}])
def test_no_pixel_goes_deaf(more):
    """After 2 s of every fault and bad samples, a step of 3 nats is at least 3 / (C + 4 sigma) - 1 events in each."""
    rng = np.random.default_rng(2)
    frames = np.exp(rng.normal(0, 0.1, (400, 10, 12)))
    frames[rng.random(frames.shape) < 0.1] = np.nan
    frames[-3:-1] = 1.0
    frames[-1] = 1.0
    frames = np.concatenate([frames, np.full((3, 10, 12), math.exp(3.0))])
    t = np.arange(403, dtype=np.int64) * 5 * MS
    events = simulate_frames(frames, t, **{**ALL, "refractory_us": 10}, **more)
    last = (events["t"] > t[399]) & (events["p"] == 1)
    counts = np.bincount(events["y"][last].astype(int) * 12 + events["x"][last], minlength=120)
    least = math.floor(3 / (0.2 + 4 * 0.03)) - 1
    assert counts.min() >= (1 if more.get("crossing") == "frame" else least)
