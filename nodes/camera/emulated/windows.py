"""Cuts a recording into the stretches of time in which a sensor would send it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from evis.events import Recording
from evis.events.arrays import Events, Triggers

AHEAD_NS = 200_000_000
"""Files store frames and inertial samples behind the events of their time; so much later at most [ns]."""


def windows_in_file_order(
    recording: Recording, window_ns: Callable[[], int], end_ns: int | None
) -> Iterator[tuple[int, Events]]:
    """Yields (end [ns], events) of each stretch that has any, in the file's order; nothing later than end_ns.

    window_ns: gives the length of the next stretch [ns], at whose multiples it ends.
    """
    while (following := recording.next_t_ns) is not None and (end_ns is None or following <= end_ns):
        stamp = _end_of(following, window_ns(), end_ns)
        yield stamp, recording.read_until(stamp)


def windows_in_time_order(
    recording: Recording, window_ns: Callable[[], int], end_ns: int | None, seen: Callable[[Events], None]
) -> Iterator[tuple[int, Events]]:
    """Yields stretches as windows_in_file_order does, with frames and samples at their own times; none ends inside a
    frame.

    seen: told of all that is read, in the file's order.
    """
    following = recording.next_t_ns
    held = Events.empty()
    while following is not None and (end_ns is None or following <= end_ns):
        stamp = _end_of(following, window_ns(), end_ns)
        read = recording.read_until(stamp + AHEAD_NS)
        seen(read)
        held = Events.concatenate([held, read])
        for frame in sorted(held.frames, key=lambda f: f.t_ns):
            if frame.t_ns <= stamp:
                stamp = max(stamp, frame.end_ns, frame.exposure_end_ns)
        part, held = _split(held, stamp)
        yield stamp, part
        times = [*_first_times(held), recording.next_t_ns]
        following = min((t for t in times if t is not None), default=None)


def _end_of(following_ns: int, window_ns: int, end_ns: int | None) -> int:
    """Returns the end [ns] of the stretch in which `following_ns` lies."""
    stamp = -(-following_ns // window_ns) * window_ns
    return stamp if end_ns is None else min(stamp, end_ns)


def _first_times(events: Events) -> list[int]:
    """Returns the earliest time of each kind that is there [ns]."""
    times = [int(part.t.min()) for part in (events, events.triggers, events.imu) if len(part)]
    return times + [f.t_ns for f in events.frames]


def _split(events: Events, t_ns: int) -> tuple[Events, Events]:
    """Splits events at t_ns, which belongs to the first part; the order of each kind is kept."""
    return _part(events, t_ns, True), _part(events, t_ns, False)


def _part(events: Events, t_ns: int, early: bool) -> Events:
    """Returns the part up to t_ns (`early`), or the part after it."""

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
