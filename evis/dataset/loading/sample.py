"""Makes the sample of a window: events or their image, labels, and their source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from evis.dataset.augmenting.augmentation import COUNTERPART
from evis.dataset.augmenting.changed_events import changed_events
from evis.dataset.augmenting.changed_labels import placed_labels, reversed_labels
from evis.dataset.errors import DatasetError
from evis.dataset.layouts.sample import EVENTS
from evis.dataset.loading.cut import Cut
from evis.dataset.loading.picking import at_end, at_start, with_interval
from msgs.camera import CameraInfo

Sample = dict[str, Any]
"""events: float32 or int32 [C, H, W], or t, x, y, p by name. Arrays of labels by the names of docs/layouts.md, and
`<kind>_ns`, their stamp. Arguments by their names. t0_ns, t1_ns, sequence, window."""


class Source(Protocol):
    """Defines a sequence that windows are taken of: files, or a simulation that runs."""

    index: int
    name: str
    arguments: dict[str, Any]

    @property
    def info(self) -> CameraInfo:
        """Returns the camera."""

    def events(self, t0_ns: int, t1_ns: int) -> Mapping[str, Any]:
        """Returns t, x, y, p of the events of [t0_ns, t1_ns)."""

    def rows(self, first: int, end: int) -> Mapping[str, Any]:
        """Returns t, x, y, p of the events with these numbers."""

    def event_labels(self, t0_ns: int, t1_ns: int) -> Mapping[str, Any]:
        """Returns the labels of the events of [t0_ns, t1_ns)."""

    def stamps(self, kind: str) -> np.ndarray:
        """Returns int64 [T, 2] ns, the beginning and the end of the interval that each label of a kind covers."""

    def label(self, kind: str, stamp_ns: int) -> Mapping[str, Any]:
        """Returns the arrays of the label of a kind with this stamp."""


@dataclass(frozen=True)
class Window:
    """Describes one window. number: in its sequence. rows: of its events, where it is by number; else None.

    stamps: kind -> stamp of its label [ns]. back: the same where time runs backwards, by the kind that is asked for.
    """

    number: int
    t0: int
    t1: int
    rows: tuple[int, int] | None
    stamps: Mapping[str, int]
    back: Mapping[str, int]


def label_stamps(source: Source, cut: Cut, t0: np.ndarray, t1: np.ndarray) -> tuple[dict[str, Any], dict[str, Any]]:
    """Returns which labels windows have: kind -> stamp int64 [n] ns, -1 where there is none; forwards and backwards."""
    ahead: dict[str, Any] = {}
    back: dict[str, Any] = {}
    counterparts = cut.augment.counterparts(cut.labels)
    for kind in cut.labels:
        if kind == "events":
            continue
        for found, other, pick in ((ahead, kind, at_end), (back, counterparts.get(kind), at_start)):
            if other is not None:
                try:
                    stamps = source.stamps(other)
                except DatasetError as error:
                    if other == kind:
                        raise
                    raise DatasetError(
                        f"{error}. Where `reverse` turns time round, {kind} is made of {other}"
                    ) from None
                stamps = stamps[with_interval(other, stamps)]
                which = pick(stamps, t0, t1)
                own = stamps[:, 1] if len(stamps) else np.zeros(1, np.int64)
                found[kind] = np.where(which >= 0, own[np.maximum(which, 0)], -1)
    return ahead, back


def sample_of(source: Source, cut: Cut, window: Window, epoch: int) -> Sample:
    """Makes the sample of a window. Raises DatasetError."""
    info, augment, t0, t1 = source.info, cut.augment, window.t0, window.t1
    size = info.height, info.width
    drawn = augment.drawn(cut.seed, epoch, source.index, window.number, *size)
    events = dict(source.events(t0, t1) if window.rows is None else source.rows(*window.rows))
    if "events" in cut.labels:
        events |= source.event_labels(t0, t1)
    if augment != type(augment)():
        events = changed_events(events, augment, drawn, t0, t1, *size)
    found: Sample = {"events": events}
    if cut.representation is not None:
        found["events"] = cut.representation(events, t0, t1, drawn.height, drawn.width)
    elif "events" in cut.labels:
        found |= {name: events.pop(name) for name in EVENTS}
    for kind in window.stamps:
        stamp = window.back[kind] if drawn.reverse else window.stamps[kind]
        other = augment.counterparts(cut.labels)[kind] if drawn.reverse else kind
        labels = dict(source.label(other, stamp))
        if drawn.reverse:
            labels, stamp = reversed_labels(labels, t0, t1), t0 + t1 - stamp
            stamp = int(labels["flow_t"][1]) if kind in COUNTERPART else stamp  # where an interval ends now
        found |= placed_labels(labels, drawn, *size) | {f"{kind}_ns": stamp}
    for name in cut.arguments:
        if name not in source.arguments:
            has = ", ".join(source.arguments) or "none"
            raise DatasetError(f"{source.name} has no argument '{name}' in its recipe; it has {has}")
        value = source.arguments[name]
        array = np.asarray(value)
        found[name] = array if array.dtype.kind in "biuf" else value  # PyTorch has no tensors of text
    return found | {"t0_ns": t0, "t1_ns": t1, "sequence": source.index, "window": window.number}


def contiguous(sample: Sample) -> Sample:
    """Returns a sample whose arrays are laid out in rows, as what copies them expects."""
    found: Sample = {}
    for name, value in sample.items():
        if isinstance(value, dict):
            found[name] = contiguous(value)
        elif isinstance(value, np.ndarray):
            found[name] = np.ascontiguousarray(value) if value.ndim else value
        else:
            found[name] = value if not hasattr(value, "contiguous") else value.contiguous()
    return found
