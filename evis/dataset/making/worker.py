"""Makes sequences one after another, with simulations that stay warm; every worker makes the same bytes."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from evis.dataset.layouts import writer_of
from evis.dataset.making.finished import Entry, files_of
from evis.dataset.making.frame import write_frame
from evis.dataset.making.store import store_of
from evis.dataset.making.warm import Playing, Warm
from evis.dataset.recipe import Plan
from evis.simulation.errors import SimulationWarning


class Maker:
    """Makes sequences into one data set."""

    def __init__(self, out: str) -> None:
        """out: the data set's folder, local or as fsspec names it."""
        self._store = store_of(out)
        self._warm = Warm(besides=["keyframe"])  # for the picture of the contact sheet

    def make(self, plan: Plan) -> Entry:
        """Makes one sequence, which is there in full or not at all. Raises what the simulation or the disk raises."""
        with self._store.place(plan.path) as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", SimulationWarning)  # said to nobody; what counts is an error
            with self._warm.play(plan) as playing:
                events, notes = written(plan, playing, folder)
            entry = Entry(plan, playing.about.duration_ns, events, files_of(folder), notes)
            self._store.publish(folder, entry)
        return entry

    def close(self) -> None:
        """Ends all simulations."""
        self._warm.close()


def written(plan: Plan, playing: Playing, folder: Path) -> tuple[int, tuple[str, ...]]:
    """Writes the layout's files; returns the number of events, and what the layout cannot hold."""
    writer = writer_of(plan.layout)(folder, playing.about)
    events, picture = 0, None
    for k, step in enumerate(playing.steps()):
        if k == (playing.keyframes + 1) // 2:
            picture = step.keyframe
        events += events_in(step)
        writer.add(step)
    writer.close()
    if picture is not None:
        write_frame(folder, picture)
    return events, tuple(writer.notes)


def events_in(step: Any) -> int:
    """Counts the events of a step, of all cameras."""
    packets = [vars(outputs).get("events") for outputs in step.cameras.values()]
    return sum(len(packet.t) for packet in packets if packet is not None and packet.t is not None)
