"""Curves between frames against a dense rendering of moving hard edges, and against sinusoids in closed form."""

import numpy as np
import pytest

from bench.event_sensor import disk
from bench.event_sensor.alignment import align
from bench.event_sensor.signals import SECOND, Recording, Sinusoids, stamps
from evis.events.measure.distance import EventStream
from nodes.event_sensor.sensor import EventSensor

DENSE = 16_000
SIZE = 120


def sensed(frames, crossing):
    """Events of a recording, a few frames a call."""
    _, height, width = frames.luminance.shape
    sensor = EventSensor(height, width, crossing=crossing)
    packets = []
    for first in range(0, len(frames.t), 5):
        part = slice(first, first + 5)
        slopes = frames.dlog_dt[None, part] if crossing == "hermite" else None
        packets.append(sensor.process(frames.luminance[None, part], frames.t[part], np.zeros(1, np.int32), slopes))
    packets.append(sensor.flush())
    t, x, y, p = (np.concatenate([getattr(e, name) for e in packets]) for name in "txyp")
    return EventStream(t, x, y, p, width, height)


def every(frames, n):
    return Recording(*(np.ascontiguousarray(a[::n]) for a in (frames.luminance, frames.dlog_dt, frames.t)))


@pytest.mark.parametrize("soft", [0.0, 1.0])
def test_no_curve_is_worse_than_lines_on_hard_edges(soft):
    """The middle of the disk against its own 16 kHz rendering, whose own step is an eighth of the shortest."""
    t = stamps(DENSE, 0.024)
    frames = disk.record(t, soft, SIZE, SIZE)
    truth = disk.reference_events(frames.luminance, t, 0.2)
    for rate in (125, 250, 500, 1000, 2000):
        part = every(frames, DENSE // rate)
        lines = align(sensed(part, "linear"), truth).figures()
        for crossing in ("cubic", "hermite"):
            figures = align(sensed(part, crossing), truth).figures()
            for name in ("median [us]", "p99 [us]", "missed [%]", "extra [%]"):
                assert figures[name] <= lines[name], (rate, crossing, name, figures, lines)


@pytest.mark.parametrize("jump", [0.21, 0.5, 1.79, 7.0])
@pytest.mark.parametrize("crossing", ["monotone", "cubic"])
def test_a_jump_anywhere_in_a_step_is_found_nearer_than_by_lines(crossing, jump):
    """All crossings of a jump are at one time, even over the step: |u - U| in the median and at 99 %, U uniform."""
    t = np.arange(9, dtype=np.int64) * SECOND // 1000
    luminance = np.exp(np.where(t > 4e6, jump, 0.0))[:, None, None].astype(np.float32)
    at = (np.arange(1000) + 0.5) / 1000
    off = {}
    for name in ("linear", crossing):
        events = sensed(Recording(luminance, luminance, t), name)
        assert len(events.t) == int(jump / 0.2)
        off[name] = np.abs((events.t[:, None] - 4_000_000) / 1e6 - at)
    for share in (0.5, 0.99):
        assert np.quantile(off[crossing], share) <= np.quantile(off["linear"], share) + 1e-3


@pytest.mark.parametrize(
    ("crossing", "rate", "median", "missed"),
    [
        ("cubic", 125, 20, 0.8), ("cubic", 250, 2.5, 0.15), ("cubic", 1000, 0.05, 0.02),
        ("hermite", 125, 1.1, 0.3), ("hermite", 250, 0.2, 0.1), ("hermite", 1000, 0.012, 0.02),
    ],
)  # fmt: skip
def test_sinusoids_are_met_within_what_their_curve_can_do(crossing, rate, median, missed):
    """Amplitudes 0.25 to 1.25, 1 to 20 Hz; median [us], missed [%]. Lines: 120, 30, 1.9 us; 2.5, 0.9, 0.17 %."""
    signal = Sinusoids(40, 60, seed=3)
    frames = signal.record(rate, 0.5)
    figures = align(sensed(frames, crossing), signal.events(0.2, int(frames.t[-1]))).figures()
    assert figures["median [us]"] <= median and figures["missed [%]"] <= missed and figures["extra [%]"] <= 0.01
