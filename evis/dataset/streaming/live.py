"""Simulates a sequence as its windows are taken, and drops what no later window needs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from evis.dataset.errors import DatasetError
from evis.dataset.layouts.columns import EVENT_TYPES
from evis.dataset.layouts.sample import DENSE, EVENTS, TABLES, samples
from evis.dataset.layouts.sample import Sample as Piece
from evis.dataset.loading.cut import Cut
from evis.dataset.loading.sample import Window
from evis.dataset.loading.stored import labelled
from evis.dataset.making.warm import Playing
from evis.dataset.recipe import Plan
from evis.dataset.streaming.rows import Rows
from evis.events.arrays import Events
from evis.simulation.step import Step
from msgs.camera import INTERVAL_FLOWS
from nodes.event_sensor.parameters import LOOK_AHEAD

_US = 1000
"""Labels are chosen by whole us, so that a label that ends within the same us belongs to the window too."""


class Live:
    """Runs a sequence as far as its windows need it. left_out: windows without a label that is asked for."""

    def __init__(self, plan: Plan, playing: Playing, cut: Cut, taken: Callable[[Any], Any]) -> None:
        """taken: makes of an array of the simulation what windows are to have. Raises DatasetError."""
        cameras = playing.about.cameras
        self.camera = cut.camera or next(iter(cameras))
        if self.camera not in cameras:
            raise DatasetError(f"{plan.name} has no camera '{self.camera}'; it has {', '.join(cameras)}")
        self.index, self.name, self.arguments = plan.index, plan.name, plan.arguments
        self.info, self.left_out = cameras[self.camera], 0
        self._about, self._cut, self._taken = playing.about, cut, taken
        self._steps, self._over = playing.steps(), False
        self._looks_ahead = self.info.sensor.get("crossing") in LOOK_AHEAD
        self._until = self._packets_until = self._images_until = -1
        self._events, self._marks = Rows(), Rows()
        self._pieces: list[Piece] = []
        none = {name: np.empty(0, dtype) for name, dtype in EVENT_TYPES.items()}
        self._events.add(none, playing.about.start_ns, playing.about.start_ns)  # what a recipe without events has

    def windows(self) -> Iterator[Window]:
        """Yields the windows in order, each as soon as all of it is simulated; those before are forgotten."""
        bounds = self._by_time() if self._cut.seconds else self._by_number()
        for number, t0, t1, rows in bounds:
            table = labelled(
                self, self._cut, np.array([number]), np.array([t0]), np.array([t1]),
                None if rows is None else np.array([rows]),
            )  # fmt: skip
            self.left_out += table.without
            if len(table):
                yield table.window(0)

    def _by_time(self) -> Iterator[tuple[int, int, int, None]]:
        count = self._cut.count_by_time(self._about.duration_ns)
        for number in range(count):
            t0, t1 = (int(t[0]) for t in self._cut.by_time(np.array([number]), self._about.start_ns))
            self._forget(t0)
            self._advance(t1)
            yield number, t0, t1, None

    def _by_number(self) -> Iterator[tuple[int, int, int, tuple[int, int]]]:
        number = 0
        while True:
            first, end = self._cut.rows(number)
            while self._events.total < end and not self._over:
                self._step()
            if self._events.total < end:
                return
            t0, t1 = self._events.time(first), self._events.time(end - 1) + 1
            self._forget(t0)
            self._advance(t1)
            yield number, t0, t1, (first, end)
            number += 1

    # -- as Source has it --------------------------------------------------------------------------------------------

    def events(self, t0_ns: int, t1_ns: int) -> dict[str, Any]:
        """Implements `Source.events`."""
        return self._events.part(*(self._events.row_of(t) for t in (t0_ns, t1_ns)))

    def rows(self, first: int, end: int) -> dict[str, Any]:
        """Implements `Source.rows`."""
        return self._events.part(first, end)

    def event_labels(self, t0_ns: int, t1_ns: int) -> dict[str, Any]:
        """Implements `Source.event_labels`."""
        return self._marks.part(*(self._events.row_of(t) for t in (t0_ns, t1_ns)))

    def stamps(self, kind: str) -> np.ndarray:
        """Implements `Source.stamps`, of what is not forgotten."""
        found = []
        for piece in self._pieces:
            if kind == "image" and piece.image is not None:
                found.append([piece.image.header.stamp_ns] * 2)
            elif kind in INTERVAL_FLOWS and kind in piece.labels:
                found.append(np.asarray(piece.labels["flow_t"]).tolist())
            elif _first(kind) in piece.labels:
                found.append([piece.stamp_ns] * 2)
        return np.array(found, np.int64).reshape(-1, 2)

    def label(self, kind: str, stamp_ns: int) -> dict[str, Any]:
        """Implements `Source.label`."""
        for piece in self._pieces:
            if kind == "image":
                if piece.image is not None and piece.image.header.stamp_ns == stamp_ns:
                    return {"image": piece.image.data, "exposure_ns": np.int64(piece.image.exposure_ns)}
            elif _first(kind) in piece.labels and _end(piece, kind) == stamp_ns:
                return {name: piece.labels[name] for name in (*DENSE.get(kind, ()), *TABLES.get(kind, ()))}
        raise DatasetError(f"{self.name} has no label '{kind}' at {stamp_ns} ns")

    # -- the simulation ----------------------------------------------------------------------------------------------

    def _advance(self, t_ns: int) -> None:
        """Goes on until everything up to a time is there."""
        while not self._over and (
            self._until // _US <= t_ns // _US or self._packets_until < t_ns or self._behind(t_ns)
        ):
            self._step()

    def _behind(self, t_ns: int) -> bool:
        """Whether labels are still to come: of events that are there, or an image, which is there when its exposure
        is over and has its middle for a stamp."""
        if "image" in self._cut.labels and self._images_until // _US <= t_ns // _US:
            return True
        return "events" in self._cut.labels and self._marks.total < self._events.total

    def _step(self) -> None:
        step = next(self._steps, None)
        if step is None:
            self._over = True
            return
        self._until = max(self._until, step.stamp_ns)
        for camera, piece in samples(step, self._taken):
            if camera == self.camera:
                self._take(piece, step)

    def _take(self, piece: Piece, step: Step) -> None:
        packet = vars(step.cameras[self.camera]).get("events")
        if packet is not None and piece.has_packet:
            columns = {name: getattr(piece.events, name) for name in EVENT_TYPES}
            # A sensor that looks ahead holds events back, and how many is told by where its next packet begins.
            until = piece.t0_ns if self._looks_ahead else packet.header.stamp_ns
            self._packets_until = max(self._packets_until, until)
            self._events.add(columns, piece.t0_ns, packet.header.stamp_ns)
        if EVENTS[0] in piece.labels:
            self._marks.add({name: piece.labels[name] for name in EVENTS}, 0, 0)
        if piece.image is not None:
            self._images_until = piece.image.header.stamp_ns
        # Their arrays are held once, above.
        self._pieces.append(Piece(piece.stamp_ns, piece.t0_ns, Events.empty(), piece.labels, piece.image))

    def _forget(self, t_ns: int) -> None:
        """Forgets what was before a time."""
        first = self._events.drop_before(t_ns)
        self._marks.drop(first)
        self._pieces = [piece for piece in self._pieces if piece.stamp_ns >= t_ns - _US]


def _first(kind: str) -> str:
    return (*DENSE.get(kind, ()), *TABLES.get(kind, ()), kind)[0]


def _end(piece: Piece, kind: str) -> int:
    return int(piece.labels["flow_t"][1]) if kind in INTERVAL_FLOWS else piece.stamp_ns
