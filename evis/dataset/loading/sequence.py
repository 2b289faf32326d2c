"""Reads one sequence of a data set: what is known of it, its events, its labels."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.about import About
from evis.dataset.errors import DatasetError
from evis.dataset.layouts import reader_of
from evis.dataset.layouts.reader import UNBOUNDED_NS, EventArrays, SequenceReader
from evis.dataset.loading.copies import local_folder
from evis.files.damage import error_text
from evis.recordings.whole_ns import whole_ns
from msgs.camera import CameraInfo

_UNREADABLE = (OSError, KeyError, IndexError, ValueError, EOFError, zipfile.BadZipFile)
"""What readers of other people raise for files that are cut or missing."""


class Sequence:
    """Reads one sequence, and of its files only the parts that are asked for.

    Files are opened where they are read, so that it may be pickled, and used by several processes.

    index: its number in the data set. name, split, scene, seed, arguments: as dataset.json has them.
    """

    def __init__(self, out: str, path: str, layout: str, entry: Mapping[str, Any]) -> None:
        """out, path: of the data set and of the sequence in it. entry: of dataset.json."""
        self._out, self._path, self._layout = out, path, layout
        self.index: int = entry["index"]
        self.name: str = entry["name"]
        self.split: str = entry["split"]
        self.scene: str = entry["scene"]
        self.seed: int = entry["seed"]
        self.arguments: dict[str, Any] = dict(entry["arguments"])

    def __repr__(self) -> str:
        return f"Sequence({self.name}, {self.duration_ns * 1e-9:g} s, {', '.join(self.cameras)})"

    @property
    def folder(self) -> Path:
        """Returns the folder on this machine; one that lies elsewhere is copied first. Raises DatasetError, OSError."""
        return local_folder(self._out, self._path)

    @cached_property
    def reader(self) -> SequenceReader:
        """Reads its layout. Raises DatasetError."""
        with self.readable():
            reader: SequenceReader = reader_of(self._layout)(self.folder)
            return reader

    @property
    def about(self) -> About:
        """Returns the description of the sequence that its folder holds."""
        return self.reader.about

    @property
    def cameras(self) -> Mapping[str, CameraInfo]:
        """Returns the cameras by name, the first one first."""
        return self.about.cameras

    @property
    def start_ns(self) -> int:
        """Tells when it begins; 0 unless a bag began later."""
        return self.about.start_ns

    @property
    def duration_ns(self) -> int:
        """Returns the duration of the sequence [ns]."""
        return self.about.duration_ns

    def kinds(self, camera: str | None = None) -> tuple[str, ...]:
        """Lists the kinds of labels of a camera, of the first if none is named."""
        with self.readable():
            return self.reader.kinds(self.camera(camera))

    def count(self, camera: str | None = None) -> int:
        """Returns the number of events of a camera, of the first if none is named."""
        with self.readable():
            return self.reader.count_of(self.camera(camera))

    def camera(self, name: str | None) -> str:
        """Returns a camera's name, that of the first if none is named. Raises DatasetError."""
        if name is not None and name not in self.cameras:
            raise DatasetError(f"{self.folder} has no camera '{name}'; it has {', '.join(self.cameras)}")
        return name or next(iter(self.cameras))

    def events(self, t0_ns: int | None = None, t1_ns: int | None = None, camera: str | None = None) -> EventArrays:
        """Reads events: t int64 [n] ns, x, y uint16, p uint8 (1 = ON), in order of time.

        Args:
            t0_ns, t1_ns: those of [t0_ns, t1_ns); not given, from the start and to the last one, which a readout may
                have delayed past the end.
            camera: not given, the first one.

        Raises DatasetError; TypeError for times that are not whole.
        """
        start, end = self._limits(t0_ns, t1_ns)
        with self.readable():
            return self.reader.events(start, end, self.camera(camera))

    def labels(
        self, kind: str, t0_ns: int | None = None, t1_ns: int | None = None, camera: str | None = None
    ) -> dict[str, np.ndarray]:
        """Reads the labels of one kind with stamps in [t0_ns, t1_ns), as the layout's reader gives them.

        The stamps are `t` int64 [T] ns; arrays have the names of docs/layouts.md. Raises DatasetError;
        TypeError for times that are not whole.
        """
        start, end = self._limits(t0_ns, t1_ns)
        with self.readable():
            return self.reader.labels(kind, start, end, self.camera(camera))

    def _limits(self, t0_ns: int | None, t1_ns: int | None) -> tuple[int, int]:
        start, end = whole_ns(t0_ns), whole_ns(t1_ns)
        return self.start_ns if start is None else start, UNBOUNDED_NS if end is None else end

    @contextlib.contextmanager
    def readable(self) -> Iterator[None]:
        """Names the sequence, and what to do, in any error of reading it. Raises DatasetError."""
        try:
            yield
        except DatasetError:
            raise
        except _UNREADABLE as error:
            text = error_text(error)
            remedy = "`evis dataset verify` tells which files are damaged, make those sequences anew"
            if "plugin" in text:  # as HDF5 calls a compression that it does not know
                remedy = "its compression needs hdf5plugin: pip install 'evis[files]'"
            raise DatasetError(
                f"{self._out}/{self._path} cannot be read as {self._layout} ({text}); {remedy}"
            ) from None
