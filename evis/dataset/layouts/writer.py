"""Implements what the writers of all layouts have in common."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from pathlib import Path

import numpy as np

from evis.dataset.about import About
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.sample import Sample, samples
from evis.simulation.step import Step
from msgs.camera import CameraInfo


class SequenceWriter(ABC):
    """Writes one sequence into an empty folder, step after step; what is in memory does not grow with its length.

    counts: events written, by camera. notes: one line for each thing that the layout cannot hold as it is.
    """

    LAYOUT = ""

    @classmethod
    def check_installed(cls) -> None:
        """Raises LayoutError where a package that this layout needs is not installed."""
        return  # most layouts need what EVIS itself does, and no more

    def __init__(self, directory: Path, about: About) -> None:
        """Begins a sequence. Raises LayoutError for a folder that is not empty, and for what the layout cannot hold."""
        self.directory, self.about = Path(directory), about
        try:
            about.check_names()
        except ValueError as error:
            raise LayoutError(f"{about.name} has a camera whose files would lie elsewhere: {error}") from None
        if missing := [name for name, info in about.cameras.items() if not isinstance(info, CameraInfo)]:
            raise LayoutError(f"{about.name} has no CameraInfo of {missing[0]}; it is the output info of a first step")
        self.counts = dict.fromkeys(about.cameras, 0)
        self.notes: list[str] = []
        self._closed = False
        self._bodies: tuple[str, ...] = ()
        self._last = dict.fromkeys(about.cameras, about.start_ns)
        self.directory.mkdir(parents=True, exist_ok=True)
        if any(self.directory.iterdir()):
            raise LayoutError(f"{self.directory} is not empty; a sequence goes into a folder of its own")

    def add(self, step: Step) -> None:
        """Writes a step. Raises LayoutError for what the layout cannot hold, OSError where the disk refuses."""
        for camera, sample in samples(step):
            self.add_sample(camera, sample)

    def add_sample(self, camera: str, sample: Sample) -> None:
        """Writes what a step has of one camera. Raises as `add`."""
        if camera not in self.about.cameras:
            raise LayoutError(f"{self.about.name} has no camera {camera}; it has {', '.join(self.about.cameras)}")
        t = sample.events.t
        if len(t) and (int(t[0]) < self._last[camera] or bool((np.diff(t) < 0).any())):
            raise LayoutError(f"the events of {camera} step back in time before {sample.stamp_ns} ns; sort them")
        self._last[camera] = int(t[-1]) if len(t) else self._last[camera]
        self._bodies = self._bodies or sample.bodies
        self._add(camera, sample)
        self.counts[camera] += len(t)

    def close(self) -> None:
        """Writes what is left. A second call does nothing."""
        if not self._closed:
            self._closed = True
            self._finish()
            about = dataclasses.replace(self.about, bodies=self._bodies, layout=self.LAYOUT, counts=self.counts)
            about.save(self.directory)

    def note(self, text: str) -> None:
        """Keeps one line about what the layout cannot hold, once."""
        if text not in self.notes:
            self.notes.append(text)

    @abstractmethod
    def _add(self, camera: str, sample: Sample) -> None:
        """Does what `add_sample` is to do, of what fits."""

    @abstractmethod
    def _finish(self) -> None:
        """Writes what is left."""
