"""Makes sequences one after another, with simulations that stay warm; every worker makes the same bytes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from evis.dataset.about import About
from evis.dataset.layouts import writer_of
from evis.dataset.making.finished import Entry, files_of
from evis.dataset.making.frame import write_frame
from evis.dataset.making.store import store_of
from evis.dataset.recipe import Plan
from evis.runtime.clock import keyframe_count, keyframe_stamp
from evis.simulation.errors import SimulationWarning
from evis.simulation.simulation import Simulation
from msgs.camera import CameraInfo

MOST_WARM = 4
"""Most simulations that are kept, one for each scene and size."""
BESIDES = ("info", "keyframe")
"""Outputs that are needed whatever a recipe asks for: what the cameras are, and the picture of the contact sheet."""


class Maker:
    """Makes sequences into one data set. A second one of a scene finds kernels, meshes and textures in memory."""

    def __init__(self, out: str) -> None:
        """out: the data set's folder, local or as fsspec names it."""
        self._store = store_of(out)
        self._warm: dict[Any, tuple[Any, Simulation, dict[str, CameraInfo]]] = {}

    def make(self, plan: Plan) -> Entry:
        """Makes one sequence, which is there in full or not at all. Raises what the simulation or the disk raises."""
        with self._store.place(plan.path) as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", SimulationWarning)  # said to nobody; what counts is an error
            events, duration_ns, notes = self._simulate(plan, folder)
            entry = Entry(plan, duration_ns, events, files_of(folder), notes)
            self._store.publish(folder, entry)
        return entry

    def _simulate(self, plan: Plan, folder: Path) -> tuple[int, int, tuple[str, ...]]:
        """Writes the layout's files; returns the number of events, the length [ns], and what the layout cannot hold."""
        with self._simulation(plan) as (simulation, cameras):
            step = simulation.reset(seed=plan.seed)
            cameras |= {name: o.info for name, o in step.cameras.items() if o.info is not None}
            last = max(keyframe_count(round(plan.duration_s * 1e9), simulation.keyframe_rate) - 1, 1)
            about = About(
                name=plan.name,
                scene=plan.scene_name,
                arguments=dict(plan.arguments),
                seed=plan.seed,
                duration_ns=keyframe_stamp(last, simulation.keyframe_rate),
                keyframe_rate=simulation.keyframe_rate,
                cameras={name: _with_seed(info, plan.seed) for name, info in cameras.items()},
                labels=plan.labels,
            )
            writer = writer_of(plan.layout)(folder, about)
            events, picture = 0, None
            for k in range(last + 2):
                if k:
                    step = simulation.step() if k <= last else simulation.finish()
                if k == (last + 1) // 2:
                    picture = step.keyframe
                events += events_in(step)
                writer.add(step)
            writer.close()
            if picture is not None:
                write_frame(folder, picture)
        return events, about.duration_ns, tuple(writer.notes)

    @contextmanager
    def _simulation(self, plan: Plan) -> Iterator[tuple[Simulation, dict[str, CameraInfo]]]:
        """A simulation of these arguments, and its cameras; the last one where only the seed is another."""
        place = (plan.scene, plan.arguments.get("width"), plan.arguments.get("height"))
        wanted = (plan.given, plan.outputs, plan.labels)
        before = self._warm.pop(place, None)
        if before is None or before[0] != wanted:
            if before is not None:
                before[1].close()
            outputs = [*dict.fromkeys((*plan.outputs, *BESIDES)), *(f"labels.{kind}" for kind in plan.labels)]
            before = wanted, Simulation(plan.scene, outputs=outputs, seed=plan.seed, **plan.given), {}
        try:
            yield before[1], before[2]
        except BaseException:
            before[1].close()  # whatever state it is in, the next sequence shall not begin with it
            raise
        self._warm[place] = before
        while len(self._warm) > MOST_WARM:
            self._warm.pop(next(iter(self._warm)))[1].close()

    def close(self) -> None:
        """Ends all simulations."""
        for _, simulation, _ in self._warm.values():
            simulation.close()
        self._warm.clear()


def _with_seed(info: CameraInfo, seed: int) -> CameraInfo:
    """A camera's description, which is latched and comes once, with the seed of this run."""
    return replace(info, sensor={**info.sensor, "seed": seed}) if "seed" in info.sensor else info


def events_in(step: Any) -> int:
    """Counts the events of a step, of all cameras."""
    packets = [vars(outputs).get("events") for outputs in step.cameras.values()]
    return sum(len(packet.t) for packet in packets if packet is not None and packet.t is not None)
