"""Senses environments that were reset at different times: each group that was reset together has a sensor of its own.

An EventSensor takes all its environments at the same stamps, and its random numbers are keyed by its seed, the number
of the environment in it and the number of the reset. Environments that are reset by themselves therefore leave their
sensor and get another one, whose time begins at 0 with the reset. The stamp of the reset (the origin of their time) is
added to the times of its events.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from msgs.own_time import CONFIGURED, NUMBER, ORIGIN, SEED, STAMP, equal_runs, rows_of_shared_time

if TYPE_CHECKING:
    from nodes.event_sensor.input.further import Further

Columns = dict[str, np.ndarray]
Make = Callable[[slice, int | None, int], Any]
"""(environments, seed of the first one or None = the configured one, number of the reset) -> sensor."""
LEFT = -1
"""Number of the reset that a sensor is given for an environment that has left it."""


@dataclass
class ResetGroup:
    """Holds the sensor of n neighbouring environments that were reset together.

    span: the environments. sensor: an EventSensor, or an event model with its `process`. seed: of the first of them.
    live: bool [n], those that were not reset since. numbers: int32 [n], numbers of their resets that the sensor was
    given last. stamp: time of the last frame in their own time [ns]. origin: stamp of their reset [ns].
    """

    span: slice
    sensor: Any
    seed: int
    live: np.ndarray
    numbers: np.ndarray
    stamp: int
    origin: int
    leaving: np.ndarray
    """bool [n], those that were reset since its last frames: it may still hold back events of theirs."""
    made: tuple[int | None, int] = (None, 0)
    """Of what its sensor was made, as Make takes it after the environments."""
    moved: bool = True
    """Whether its environments were reset with the present message."""


OF_GROUPS = ("_rows", "_episodes", "_since", "_past", "t_base")
"""What groups go on from besides themselves."""


def copied(group: ResetGroup) -> ResetGroup:
    """Copies a group, but for its sensor."""
    arrays = {name: getattr(group, name).copy() for name in ("live", "numbers", "leaving")}
    return replace(group, **arrays)


class ResetGroups:
    """Senses E environments, some of which were reset by themselves, by a sensor for each group reset together."""

    def __init__(self, make: Make, seed: int, own_model: bool) -> None:
        """Takes what makes sensors. make: makes the sensor of a group. seed: the configured one, of environment 0.
        own_model: whether sensors have the methods of EventSensor; those of another model have `process` alone."""
        self._make, self._seed, self._own_model = make, seed, own_model
        self._groups: list[ResetGroup] = []
        self._rows: np.ndarray | None = None
        self._episodes: np.ndarray | None = None
        self._since: np.ndarray | None = None
        """int64 [E], numbers of the resets at which the times of the environments began."""
        self._past: dict[str, int] = {}
        """Counts of the sensors of groups that have ended."""
        self.t_base = 0

    def adopt(self, sensor: Any, episodes: np.ndarray, stamp_ns: int) -> None:
        """Takes over the sensor that all environments have shared so far; stamp_ns: of its last frames."""
        rows = rows_of_shared_time(episodes, stamp_ns)
        everyone = slice(0, len(rows))
        live, numbers = np.ones(len(rows), bool), rows[:, NUMBER].astype(np.int32)
        self._groups = [ResetGroup(everyone, sensor, self._seed, live, numbers, stamp_ns, 0, ~live)]
        self._rows, self._episodes, self._since = rows, episodes.copy(), np.zeros(len(rows), np.int64)

    def state(self) -> dict[str, Any]:
        """Gives the groups with the states of their sensors, and where the environments are in time."""
        groups = [replace(copied(group), sensor=group.sensor.state()) for group in self._groups]
        kept = {name: copy.deepcopy(getattr(self, name)) for name in OF_GROUPS}
        return {**kept, "groups": groups}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` gave, with sensors that are made anew."""
        for name in OF_GROUPS:
            setattr(self, name, copy.deepcopy(state[name]))
        self._groups = []
        for kept in state["groups"]:
            sensor = self._make(kept.span, *kept.made)
            sensor.restore(kept.sensor)
            self._groups.append(replace(copied(kept), sensor=sensor))

    def process(
        self,
        image: Any,
        t: np.ndarray,
        own_t: np.ndarray | None,
        own: np.ndarray | None,
        episodes: np.ndarray,
        further: Further | None = None,
    ) -> tuple[Columns, np.ndarray]:
        """Senses the frames of a message; gives its events, sorted by environment, and their offsets int64 [E + 1].

        Args:
            image: as of EventSensor.advance, [E, K, ...].
            t: int64 [K] ns, the stamps of the frames that all environments share.
            own_t: int64 [E, K] ns, in own time, None = t.
            own: the rows of msgs.own_time, None = all began together.
            episodes: int32 [E]; where it differs from the last message's an environment begins anew.
            further: samples between the frames, in own time.
        """
        rows = rows_of_shared_time(episodes, int(t[-1])) if own is None else np.array(own)
        own_t = np.broadcast_to(t, (len(rows), len(t))) if own_t is None else own_t
        found: list[list[tuple[Columns, int]]] = [[] for _ in rows]
        self._begin(self._anew(rows, episodes), rows, found)
        self._rows, self._episodes = rows, np.array(episodes)
        self.t_base = int(t[-1])
        for group in self._groups:
            self._sense(group, image, own_t, found, further)
        self._groups = [group for group in self._groups if group.live.any()]
        return self._joined(found)

    def finish(self) -> tuple[Columns, np.ndarray] | None:
        """Gives the events that the sensors still hold back at the end of the run; None without any."""
        assert self._rows is not None
        found: list[list[tuple[Columns, int]]] = [[] for _ in self._rows]
        for group in self._groups:
            self._flush(group, found)
        self.t_base = min(group.sensor.t_base + group.origin for group in self._groups)
        columns, offsets = self._joined(found)
        return (columns, offsets) if offsets[-1] else None

    def counts(self) -> dict[str, int]:
        """Gives how many samples and events all sensors have set aside so far, by name."""
        return _sum([self._past, *(group.sensor.counts() for group in self._groups)])

    def _anew(self, rows: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Gives the environments that begin an episode, bool [E], and notes whose time begins anew.

        That of one that has diverged goes on.
        """
        if self._rows is None or self._episodes is None or self._since is None:
            self._since = rows[:, NUMBER].copy()
            return np.ones(len(rows), bool)
        begun: np.ndarray = episodes != self._episodes
        other = (rows[:, [ORIGIN, SEED]] != self._rows[:, [ORIGIN, SEED]]).any(axis=1)
        anew = begun & (other | (rows[:, STAMP] <= self._rows[:, STAMP]))
        self._since = np.where(anew, rows[:, NUMBER], self._since)
        return begun

    def _begin(self, anew: np.ndarray, rows: np.ndarray, found: list[list[tuple[Columns, int]]]) -> None:
        """Moves environments that were reset from the sensors that they were in to sensors of their own."""
        for group in self._groups:
            group.moved = False
            mine = anew[group.span] & group.live
            group.numbers[mine] = LEFT
            group.live, group.leaving = group.live & ~mine, group.leaving | mine
            if not group.live.any():
                self._flush(group, found)
        assert self._since is not None
        for run in equal_runs(rows):
            where = np.flatnonzero(anew[run]) + run.start
            apart = (np.diff(where) > 1) | (np.diff(self._since[where]) != 0)
            for envs in np.split(where, np.flatnonzero(apart) + 1):
                if len(envs):
                    first = int(envs[0])
                    self._place(slice(first, int(envs[-1]) + 1), rows[first], int(self._since[first]))
        for group in [group for group in self._groups if not group.live.any()]:
            self._past = _sum([self._past, group.sensor.counts()])
            self._groups.remove(group)

    def _place(self, span: slice, row: np.ndarray, since: int) -> None:
        """Gives a group that was reset together a sensor: the one that it had, where that can begin again.

        since: number of the reset at which its time began.
        """
        count, number = span.stop - span.start, int(row[NUMBER])
        given = None if row[SEED] == CONFIGURED else int(row[SEED])
        seed = self._seed + span.start if given is None else given
        numbers = np.full(count, number, np.int32)
        group = next((p for p in self._groups if p.span == span and p.seed == seed and not p.live.any()), None)
        if group is None or not number or not getattr(group.sensor, "begins_again", False):
            nobody = np.zeros(count, bool)
            sensor = self._make(span, given, since)
            group = ResetGroup(span, sensor, seed, nobody, numbers, 0, 0, nobody, (given, since))
            self._groups.append(group)
        group.live, group.leaving = np.ones(count, bool), np.zeros(count, bool)
        group.numbers, group.moved, group.origin = numbers, True, int(row[ORIGIN])

    def _sense(
        self, group: ResetGroup, image: Any, own_t: np.ndarray, found: list[list[tuple[Columns, int]]],
        further: Further | None,
    ) -> None:  # fmt: skip
        """Adds the events of a group to `found`, unless it has no frames in the message."""
        assert self._rows is not None
        inner = int(np.argmax(group.live))
        t, before = own_t[group.span.start + inner], group.stamp
        frames = image[group.span]
        # Samples of environments that have left belong to an episode that this sensor does not have.
        between = None if further is None else further.of(group.span, len(self._rows)).without(~group.live)
        if group.moved:
            # The last frame is the keyframe that they begin with.
            t, frames = t[-1:], frames[:, len(t) - 1 : len(t)]
            between = between and between.none()
        elif int(t[-1]) <= group.stamp:
            return
        rows = self._rows[group.span]
        group.numbers = np.where(group.live, rows[:, NUMBER], group.numbers).astype(np.int32)
        columns, offsets = self._events(group.sensor, frames, t, group.numbers, between)
        group.stamp = int(t[-1])
        self.t_base = min(self.t_base, group.sensor.t_base + group.origin)
        for n, env in enumerate(range(group.span.start, group.span.stop)):
            mine = {name: values[offsets[n] : offsets[n + 1]] for name, values in columns.items()}
            if group.live[n]:
                found[env].append((mine, group.origin))
            elif group.leaving[n]:
                # Of environments that have left only events that were held back are kept.
                mine = {name: values[mine["t"] <= before] for name, values in mine.items()}
                found[env].insert(0, (mine, group.origin))
        group.leaving = np.zeros_like(group.live)

    def _flush(self, group: ResetGroup, found: list[list[tuple[Columns, int]]]) -> None:
        """Adds the events that a sensor holds back to `found`, before it begins again or ends.

        What has still to leave the readout of an environment that was reset is cut, and counted, as a sensor does that
        goes on: its stamp would lie in the next episode.
        """
        if not self._own_model:
            return
        columns, offsets = _read(group.sensor, group.sensor.finish())
        for n in np.flatnonzero(group.live | group.leaving).tolist():
            mine = {name: values[offsets[n] : offsets[n + 1]] for name, values in columns.items()}
            if group.leaving[n] and (late := mine["t"] > group.stamp).any():
                self._past = _sum([self._past, {"readout_cut": int(late.sum())}])
                mine = {name: values[~late] for name, values in mine.items()}
            found[group.span.start + n].append((mine, group.origin))

    def _events(
        self, sensor: Any, frames: Any, t: np.ndarray, numbers: np.ndarray, further: Further | None
    ) -> tuple[Columns, np.ndarray]:
        """Gives the events of frames and of samples between them, in numpy arrays."""
        if self._own_model:
            return _read(sensor, sensor.advance(frames, t, numbers, further=further if sensor.takes_further else None))
        events = sensor.process(np.ascontiguousarray(frames), t, numbers)
        return {name: getattr(events, name) for name in ("t", "x", "y", "p")}, events.env_offsets

    def _joined(self, found: Sequence[Sequence[tuple[Columns, int]]]) -> tuple[Columns, np.ndarray]:
        """Joins the events of all environments to columns, their times moved to the stamps that all share."""
        sizes = [sum(len(columns["t"]) for columns, _ in parts) for parts in found]
        offsets = np.cumsum([0, *sizes], dtype=np.int64)
        pieces = [columns | {"t": columns["t"] + origin} for parts in found for columns, origin in parts]
        if not pieces:
            pieces = [{"t": np.zeros(0, np.int64)} | {n: np.zeros(0, d) for n, d in _OTHERS.items()}]
        return {name: np.concatenate([p[name] for p in pieces]) for name in pieces[0]}, offsets


_OTHERS: dict[str, Any] = {"x": np.uint16, "y": np.uint16, "p": np.uint8}


def _read(sensor: Any, count: int) -> tuple[Columns, np.ndarray]:
    """Gives the events of a sensor's last step, in numpy arrays."""
    out = {name: np.empty(count, dtype) for name, dtype in sensor.columns().items()}
    sensor.read(out)
    return out, sensor.env_offsets()


def _sum(counts: Sequence[dict[str, int]]) -> dict[str, int]:
    """Adds up counts by name."""
    names = dict.fromkeys(name for each in counts for name in each)
    return {name: sum(each.get(name, 0) for each in counts) for name in names}
