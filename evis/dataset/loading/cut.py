"""Describes how sequences are cut into windows, and what a window holds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.dataset.augmenting.augmentation import Augment
from evis.dataset.errors import DatasetError
from evis.dataset.loading.representing import Representing

LEAST_S = 1e-6
"""Shortest window and stride by time: of shorter ones there would be more than fit in memory."""


@dataclass(frozen=True)
class Cut:
    """Describes how sequences are cut into windows. Made by `of`, which checks it.

    seconds, events: length of a window; one of them is 0. stride: from one window to the next, in the same unit.
    """

    seconds: float
    events: int
    stride: float
    representation: Representing | None
    labels: tuple[str, ...]
    arguments: tuple[str, ...]
    augment: Augment
    camera: str | None
    seed: int

    @staticmethod
    def of(
        *,
        seconds: float | None = None,
        events: int | None = None,
        stride: float | None = None,
        representation: str | None = None,
        labels: Iterable[str] = (),
        arguments: Iterable[str] = (),
        augment: Augment | None = None,
        camera: str | None = None,
        seed: int = 0,
        **options: Any,
    ) -> Cut:
        """Checks what is asked for.

        Args:
            seconds, events: length of a window, by time [s] or by number; one of them.
            stride: from the start of a window to that of the next, in the same unit; not given, its length.
            representation: voxel_grid, time_surface, count_image or event_stack of evis.events.representations, whose
                options follow (`bins=5`); not given, windows have the events themselves.
            labels: kinds of labels to give with a window: the last with a stamp in (t0, t1].
            arguments: arguments of the sequence to give with a window, as `omega`.
            augment: changes of events and labels, drawn for each window.
            camera: not given, the first one.
            seed: of the order and of the augmentation.

        Raises DatasetError.
        """
        if (seconds is None) == (events is None):
            raise DatasetError("windows are by time or by number: give seconds=0.05 or events=20000, one of them")
        length = seconds if seconds is not None else events
        unit = "s" if seconds is not None else "events"
        for name, value in (("window", length), ("stride", length if stride is None else stride)):
            if not _is_length(value, whole=events is not None):
                raise DatasetError(f"the {name} is {value!r} {unit}; it must be more than 0{_what(unit)}")
            if events is None and value < LEAST_S:  # type: ignore[operator]
                raise DatasetError(f"the {name} is {value!r} s; it must be {LEAST_S:g} s or more")
        if any(isinstance(names, str) or not isinstance(names, Iterable) for names in (labels, arguments)):
            raise DatasetError("labels and arguments are lists: labels=['forward_flow']")
        kinds, change = tuple(labels), Augment() if augment is None else augment
        if not isinstance(change, Augment):
            raise DatasetError(f"augment is {augment!r}; it is an Augment: augment=evis.dataset.Augment(flip_x=0.5)")
        check_whole("seed", seed)
        change.check(kinds)
        if "events" in kinds and (representation is not None or events is not None):
            raise DatasetError(
                "labels 'events' are a row for each event: take windows by seconds=, without a representation"
            )
        chosen = None if representation is None else Representing(representation, options)
        if chosen is not None:
            chosen.check()
        elif options:
            raise DatasetError(f"windows have no argument '{next(iter(options))}', or it needs a representation=")
        return Cut(
            float(seconds or 0), int(events or 0), float(length if stride is None else stride),  # type: ignore[arg-type]
            chosen, kinds, tuple(arguments), change, camera, int(seed),
        )  # fmt: skip

    def count_by_time(self, duration_ns: int) -> int:
        """Returns how many windows by time a sequence has; the last ends with it or before."""
        guess = math.floor((duration_ns * 1e-9 - self.seconds) / self.stride) + 2
        numbers = np.arange(max(guess, 0))
        return int(np.count_nonzero(self.by_time(numbers, 0)[1] <= duration_ns))

    def by_time(self, numbers: np.ndarray, start_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns when windows begin and end, int64 ns each, rounded as the stamps of keyframes are."""
        begin = numbers * self.stride
        t0, t1 = (start_ns + np.rint(moment * 1e9).astype(np.int64) for moment in (begin, begin + self.seconds))
        return t0, t1

    def rows(self, number: int) -> tuple[int, int]:
        """Returns the first event of a window by number, and the first after it."""
        first = number * int(self.stride)
        return first, first + self.events

    @property
    def length(self) -> str:
        """Returns the length of a window, for people."""
        return f"{self.seconds:g} s" if self.seconds else f"{self.events} events"


def check_whole(name: str, value: Any, least: int | None = None) -> None:
    """Raises DatasetError for what is no whole number, or one below `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or (least is not None and value < least):
        bound = "" if least is None else f", {least} or more"
        raise DatasetError(f"{name} is {value!r}; it must be a whole number{bound}")


def _is_length(value: Any, whole: bool) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number):
        return False
    return bool(math.isfinite(value) and value > 0 and (not whole or float(value).is_integer()))


def _what(unit: str) -> str:
    return ", and whole" if unit == "events" else ""
