"""Sensors of environments that do not share their time any more: those that were reset together share one.

A sensor takes all its environments at common stamps, and what is random in it is keyed by its seed, their number in it
and the number of the reset. So environments that begin anew by themselves leave the sensor that they were in, and get
one whose time begins with them. What that gives is moved to the stamps of all by the origin of their time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.random_numbers import mix
from msgs.own_time import CONFIGURED, NUMBER, ORIGIN, SEED, STAMP, alike

if TYPE_CHECKING:
    from nodes.event_sensor.further import Further

Columns = dict[str, np.ndarray]
Make = Callable[[int, int, int], Any]
"""Gives a sensor of so many environments, with this seed, for time that begins with this number of a reset."""
LEFT = -1
"""Stands for the number of a reset in rows of a sensor whose environment has left it."""


def seed_of_time(seed: int, number: int) -> int:
    """Gives the seed of random numbers that are keyed by time, which begins again: another one after each reset.

    It goes up by one from environment to environment as `seed` does.
    """
    return seed if not number else (seed + int(mix(np.array([number], np.uint64))[0])) % 2**64


@dataclass
class Part:
    """Holds the sensor of environments that were reset together.

    span: which they are; all others of them have left. sensor: an EventSensor, or a model with its `process`. seed: of
    its first environment. live: bool [n], which are still in it. numbers: int32 [n], what it was given last. stamp: own
    stamp [ns] of its last frame. origin: [ns].
    """

    span: slice
    sensor: Any
    seed: int
    live: np.ndarray
    numbers: np.ndarray
    stamp: int
    origin: int
    leaving: np.ndarray
    """bool [n], which have left it since its last frames: events of theirs may still be held back."""
    moved: bool = True
    """Whether its environments have begun anew with the present message."""


class Apart:
    """Senses E environments, some of which were reset by themselves."""

    def __init__(self, make: Make, seed: int) -> None:
        """make: makes sensors. seed: configured, of environment 0."""
        self._make, self._seed = make, seed
        self._parts: list[Part] = []
        self._rows: np.ndarray | None = None
        self._episodes: np.ndarray | None = None
        self._past: dict[str, int] = {}
        """Counts of the sensors that are gone."""
        self.t_base = 0

    def adopt(self, sensor: Any, episodes: np.ndarray, stamp_ns: int) -> None:
        """Takes over the sensor of all environments, whose last frames were at a stamp."""
        rows = common(episodes, stamp_ns)
        everyone = slice(0, len(rows))
        live, numbers = np.ones(len(rows), bool), rows[:, NUMBER].astype(np.int32)
        self._parts = [Part(everyone, sensor, self._seed, live, numbers, stamp_ns, 0, ~live)]
        self._rows, self._episodes = rows, episodes.copy()

    def process(
        self,
        image: Any,
        t: np.ndarray,
        own_t: np.ndarray | None,
        own: np.ndarray | None,
        episodes: np.ndarray,
        further: Further | None = None,
    ) -> tuple[Columns, np.ndarray]:
        """Senses the frames of a message, and gives its events by environment, and int64 [E + 1] offsets.

        Args:
            image: as of EventSensor.advance, [E, K, ...].
            t: int64 [K] ns, the stamps of the frames that all environments share.
            own_t: int64 [E, K] ns, in own time, None = t.
            own: the rows of msgs.own_time, None = all began together.
            episodes: int32 [E]; where it differs from the last message's an environment begins anew.
            further: samples between the frames, in own time.
        """
        rows = common(episodes, int(t[-1])) if own is None else np.array(own)
        own_t = np.broadcast_to(t, (len(rows), len(t))) if own_t is None else own_t
        found: list[list[tuple[Columns, int]]] = [[] for _ in rows]
        self._begin(self._anew(rows, episodes), rows, found)
        self._rows, self._episodes = rows, np.array(episodes)
        self.t_base = int(t[-1])
        for part in self._parts:
            self._sense(part, image, own_t, found, further)
        self._parts = [part for part in self._parts if part.live.any()]
        return self._joined(found)

    def finish(self) -> tuple[Columns, np.ndarray] | None:
        """Gives what the sensors still hold back, at the end; None where that is nothing."""
        assert self._rows is not None
        found: list[list[tuple[Columns, int]]] = [[] for _ in self._rows]
        for part in self._parts:
            self._flush(part, found)
        columns, offsets = self._joined(found)
        return (columns, offsets) if offsets[-1] else None

    def counts(self) -> dict[str, int]:
        """Gives what was set aside so far, by all sensors together."""
        return _sum([self._past, *(part.sensor.counts() for part in self._parts)])

    def _anew(self, rows: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Which environments' time begins anew, bool [E]: one that has diverged begins an episode, but goes on in its
        time."""
        if self._rows is None or self._episodes is None:
            return np.ones(len(rows), bool)
        other = (rows[:, [ORIGIN, SEED]] != self._rows[:, [ORIGIN, SEED]]).any(axis=1)
        return (episodes != self._episodes) & (other | (rows[:, STAMP] <= self._rows[:, STAMP]))

    def _begin(self, anew: np.ndarray, rows: np.ndarray, found: list[list[tuple[Columns, int]]]) -> None:
        """Gives environments that begin anew their sensors, and takes them out of those that they were in."""
        for part in self._parts:
            part.moved = False
            mine = anew[part.span] & part.live
            part.numbers[mine] = LEFT
            part.live, part.leaving = part.live & ~mine, part.leaving | mine
            if not part.live.any():
                self._flush(part, found)
        for run in alike(rows):
            where = np.flatnonzero(anew[run]) + run.start
            for envs in np.split(where, np.flatnonzero(np.diff(where) > 1) + 1):
                if len(envs):
                    self._place(slice(int(envs[0]), int(envs[-1]) + 1), rows[int(envs[0])])
        for part in [part for part in self._parts if not part.live.any()]:
            self._past = _sum([self._past, part.sensor.counts()])
            self._parts.remove(part)

    def _place(self, span: slice, row: np.ndarray) -> None:
        """Environments that begin anew together into a sensor of their own: the one that they had, if it is alike."""
        count, number = span.stop - span.start, int(row[NUMBER])
        seed = self._seed + span.start if row[SEED] == CONFIGURED else int(row[SEED])
        numbers = np.full(count, number, np.int32)
        part = next((p for p in self._parts if p.span == span and p.seed == seed and not p.live.any()), None)
        if part is None or not number or not getattr(part.sensor, "begins_again", False):
            nobody = np.zeros(count, bool)
            part = Part(span, self._make(count, seed, number), seed, nobody, numbers, 0, 0, nobody)
            self._parts.append(part)
        part.live, part.leaving = np.ones(count, bool), np.zeros(count, bool)
        part.numbers, part.moved, part.origin = numbers, True, int(row[ORIGIN])

    def _sense(
        self, part: Part, image: Any, own_t: np.ndarray, found: list[list[tuple[Columns, int]]],
        further: Further | None,
    ) -> None:  # fmt: skip
        """The events of a part, unless the message is of others alone."""
        assert self._rows is not None
        inner = int(np.argmax(part.live))
        t, before = own_t[part.span.start + inner], part.stamp
        frames = image[part.span]
        # Those of who has left belong to an episode that this sensor does not know.
        between = None if further is None else further.of(part.span, len(self._rows)).without(~part.live)
        if part.moved:
            # The last frame is the keyframe that they begin with.
            t, frames = t[-1:], frames[:, len(t) - 1 : len(t)]
            between = between and between.none()
        elif int(t[-1]) <= part.stamp:
            return
        rows = self._rows[part.span]
        part.numbers = np.where(part.live, rows[:, NUMBER], part.numbers).astype(np.int32)
        columns, offsets = _events(part.sensor, frames, t, part.numbers, between)
        part.stamp = int(t[-1])
        self.t_base = min(self.t_base, part.sensor.t_base + part.origin)
        for n, env in enumerate(range(part.span.start, part.span.stop)):
            mine = {name: values[offsets[n] : offsets[n + 1]] for name, values in columns.items()}
            if part.live[n]:
                found[env].append((mine, part.origin))
            elif part.leaving[n]:
                # Of who has left there is only what was held back.
                mine = {name: values[mine["t"] <= before] for name, values in mine.items()}
                found[env].insert(0, (mine, part.origin))
        part.leaving = np.zeros_like(part.live)

    def _flush(self, part: Part, found: list[list[tuple[Columns, int]]]) -> None:
        """What a sensor holds back, which begins anew or ends."""
        if not hasattr(part.sensor, "finish"):
            return
        columns, offsets = _read(part.sensor, part.sensor.finish())
        for n in np.flatnonzero(part.live | part.leaving).tolist():
            mine = {name: values[offsets[n] : offsets[n + 1]] for name, values in columns.items()}
            found[part.span.start + n].append((mine, part.origin))

    def _joined(self, found: Sequence[Sequence[tuple[Columns, int]]]) -> tuple[Columns, np.ndarray]:
        """The events of all environments in columns, at the stamps of all."""
        sizes = [sum(len(columns["t"]) for columns, _ in parts) for parts in found]
        offsets = np.cumsum([0, *sizes], dtype=np.int64)
        pieces = [columns | {"t": columns["t"] + origin} for parts in found for columns, origin in parts]
        if not pieces:
            pieces = [{"t": np.zeros(0, np.int64)} | {n: np.zeros(0, d) for n, d in _OTHERS.items()}]
        return {name: np.concatenate([p[name] for p in pieces]) for name in pieces[0]}, offsets


_OTHERS: dict[str, Any] = {"x": np.uint16, "y": np.uint16, "p": np.uint8}


def common(episodes: np.ndarray, stamp_ns: int) -> np.ndarray:
    """Gives the rows of msgs.own_time, int64 [E, 4], of environments that share the time of the stamps."""
    rows = np.zeros((len(episodes), 4), np.int64)
    rows[:, STAMP], rows[:, SEED], rows[:, NUMBER] = stamp_ns, CONFIGURED, episodes
    return rows


def _events(
    sensor: Any, frames: Any, t: np.ndarray, numbers: np.ndarray, further: Further | None
) -> tuple[Columns, np.ndarray]:
    """The events of frames and of samples between them, on the host."""
    if hasattr(sensor, "advance"):
        return _read(sensor, sensor.advance(frames, t, numbers, further=further if sensor.takes_further else None))
    events = sensor.process(np.ascontiguousarray(frames), t, numbers)
    return {name: getattr(events, name) for name in ("t", "x", "y", "p")}, events.env_offsets


def _read(sensor: Any, count: int) -> tuple[Columns, np.ndarray]:
    """The events of a sensor's last step, on the host."""
    out = {name: np.empty(count, dtype) for name, dtype in sensor.columns().items()}
    sensor.read(out)
    return out, sensor.env_offsets()


def _sum(counts: Sequence[dict[str, int]]) -> dict[str, int]:
    """Counts by name, added up."""
    names = dict.fromkeys(name for each in counts for name in each)
    return {name: sum(each.get(name, 0) for each in counts) for name in names}
