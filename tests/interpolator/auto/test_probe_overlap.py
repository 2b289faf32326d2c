"""Costs of whole gaps, as they are timed on a GPU, by a clock that only the stages move."""

import functools

import numpy as np
import pytest

from evis.scene import load_scene
from nodes.event_sensor.sensor import EventSensor
from nodes.interpolator.auto import chain
from nodes.interpolator.auto.overlap import Overlapped
from nodes.interpolator.auto.setting import Setting
from nodes.interpolator.auto.world import World
from nodes.interpolator.interpolator import Interpolator

DURATION = 200_000_000


@functools.cache
def disk():
    return load_scene("spinning_disk", {"width": 48, "height": 36})


def setting(duration_ns=DURATION, **given):
    return Setting(disk(), disk().camera("cam0"), duration_ns, sensor={"threshold": 0.2}, **given)


def overlapped(duration_ns=DURATION):
    return Overlapped(setting(duration_ns), World(disk(), duration_ns), [0, duration_ns // 2])


@pytest.fixture
def clock(monkeypatch):
    """A keyframe takes 1 s, a gap 10 s and 0.5 s per frame, the sensor 0.25 s a frame. Each sensor's first two calls
    take 100 s more, and so does all that an interpolator is given first."""
    now: list[float] = [0.0]
    known: dict[int, int] = {}
    kept: list[object] = []
    monkeypatch.setattr(Setting, "clock", lambda self: now[0])
    draw, push, process = chain.draw, Interpolator.push, EventSensor.process

    def calls(thing):
        kept.append(thing)
        known[id(thing)] = known.get(id(thing), 0) + 1
        return known[id(thing)]

    def drawing(*given):
        now[0] += 1.0
        return draw(*given)

    def pushing(self, *given, **named):
        t, frames = push(self, *given, **named)
        now[0] += 10 + 0.5 * frames.shape[1] + 100 * (calls(self) < 3)
        return t, frames

    def sensing(self, frames, *given):
        now[0] += 0.25 * frames.shape[1] + 100 * (calls(self) < 3)
        return process(self, frames, *given)

    monkeypatch.setattr(chain, "draw", drawing)
    monkeypatch.setattr(Interpolator, "push", pushing)
    monkeypatch.setattr(EventSensor, "process", sensing)


@pytest.mark.parametrize("method, rate", [("rigid", 62.5), ("splat", 31.25)])
def test_a_gap_is_its_keyframe_its_frames_and_their_events(clock, method, rate):
    """11 s and 0.75 s per frame; what is slow at first is left out. Other K follow."""
    full = overlapped()
    full.measure_gap(method, rate)
    gap = full.gaps[method, rate]
    assert (gap.fixed, gap.frame) == (pytest.approx(11), pytest.approx(0.75))
    assert full.seconds((method, rate, 16)) == pytest.approx(rate * (11 + 16 * 0.75))


def test_dense_rendering_is_a_frame_of_all_stages(clock):
    """1 s, 10.5 s and 0.25 s, whatever the rate."""
    full = overlapped()
    full._measure_others([])
    for rate, k in ((250.0, 1), (1000.0, 1), (31.25, 64)):
        assert full.seconds(("none", rate, k)) == pytest.approx(rate * k * 11.75)


def test_a_run_of_one_gap_is_timed_by_that_gap(monkeypatch):
    """40 ms at 31.25 keyframes per second hold one gap of 32 ms; it is run again and again, each in its own episode."""
    seen = []
    push = Interpolator.push

    def pushing(self, stamp, episodes, *given, **named):
        seen.append((stamp, int(episodes[0])))
        return push(self, stamp, episodes, *given, **named)

    full = overlapped(40_000_000)
    full._chain._interpolator("rigid", 8, 1)
    monkeypatch.setattr(Interpolator, "push", pushing)
    assert full._timed(("rigid", 31.25, 8)) > 0
    assert [stamp for stamp, _ in seen] == [0, 32_000_000] * (len(seen) // 2) and len(seen) >= 6
    assert len({episode for _, episode in seen}) == len(seen) // 2


def test_what_changes_costs_by_the_time_and_not_by_the_frame():
    """1 ms per frame and 100 ms per second."""
    full = overlapped()
    full._timed = lambda way: 1e-3 + 0.1 / way[1]
    full._measure_others([])
    assert (full.dense.fixed, full.dense.frame) == (pytest.approx(0.1), pytest.approx(1e-3))


@pytest.mark.parametrize("spent, fixed, frame", [((1.0, 0.9), 1.0, 0.0), ((1.0, 9.0), 0.0, 1 / 8)])
def test_noise_makes_no_cost_negative(spent, fixed, frame):
    """A longer gap that took less, and one that took more than its frames can."""
    full = overlapped()
    full._timed = lambda way: spent[way[2] > 8]
    full.measure_gap("rigid", 62.5)
    assert (full.gaps["rigid", 62.5].fixed, full.gaps["rigid", 62.5].frame) == (pytest.approx(fixed), frame)
    assert full.seconds(("splat", 62.5, 8)) is None


def test_keyframes_are_still_measured_for_the_cut_outs():
    full = overlapped()
    full.measure_keyframes()
    assert full.keyframe["none"] > 0 and len(full._changes) == 2 and np.max(full._changes) > 0.2
    assert full.dense.frame > 0
