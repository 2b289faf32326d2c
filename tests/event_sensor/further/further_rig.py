"""Random messages with further samples, and what a pixel does alone, on frames at all instants of its samples."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from nodes.event_sensor.sensor import Events, EventSensor, Further

BAD = np.array([np.nan, -1.0, np.inf, -np.inf, 0.0, 1e-42, 1e-30, 3e38], np.float32)

WRONG = [
    ([0, 1], [5], [1.0], "have 2 entries in first, 2 pixels take 3"),
    ([0, 1, 2], [5, 6], [1.0], "have 2 offsets and 1 values, expected 2"),
    ([0, 2, 1], [5, 6], [1.0, 1.0], "do not ascend: first must go from 0"),
    ([0, 1, 1], [5, 6], [1.0, 1.0], "do not ascend: first must go from 0"),
    ([-1, 1, 2], [5, 6], [1.0, 1.0], "do not ascend: first must go from 0"),
    ([0, 9, 2], [5, 6], [1.0, 1.0], "do not ascend: first must go from 0"),
    ([0, 2, 2], [6, 6], [1.0, 1.0], "x 0, y 0 of environment 0 do not ascend in time"),
    ([0, 0, 2], [6, 5], [1.0, 1.0], "x 1, y 0 of environment 0 do not ascend in time"),
    ([0, 0, 1], [0], [1.0], "x 1, y 0 of environment 0 are at or before the start"),
    ([0, 0, 1], [10], [1.0], "are at or after the last frame"),
    ([0, 0, 1], [4], [1.0], "are at the stamp of a frame"),
    ([0.0, 0.0, 1.0], [4], [1.0], "have first of float64"),
    ([0, 0, 1 << 40], [4], [1.0], "have first up to 1099511627776, expected int32"),
]  # fmt: skip
"""first, offset, value, and what is said of them, of two pixels with frames after 4 and 10 ns."""


@dataclass
class Gap:
    """A message: stamps [K] ns, frames [E, K, H, W(, 3)], further samples and the stamp before."""

    start: int
    t: np.ndarray
    frames: np.ndarray
    further: Further


def level(rng: np.random.Generator, shape: tuple[int, ...], bad: float) -> np.ndarray:
    """Random light, a share of which is bad."""
    light = np.exp(rng.normal(0, 1.2, shape)).astype(np.float32)
    broken = rng.random(shape) < bad
    light[broken] = rng.choice(BAD, int(broken.sum()))
    return light


def random_gaps(
    rng: np.random.Generator, shape: tuple[int, ...], gaps: int = 3, frames: int = 3, rate: float = 4.0,
    bad: float = 0.05, length: int = 33_333_333, start: int = 0,
) -> list[Gap]:  # fmt: skip
    """Messages of [E, H, W(, 3)] pixels after a first frame at `start`, each `length` ns long.

    rate: mean number of further samples of the pixels that have some; in short gaps they lie 1 ns apart.
    """
    made = [Gap(start, np.array([start]), level(rng, (shape[0], 1, *shape[1:]), 0), no_further(shape))]
    for _ in range(gaps):
        inside = np.sort(rng.choice(np.arange(1, length), min(frames, length) - 1, replace=False))
        t = np.append(inside, length)
        free = np.setdiff1d(np.arange(1, length), t) if length < 1000 else None
        first, offset = [0], []
        for _ in range(int(np.prod(shape[:3]))):
            count = int(rng.poisson(rate)) if rng.random() < 0.7 else 0
            if free is None:
                own = np.setdiff1d(rng.integers(1, length, count), t)
            else:
                own = np.sort(rng.choice(free, min(count, len(free)), replace=False))
            offset += own.tolist()
            first.append(len(offset))
        values = level(rng, (len(offset), *shape[3:]), bad)
        further = Further(np.array(first, np.int32), np.array(offset, np.int32), values)
        made.append(Gap(start, start + t, level(rng, (shape[0], len(t), *shape[1:]), bad), further))
        start += length
    return made


def no_further(shape: tuple[int, ...]) -> Further:
    """No further samples of [E, H, W(, 3)] pixels."""
    none = np.zeros(0, np.int32)
    return Further(np.zeros(int(np.prod(shape[:3])) + 1, np.int32), none, np.zeros((0, *shape[3:]), np.float32))


def merged(gap: Gap, env: int, y: int, x: int) -> tuple[np.ndarray, np.ndarray]:
    """All samples of a pixel in the order of time: stamps [n] ns, values [n(, 3)]."""
    height, width = gap.frames.shape[2:4]
    q = (env * height + y) * width + x
    own = slice(gap.further.first[q], gap.further.first[q + 1])
    t = np.concatenate([gap.t, gap.start + gap.further.offset[own].astype(np.int64)])
    order = np.argsort(t)
    return t[order], np.concatenate([gap.frames[env, :, y, x], gap.further.value[own]])[order]


def in_parts(gaps: list[Gap], size: int) -> list[Gap]:
    """The same in messages of `size` frames."""
    parts = []
    for gap in gaps:
        start = gap.start
        stamp = gap.start + gap.further.offset.astype(np.int64)
        for a in range(0, len(gap.t), size):
            b = min(a + size, len(gap.t))
            inside = (stamp > start) & (stamp <= gap.t[b - 1])
            first = np.concatenate(([0], np.cumsum(inside)))[gap.further.first].astype(np.int32)
            further = Further(first, (stamp - start)[inside].astype(np.int32), gap.further.value[inside])
            parts.append(Gap(start, gap.t[a:b], np.ascontiguousarray(gap.frames[:, a:b]), further))
            start = int(gap.t[b - 1])
    return parts


def tell(events: Events) -> list[tuple[int, ...]]:
    """(environment, t, y, x, channel, p, signal) of each event, in the packet's order."""
    env = np.repeat(np.arange(len(events.env_offsets) - 1), np.diff(events.env_offsets))
    nothing = np.zeros(len(env), np.int64)
    c = nothing if events.c is None else events.c
    signal = nothing if events.signal is None else events.signal
    return list(zip(*(np.asarray(a).tolist() for a in (env, events.t, events.y, events.x, c, events.p, signal))))


def sensed(gaps: list[Gap], **params: Any) -> tuple[list[tuple[int, ...]], EventSensor]:
    """Events of the messages, each packet in order, and the sensor."""
    sensor = sensor_for(gaps, **params)
    found = []
    for gap in gaps:
        packet = tell(sensor.process(gap.frames, gap.t, np.zeros(sensor.envs, np.int32), further=gap.further))
        order = [(e, t, y, x) for e, t, y, x, *_ in packet]
        assert order == sorted(order), "events do not come in the order of environment, t, y, x"
        found += packet
    return found, sensor


def sensed_alone(gaps: list[Gap], **params: Any) -> tuple[list[tuple[int, ...]], dict[str, int]]:
    """The same from frames alone: a sensor for each pixel, whose frames are at that pixel's samples.

    Every other pixel of it sees constant light; what these do is left out. Also the counts of all these sensors.
    """
    envs, _, height, width = gaps[0].frames.shape[:4]
    found, counts = [], dict.fromkeys(EventSensor(1, 1, **params).counts(), 0)
    for env, y, x in np.ndindex(envs, height, width):
        sensor = sensor_for(gaps, **params)
        for gap in gaps:
            t, values = merged(gap, env, y, x)
            frames = np.ones((envs, len(t), *gap.frames.shape[2:]), np.float32)
            frames[env, :, y, x] = values
            events = tell(sensor.process(frames, t, np.zeros(envs, np.int32)))
            found += [event for event in events if (event[0], event[2], event[3]) == (env, y, x)]
        counts = {name: counts[name] + n for name, n in sensor.counts().items()}
    return found, counts


def sensor_for(gaps: list[Gap], **params: Any) -> EventSensor:
    """A sensor for the messages' pixels."""
    envs, _, height, width = gaps[0].frames.shape[:4]
    channels = 3 if gaps[0].frames.ndim == 5 else 1
    return EventSensor(height, width, envs, channels=channels, **params)
