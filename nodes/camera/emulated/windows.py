"""Cuts a recording into stretches of time, as a sensor would send it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from evis.events import Recording
from evis.events.arrays import Events, Triggers

AHEAD_NS = 200_000_000
"""Files store frames and inertial samples behind the events of their time; so much later at most [ns]."""


def plain_windows(recording: Recording, window_ns: int, end_ns: int | None) -> Iterator[tuple[int, Events]]:
    """Gives (end [ns], events) of each stretch that has any, in the file's order; nothing later than end_ns."""
    while (following := recording.next_t_ns) is not None and (end_ns is None or following <= end_ns):
        stamp = -(-following // window_ns) * window_ns
        stamp = stamp if end_ns is None else min(stamp, end_ns)
        yield stamp, recording.read_until(stamp)


def sorted_windows(
    recording: Recording, window_ns: int, end_ns: int | None, seen: Callable[[Events], None]
) -> Iterator[tuple[int, Events]]:
    """Cuts a recording as plain_windows does, with all at its own time; a stretch never ends inside a frame.

    seen: told of all that is read, in the file's order.
    """
    following = recording.next_t_ns
    stock = Events.empty()
    while following is not None and (end_ns is None or following <= end_ns):
        stamp = -(-following // window_ns) * window_ns
        stamp = stamp if end_ns is None else min(stamp, end_ns)
        read = recording.read_until(stamp + AHEAD_NS)
        seen(read)
        stock = Events.concatenate([stock, read])
        for frame in sorted(stock.frames, key=lambda f: f.t_ns):
            if frame.t_ns <= stamp:
                stamp = max(stamp, frame.end_ns, frame.exposure_end_ns)
        part, stock = _split(stock, stamp)
        yield stamp, part
        times = [*_first_times(stock), recording.next_t_ns]
        following = min((t for t in times if t is not None), default=None)


def _first_times(events: Events) -> list[int]:
    """The earliest time of each kind that is there [ns]."""
    times = [int(part.t.min()) for part in (events, events.triggers, events.imu) if len(part)]
    return times + [f.t_ns for f in events.frames]


def _split(events: Events, t_ns: int) -> tuple[Events, Events]:
    """Everything up to t_ns, and the rest; the order of each kind is kept."""
    return _where(events, t_ns, True), _where(events, t_ns, False)


def _where(events: Events, t_ns: int, early: bool) -> Events:
    def chosen(t: np.ndarray) -> np.ndarray:
        return (t <= t_ns) == early

    keep, edges, imu = chosen(events.t), events.triggers, events.imu
    k, m = chosen(edges.t), chosen(imu.t)
    return Events(
        events.t[keep], events.x[keep], events.y[keep], events.p[keep],
        triggers=Triggers(edges.t[k], edges.id[k], edges.value[k]),
        imu=dataclasses.replace(
            imu, t=imu.t[m], acceleration=imu.acceleration[m], angular_velocity=imu.angular_velocity[m],
            temperature=imu.temperature[m],
        ),
        frames=[f for f in events.frames if (f.t_ns <= t_ns) == early],
    )  # fmt: skip
