"""Defines the interface of the readers of all layouts."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evis.dataset.about import About
from evis.dataset.layouts import LayoutError
from evis.files.damage import is_fault
from msgs.camera import CameraInfo

ANEW = "fetch its files again, or make the sequence anew"
"""What helps where a file is damaged."""
BLOCK_NS = 20_000_000
"""Where a layout has no rows of events, they are counted by blocks so long, of which one is read for a row."""
UNBOUNDED_NS = 2**63 - 1
"""End of an interval that takes all events: the readout may delay some past the end of the sequence."""
MOST_BLOCKS = 100_000
"""Blocks that a sequence is read in at most: one that lasts for years, as a file may say, has longer ones."""
LABELS_NS = 500_000_000
"""Labels are gone over so much at a time, so that memory does not grow with length."""


class EventArrays(NamedTuple):
    """Holds events in order of time: t int64 [ns], x, y uint16, p uint8 (1 = ON); all of shape [n]."""

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray


class SequenceReader(ABC):
    """Reads a sequence that was written in some layout, and of its files only the parts that are asked for.

    Files are opened where they are read, so a reader may be pickled and used by several processes. Times are ns, as far
    as the layout holds them. What is damaged, missing or of another layout is a LayoutError of one line.
    """

    LAYOUT = ""

    def __init__(self, directory: Path) -> None:
        """Opens a sequence. Raises LayoutError for a folder that holds none."""
        self.directory = Path(directory)
        try:
            self.about = About.load(self.directory)
        except ValueError as error:
            raise LayoutError(str(error)) from None
        if self.about.layout not in ("", self.LAYOUT):
            text = f"has the layout {self.about.layout}, not {self.LAYOUT}: reader_of('{self.about.layout}') reads it"
            raise LayoutError(f"{self.directory} {text}")
        self._known: dict[str, tuple[str, ...]] = {}
        self._blocks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._times: dict[tuple[str, str], np.ndarray] = {}

    @property
    def cameras(self) -> Mapping[str, CameraInfo]:
        """Returns the cameras by name, the first one first."""
        return self.about.cameras

    @property
    def duration_ns(self) -> int:
        """Returns the length of the sequence [ns]."""
        return self.about.duration_ns

    @property
    def count(self) -> int:
        """Returns the number of events of all cameras."""
        return sum(self.count_of(camera) for camera in self.cameras)

    def events(self, t0_ns: int, t1_ns: int, camera: str | None = None) -> EventArrays:
        """Reads the events of [t0_ns, t1_ns) of one camera, of the first if none is named. Raises LayoutError."""
        name = self._named(camera)
        with self._told(f"the events of {name}"):
            return self._events(int(t0_ns), int(t1_ns), name)

    def labels(self, kind: str, t0_ns: int, t1_ns: int, camera: str | None = None) -> dict[str, np.ndarray]:
        """Reads the labels of one kind with stamps in [t0_ns, t1_ns).

        Returns the stamps `t` int64 [T] ns, and the arrays by the names that they have in msgs' Labels: images and
        poses [T, ...]; of boxes and contacts all rows, those of stamp k being [offsets[k], offsets[k + 1]); of `events`
        a row for each event of that time, `t` being the events' own. `image` has the frames [T, H, W, 1 or 3]. Raises
        LayoutError for a kind that the sequence does not have.
        """
        name = self._named(camera)
        self._there(kind, name)
        with self._told(f"{kind} of {name}"):
            return self._labels(kind, int(t0_ns), int(t1_ns), name)

    def kinds(self, camera: str) -> tuple[str, ...]:
        """Lists the kinds of labels that there are of a camera."""
        with self._told(f"the labels of {camera}"):
            return self._kinds(self._named(camera))

    def count_of(self, camera: str) -> int:
        """Returns the number of events of one camera."""
        with self._told(f"the events of {camera}"):
            return self._count_of(self._named(camera))

    def rows(self, first: int, end: int, camera: str | None = None) -> EventArrays:
        """Reads the events with the numbers [first, end) of one camera, of the first if none is named."""
        name = self._named(camera)
        with self._told(f"the events of {name}"):
            return self._rows(int(first), int(end), name)

    def stamps(self, kind: str, camera: str | None = None) -> np.ndarray:
        """Returns when the labels of a kind are: int64 [T, 2] ns, the two ends of the interval of a flow over one, and
        twice the stamp for all others. Raises LayoutError for a kind that the sequence does not have.
        """
        name = self._named(camera)
        self._there(kind, name)
        with self._told(f"{kind} of {name}"):
            return self._intervals(kind, name)

    def _there(self, kind: str, name: str) -> None:
        if name not in self._known:
            self._known[name] = self.kinds(name)
        if kind not in self._known[name]:
            has = ", ".join(self._known[name]) or "no labels"
            raise LayoutError(f"{self.directory} has no labels '{kind}' of {name}; it has {has}")

    def _named(self, camera: str | None) -> str:
        name = next(iter(self.cameras)) if camera is None else camera
        if name not in self.cameras:
            raise LayoutError(f"{self.directory} has no camera '{name}'; it has {', '.join(self.cameras)}")
        return name

    @contextmanager
    def _told(self, what: str) -> Iterator[None]:
        """Turns the faults of files into LayoutError, which names the sequence and what helps."""
        try:
            yield
        except LayoutError:
            raise
        except Exception as error:
            if isinstance(error, MemoryError) or not is_fault(error):
                raise
            text = " ".join(str(error).replace(f"{self.directory}/", "").split())[:200] or type(error).__name__
            raise LayoutError(f"{self.directory}: {what} cannot be read ({text}); {ANEW}") from error

    @abstractmethod
    def _kinds(self, camera: str) -> tuple[str, ...]: ...

    @abstractmethod
    def _count_of(self, camera: str) -> int: ...

    @abstractmethod
    def _events(self, t0: int, t1: int, camera: str) -> EventArrays: ...

    @abstractmethod
    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]: ...

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        """As `rows`; a layout that keeps events in rows overrides it."""
        if end <= first:
            return self._events(self.about.start_ns, self.about.start_ns, camera)
        edges, before = self._edges(camera)
        a = int(np.searchsorted(before, first, "right")) - 1
        b = max(int(np.searchsorted(before, end)), a + 1)
        found = self._events(int(edges[a]), int(edges[min(b, len(edges) - 1)]), camera)
        return EventArrays(*(column[first - before[a] : end - before[a]] for column in found))

    def _edges(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        """Borders of blocks of BLOCK_NS [ns], and the number of events before each; found in one pass, and kept."""
        if camera not in self._blocks:
            edges = np.array(edges_of(self.about, BLOCK_NS))
            counts = [len(self._events(int(t0), int(t1), camera).t) for t0, t1 in itertools.pairwise(edges)]
            self._blocks[camera] = edges, np.concatenate([[0], np.cumsum(counts)])
        return self._blocks[camera]

    def _intervals(self, kind: str, camera: str) -> np.ndarray:
        """As `stamps`; a layout that keeps them by themselves overrides it."""
        if (kind, camera) not in self._times:
            found = []
            for t0, t1 in itertools.pairwise(edges_of(self.about, LABELS_NS)):
                labels = self._labels(kind, t0, t1, camera)
                found.append(spans(labels["t"], labels.get("flow_t")))
            self._times[kind, camera] = np.concatenate(found)
        return self._times[kind, camera]


def edges_of(about: About, block_ns: int) -> list[int]:
    """Returns the borders [ns] of the blocks in which a sequence is read, the last of which has no end."""
    step = max(block_ns, -(-about.duration_ns // MOST_BLOCKS))
    return [*range(about.start_ns, about.start_ns + about.duration_ns + 1, step), UNBOUNDED_NS]


def spans(t: np.ndarray, flow_t: np.ndarray | None) -> np.ndarray:
    """Returns stamps as `SequenceReader.stamps` does: flow_t [T, 2] where there is one, else t [T] twice."""
    return np.stack((t, t), -1).astype(np.int64) if flow_t is None else np.asarray(flow_t, np.int64).reshape(-1, 2)


def framed(images: np.ndarray) -> np.ndarray:
    """Returns frames [T, H, W, 1 or 3]; a file of grey ones, [T, H, W], holds no axis of channels."""
    return images[..., None] if images.ndim == 3 else images


def within(t: np.ndarray, t0: int, t1: int) -> slice:
    """Returns which of ascending times lie in [t0, t1)."""
    first, end = np.searchsorted(t, [t0, t1])
    return slice(int(first), max(int(first), int(end)))
