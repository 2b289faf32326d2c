"""Reads a sequence that is a bag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.bag.reader import BagReader
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.joined import joined, no_rows, of_events
from evis.dataset.layouts.mcap.writer import COUNTS, FILE
from evis.dataset.layouts.reader import ANEW, EventArrays, SequenceReader, within
from evis.dataset.layouts.sample import DENSE, ENVIRONMENT_AXIS, EVENTS, TABLES
from msgs.camera import EventPacket, Image, Labels
from msgs.fields import array_specs


class McapReader(SequenceReader):
    """Reads the chunks of the bag that hold what is asked for."""

    LAYOUT = "mcap"

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        with self._bag() as bag:
            self._counts = dict(bag.metadata.get(COUNTS, {}))

    def _bag(self) -> BagReader:
        try:
            bag = BagReader(self.directory / FILE)
        except BagError as error:
            raise LayoutError(f"{error}; {ANEW}") from None
        if bag.problem:
            bag.close()
            raise LayoutError(f"{self.directory / FILE} is torn ({bag.problem}); {ANEW}")
        return bag

    def _count_of(self, camera: str) -> int:
        if camera not in self._counts:
            raise LayoutError(f"{self.directory / FILE} does not tell the events of {camera}; {ANEW}")
        return int(self._counts[camera])

    def _kinds(self, camera: str) -> tuple[str, ...]:
        found: dict[str, None] = {}
        with self._bag() as bag:
            if f"/{camera}/labels" in bag.topics:
                for number, (_, message) in enumerate(bag.messages([f"/{camera}/labels"])):
                    found |= dict.fromkeys(kind for kind, n in _firsts() if getattr(message, n) is not None)
                    if number:  # the first may be of keyframe 0, which has no interval behind it
                        break
            if f"/{camera}/image" in bag.topics:
                found["image"] = None
        return tuple(found)

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        packets = [p for p, _ in self._packets(t0, t1, camera, False)]
        columns = [np.concatenate([_empty(name), *(getattr(p, name) for p in packets)]) for name in "txyp"]
        part = within(columns[0], t0, t1)
        return EventArrays(*(column[part] for column in columns))

    def _packets(self, t0: int, t1: int, camera: str, labelled: bool) -> Iterator[tuple[EventPacket, Labels | None]]:
        """The packets that may have events of [t0, t1), each with its labels if they are asked for."""
        topics = [f"/{camera}/events", *([f"/{camera}/labels"] if labelled else [])]
        waiting: list[EventPacket] = []
        over = False
        with self._bag() as bag:
            for _, message in bag.messages(topics, t0):
                if isinstance(message, Labels) and message.event_instance is not None:
                    yield waiting.pop(0), message
                elif isinstance(message, EventPacket):
                    assert message.t is not None
                    over = over or message.t0_ns > t1 or bool(len(message.t) and message.t[0] >= t1)
                    if labelled:
                        waiting.append(message)
                    elif not over:
                        yield message, None
                if over and not waiting:  # at the end of a run two packets come before the labels of the first
                    return

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        info = self.cameras[camera]
        if kind == "events":
            found = list(self._packets(t0, t1, camera, True))
            t = np.concatenate([_empty("t"), *(p.t for p, _ in found if p.t is not None)])
            rows = {n: np.concatenate([no_rows(n, info), *(getattr(labels, n) for _, labels in found)]) for n in EVENTS}
            return of_events(t, rows, within(t, t0, t1))
        with self._bag() as bag:
            topic = f"/{camera}/image" if kind == "image" else f"/{camera}/labels"
            messages = [message for _, message in bag.messages([topic], t0, t1 - 1)]
        if kind == "image":
            images = [message for message in messages if isinstance(message, Image)]
            stacked = np.stack([np.asarray(image.data) for image in images]) if images else _none()
            exposed = np.array([image.exposure_ns for image in images], np.int64)
            stamps = np.array([image.header.stamp_ns for image in images], np.int64)
            return {"t": stamps, "image": stacked, "exposure_ns": exposed}
        names = (*DENSE.get(kind, ()), *TABLES.get(kind, ()))
        pieces = [
            (message.header.stamp_ns, {n: _single(n, getattr(message, n)) for n in names})
            for message in messages
            if getattr(message, names[0]) is not None
        ]
        return joined(kind, pieces, info)


def _firsts() -> list[tuple[str, str]]:
    """Every kind, and the array by which it is known."""
    return [(kind, names[0]) for kind, names in (*DENSE.items(), *TABLES.items(), ("events", EVENTS))]


def _single(name: str, array: Any) -> np.ndarray:
    return np.asarray(array[0] if name in ENVIRONMENT_AXIS else array)


def _empty(name: str) -> np.ndarray:
    return np.empty(0, array_specs(EventPacket)[name].dtypes[0])


def _none() -> np.ndarray:
    return np.empty((0, 0, 0, 1), np.uint8)
