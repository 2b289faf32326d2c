"""Crossing times on curves, against closed forms; look-ahead across packets; the paper's own equations."""

import math
from itertools import pairwise

import numpy as np
import pytest

from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
ONE = np.zeros(1, np.int32)
COLUMNS = ("t", "x", "y", "p")


def run(luminance, t, cuts=(), slopes=None, seed=0, envs=1, episodes=None, **params):
    """Events of [T, H, W] or [E, T, H, W] frames in packets that end at `cuts`, and what look-ahead held back."""
    frames = np.asarray(luminance, np.float32)
    frames = frames[None] if frames.ndim == 3 else frames
    sensor = EventSensor(*frames.shape[2:], envs, seed=seed, **params)
    packets, edges = [], [0, *cuts, frames.shape[1]]
    for a, b in pairwise(edges):
        more = {} if slopes is None else {"dlog_dt": np.ascontiguousarray(slopes[None, a:b])}
        part = np.ascontiguousarray(frames[:, a:b])
        packets.append(sensor.process(part, t[a:b], np.zeros(envs, np.int32), **more))
        assert ((packets[-1].t > sensor.t_base) & (packets[-1].t <= sensor.stamp)).all()
    packets.append(sensor.flush())
    return {n: np.concatenate([getattr(p, n) for p in packets]) for n in COLUMNS}, sensor


def sines(rate, frequency=10.0, amplitude=1.0, size=64, seconds=0.4):
    """(luminance [T, 1, size], dL/dt, stamps, phases) of one sinusoid per pixel."""
    t = np.arange(round(rate * seconds) + 1, dtype=np.int64) * (10**9 // rate)
    phase = np.linspace(0, 2 * np.pi, size, endpoint=False)
    angle = 2 * np.pi * frequency * t[:, None] * 1e-9 + phase
    slopes = amplitude * 2 * np.pi * frequency * np.cos(angle)
    return np.exp(amplitude * np.sin(angle))[:, None], slopes[:, None].astype(np.float32), t, phase


def crossing_error_ns(events, phase, frequency=10.0, amplitude=1.0, c=0.2):
    """|t - nearest time at which the sinusoid is at the level that the event stands for|, event by event."""
    errors = []
    for x, start in enumerate(phase):
        mine = events["x"] == x
        steps = np.where(events["p"][mine] == 1, 1, -1)
        level = amplitude * math.sin(start) + np.cumsum(steps) * c
        angle = np.arcsin(np.clip(level / amplitude, -1, 1))
        angle = np.where(steps > 0, angle, np.pi - angle) - start
        now = events["t"][mine] * 1e-9
        turns = np.rint((2 * np.pi * frequency * now - angle) / (2 * np.pi))
        errors.append(np.abs(now - (angle + 2 * np.pi * turns) / (2 * np.pi * frequency)) * 1e9)
    return np.concatenate(errors)


@pytest.mark.parametrize("rate", [125, 250, 1000])
def test_curves_come_nearer_to_a_sinusoid_than_lines(rate):
    """Steps of 0.5, 0.25 and 0.06 rad: the chord is off by (w dt)^2 / 8, a cubic by the fourth power."""
    frames, slopes, t, phase = sines(rate)
    medians = {}
    for crossing in ("linear", "monotone", "cubic", "hermite"):
        events, _ = run(frames, t, slopes=slopes if crossing == "hermite" else None, crossing=crossing)
        medians[crossing] = np.median(crossing_error_ns(events, phase))
    assert medians["hermite"] < medians["cubic"] < medians["monotone"] < medians["linear"]
    step = 2 * np.pi * 10 / rate
    assert medians["cubic"] < 1.5 * step**2 * medians["linear"] + 40
    assert medians["hermite"] < 0.1 * step**2 * medians["linear"] + 10


def test_a_curve_finds_the_peak_between_frames():
    """Twelve samples a wave, the two highest at 0.966 of the peak: a level of 0.99 is passed only between them."""
    t = np.arange(121, dtype=np.int64) * 8 * MS
    angle = np.pi / 6 * np.arange(121) + np.pi / 2 - np.pi / 12
    c = 0.99 - math.sin(angle[0])
    slopes = (np.cos(angle) * np.pi / 6 / 8e-3).astype(np.float32)[:, None, None]
    for crossing, found in (("linear", 0), ("monotone", 0), ("cubic", 1), ("hermite", 1)):
        given = slopes if crossing == "hermite" else None
        frames = np.exp(np.sin(angle))[:, None, None]
        events, _ = run(frames, t, slopes=given, crossing=crossing, threshold_on=c, threshold_off=10)
        assert events["p"].tolist() == [1] * found, crossing


@pytest.mark.parametrize("crossing", ["monotone", "cubic", "hermite"])
@pytest.mark.parametrize("pattern", [[0, 0, 1, 1, 0, 0], [0, 0, 0, 1, 1, 1], [0, 1, 1, 0, 1, 1, 0], [0, 0, 0.05, 1, 1]])
def test_edges_neither_ring_nor_lose(crossing, pattern):
    """Whole thresholds of each edge and nothing else: a free Catmull-Rom curve overshoots by 0.07 to 0.12."""
    level = np.array([*pattern, pattern[-1]], float) * 1.79
    t = np.arange(len(level)) * MS
    events, _ = run(np.exp(level)[:, None, None], t, slopes=np.zeros((len(level), 1, 1), np.float32),
                    crossing=crossing, threshold=0.1791)  # fmt: skip
    jumps = np.diff(np.floor(np.abs(level) / 0.1791 + 1e-6) * np.sign(level)).astype(int)
    assert (events["p"] == 1).sum() == jumps[jumps > 0].sum() and (events["p"] == 0).sum() == -jumps[jumps < 0].sum()


def test_a_straight_line_is_the_same_on_every_curve():
    t = np.arange(30, dtype=np.int64) * MS
    frames = np.exp(40e-9 * t)[:, None, None]
    slopes = np.full((30, 1, 1), 40, np.float32)
    for crossing in ("linear", "monotone", "cubic", "hermite"):
        events, _ = run(frames, t, slopes=slopes if crossing == "hermite" else None, crossing=crossing)
        # float32 frames: 6e-8 of L, 1.5 ns at this slope, a few times that where differences make the slopes.
        assert np.abs(events["t"] - np.arange(1, len(events["t"]) + 1) * 5 * MS).max() < 12
        assert len(events["t"]) == 5


def test_frame_stamps_are_those_of_the_frames():
    t = np.arange(5, dtype=np.int64) * MS
    events, _ = run(np.exp([0, 0.5, 0.5, 0.7, 0.0])[:, None, None], t, crossing="frame")
    assert events["t"].tolist() == [MS] * 2 + [3 * MS] + [4 * MS] * 3


@pytest.mark.parametrize("crossing", ["monotone", "cubic", "hermite", "linear"])
@pytest.mark.parametrize("noisy", [False, True])
def test_packets_join_to_one_call(crossing, noisy):
    """Also over bad samples, uneven steps and faults, whatever the cuts; look-ahead is carried across."""
    rng = np.random.default_rng(0)
    frames = np.exp(np.cumsum(rng.normal(0, 0.15, (61, 5, 7)), 0))
    frames[rng.random(frames.shape) < 0.02] = np.nan
    t = np.cumsum(rng.integers(1, 4 * MS, 61)).astype(np.int64) + 7
    slopes = rng.normal(0, 50, frames.shape).astype(np.float32)
    more = {"refractory_us": 300, "leak_rate": 20, "shot_rate": 50, "shot_white": 1e3} if noisy else {}
    more |= {"slopes": slopes} if crossing == "hermite" else {}
    whole, _ = run(frames, t, crossing=crossing, **more)
    assert len(whole["t"]) > 500
    for cuts in (range(1, 61), (1, 2, 30), (8, 16, 24, 32, 40, 48, 56), (59, 60)):
        parts, _ = run(frames, t, cuts, crossing=crossing, **more)
        order = np.lexsort((parts["x"], parts["y"], parts["t"]))
        assert all((parts[n] == parts[n][order]).all() for n in COLUMNS)
        for name in COLUMNS:
            assert parts[name].tolist() == whole[name].tolist(), (name, cuts)


def test_look_ahead_ends_at_an_episode():
    """Environment 0 begins again at frame 4; its old last step keeps its events and learns nothing of the new light."""
    t = np.arange(9, dtype=np.int64) * MS
    old, new = np.exp(0.3 * np.arange(4)), 50 * np.exp(-0.3 * np.arange(5))
    frames = np.stack([np.r_[old, new], np.exp(0.3 * np.arange(9))])[:, :, None, None].astype(np.float32)
    for cut in (1, 4):  # frames a call
        sensor = EventSensor(1, 1, 2, crossing="cubic")
        packets = []
        for a in range(0, 9, cut):
            b = min(a + cut, 9)
            packets.append(sensor.process(frames[:, a:b], t[a:b], np.array([int(a >= 4), 0])))
        packets.append(sensor.flush())
        ups = [[], []]
        for p in packets:
            for e in range(2):
                mine = slice(p.env_offsets[e], p.env_offsets[e + 1])
                ups[e] += list(zip(p.t[mine].tolist(), p.p[mine].tolist()))
        first, _ = run(old[:, None, None], t[:4], crossing="cubic")
        second, _ = run(new[:, None, None], t[4:], crossing="cubic")
        assert ups[0] == list(zip(first["t"].tolist(), first["p"].tolist())) + list(
            zip(second["t"].tolist(), second["p"].tolist())
        )
        assert len(ups[1]) == 12


def test_time_that_goes_back_needs_a_flush_first():
    sensor = EventSensor(1, 1, crossing="cubic")
    ramp = np.exp(0.3 * np.arange(4, dtype=np.float32)).reshape(1, 4, 1, 1)
    sensor.process(ramp, np.arange(4) * MS, ONE)
    with pytest.raises(ValueError, match=r"flush\(\) first"):
        sensor.process(ramp, np.arange(4) * MS, ONE + 1)
    assert len(sensor.flush().t) == 1 and len(sensor.flush().t) == 0
    assert len(sensor.process(ramp, np.arange(4) * MS, ONE + 1).t) == 3


def test_hermite_needs_slopes_and_survives_bad_ones():
    frames, slopes, t, phase = sines(250)
    with pytest.raises(ValueError, match="needs dlog_dt"):
        run(frames, t, crossing="hermite")
    with pytest.raises(ValueError, match="bandwidth_hz"):
        EventSensor(2, 2, crossing="hermite", bandwidth_hz=100)
    spoilt = slopes.copy()
    spoilt[np.random.default_rng(0).random(slopes.shape) < 0.05] = np.nan
    events, sensor = run(frames, t, slopes=spoilt, crossing="hermite")
    linear, _ = run(frames, t)
    assert sensor.counts()["unknown_slopes"] == np.isnan(spoilt[1:]).sum()
    assert np.percentile(crossing_error_ns(events, phase), 80) < np.median(crossing_error_ns(linear, phase))


def test_slopes_are_those_of_the_light_with_dark_current_and_blur():
    """dL/dt = I / (I + dark) dlnI/dt; a blur of equal pixels changes nothing."""
    frames, slopes, t, _ = sines(125, size=1)
    dark = 3.0
    tile = np.ones((1, 6, 6), np.float32)
    sharp, _ = run(frames * tile, t, slopes=slopes * tile, crossing="hermite", dark_level=dark)
    blurred, _ = run(frames * tile, t, slopes=slopes * tile, crossing="hermite", dark_level=dark, defocus_px=1)
    one = sharp["t"][(sharp["x"] == 0) & (sharp["y"] == 0)]
    base = math.log(1 + dark)
    steps = np.cumsum(np.where(sharp["p"][(sharp["x"] == 0) & (sharp["y"] == 0)] == 1, 0.2, -0.2))
    seen = np.log(np.exp(np.sin(2 * np.pi * 10 * one * 1e-9)) + dark) - base
    assert np.abs(seen - steps).max() < 4e-4
    assert len(blurred["t"]) == len(sharp["t"]) and np.abs(np.sort(blurred["t"]) - np.sort(sharp["t"])).max() < 2000


def test_paper_model_is_its_equations():
    """n = floor(|dL| / C) at the frame's stamp, the residual kept; float64, event by event."""
    rng = np.random.default_rng(1)
    frames = np.exp(np.cumsum(rng.normal(0, 0.3, (80, 4, 5)), 0)).astype(np.float32)
    t = np.arange(80, dtype=np.int64) * MS
    events, _ = run(frames, t, model="evis-paper", threshold_on=0.21, threshold_off=0.16)
    for y in range(4):
        for x in range(5):
            want, reference = [], math.log(frames[0, y, x])
            for k in range(1, 80):
                delta = math.log(frames[k, y, x]) - reference
                c = 0.21 if delta > 0 else 0.16
                n = math.floor(abs(delta) / c)
                reference += math.copysign(n * c, delta)
                want += [(int(t[k]), int(delta > 0))] * n
            mine = (events["y"] == y) & (events["x"] == x)
            assert list(zip(events["t"][mine].tolist(), events["p"][mine].tolist())) == want


def test_paper_refractory_suppresses_and_moves_on():
    t = np.arange(6, dtype=np.int64) * MS
    frames = np.exp(0.5 * np.arange(6))[:, None, None]
    events, _ = run(frames, t, model="evis-paper", refractory_us=1500)
    assert events["t"].tolist() == [MS, 3 * MS, 5 * MS]


def test_paper_noise_is_a_coin_per_step():
    """P = rate x step: 0.2 of the steps; above rate x step = 1 it saturates at one event a step."""
    frames = np.zeros((51, 40, 50)) + 0.5
    t = np.arange(51, dtype=np.int64) * 10 * MS
    for name, rate, chance in (("leak_rate", 20, 0.2), ("shot_rate", 20, 0.1), ("leak_rate", 300, 1.0)):
        events, _ = run(frames, t, model="evis-paper", **{name: rate})
        trials = 50 * 2000
        assert abs(len(events["t"]) - chance * trials) <= 4.5 * math.sqrt(trials * chance * (1 - chance))
        assert set(events["t"].tolist()) <= set(t.tolist())
        on = (events["p"] == 1).mean()
        assert on == 1 if name == "leak_rate" else abs(on - 0.5) < 2.3 / math.sqrt(len(events["t"]))


def test_the_papers_equations_have_no_crossing_to_choose():
    with pytest.raises(ValueError, match="evis-paper has no crossing"):
        EventSensor(2, 2, model="evis-paper", crossing="cubic")


def test_state_bytes_are_as_the_docstring_says():
    sizes = {
        (): 28,
        (("crossing", "frame"),): 28,
        (("crossing", "hermite"),): 84,
        (("crossing", "cubic"),): 88,
        (("event_cap", 5),): 76,
        (("refractory_us", 10),): 84,
        (("threshold_mismatch", 0.02), ("leak_rate", 1), ("shot_rate", 1)): 84,
        (("model", "evis-paper"),): 64,
    }
    for parameters, size in sizes.items():
        assert EventSensor(20, 30, 2, **dict(parameters)).state_bytes == size, parameters
