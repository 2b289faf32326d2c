"""Makes sequences, one after another or several at once; every worker makes the same bytes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from evis.dataset.about import About
from evis.dataset.layouts import writer_of
from evis.dataset.making.finished import Entry, files_of
from evis.dataset.making.frame import write_frame
from evis.dataset.making.store import store_of
from evis.dataset.making.warm import Warm
from evis.dataset.recipe import Plan
from evis.simulation.errors import SimulationError, SimulationWarning
from evis.simulation.step import Step, on_host


class Maker:
    """Makes sequences into one data set."""

    def __init__(self, out: str) -> None:
        """out: the data set's folder, local or as fsspec names it."""
        self._store = store_of(out)
        self._warm = Warm(besides=["keyframe"])  # for the picture of the contact sheet

    def make(self, plan: Plan) -> Entry:
        """Makes one sequence, which is there in full or not at all. Raises what the simulation or the disk raises."""
        with self._store.place(plan.path) as folder, _silent():
            with self._warm.play(plan) as playing:
                written = Written(plan, playing.about, folder)
                for k, step in enumerate(playing.steps()):
                    written.add(step, picture=k == middle(playing.keyframes))
            return self._publish(written)

    def make_together(self, plans: Sequence[Plan]) -> list[Entry | Exception]:
        """Makes sequences as environments of one simulation; gives of each what it is, or why it is not there.

        What one of them raises for itself, and what it diverges by, leaves the others as they are. Raises what the
        simulation raises, also where sequences cannot be simulated side by side; none of them is there then.
        """
        with ExitStack() as places, _silent():
            folders = [places.enter_context(self._store.place(plan.path)) for plan in plans]
            failed: dict[int, Exception] = {}
            with self._warm.play_together(plans) as playing:
                all_written = [Written(*one) for one in zip(plans, playing.abouts, folders)]
                for k, step in enumerate(playing.steps()):
                    failed |= {env: SimulationError(why) for env, why in playing.fallen.items()}
                    bring_events(step)
                    for env in set(range(len(plans))) - set(failed):
                        with _noted(failed, env):
                            part = playing.alone(step, env)
                            all_written[env].add(part, picture=k == middle(playing.keyframes))
            entries: list[Entry | Exception] = []
            for env, written in enumerate(all_written):
                if env not in failed:
                    with _noted(failed, env):
                        entries.append(self._publish(written))
                if env in failed:
                    entries.append(failed[env])
            return entries

    def _publish(self, written: Written) -> Entry:
        """Makes what was written a finished sequence."""
        notes = written.close()
        duration_ns = written.about.duration_ns
        entry = Entry(written.plan, duration_ns, written.events, files_of(written.folder), notes)
        self._store.publish(written.folder, entry)
        return entry

    def close(self) -> None:
        """Ends all simulations."""
        self._warm.close()


class Written:
    """Writes one sequence into its folder. events: how many there were so far."""

    def __init__(self, plan: Plan, about: About, folder: Path) -> None:
        self.plan, self.about, self.folder = plan, about, folder
        self.events = 0
        self._writer = writer_of(plan.layout)(folder, about)
        self._picture: Any = None

    def add(self, step: Step, picture: bool) -> None:
        """Writes a step. picture: whether it is that of the contact sheet."""
        if picture:
            self._picture = step.keyframe
        self.events += events_in(step)
        self._writer.add(step)

    def close(self) -> tuple[str, ...]:
        """Writes the rest of the sequence; returns notes on what the layout cannot hold."""
        self._writer.close()
        if self._picture is not None:
            write_frame(self.folder, self._picture)
        return tuple(self._writer.notes)


def middle(keyframes: int) -> int:
    """Gives the number of the keyframe of which the contact sheet has a picture."""
    return (keyframes + 1) // 2


def bring_events(step: Step) -> None:
    """Brings a step's events from a GPU to numpy arrays, those of all environments at once."""
    first = next(iter(step.cameras.values()))
    for outputs in step.cameras.values():
        packet = vars(outputs).get("events")
        if packet is not None and packet.t is not None and not isinstance(packet.t, np.ndarray):
            outputs.events = on_host(packet)
    if "events" in vars(first):
        step.events = first.events


def events_in(step: Any) -> int:
    """Counts the events of a step, of all cameras."""
    packets = [vars(outputs).get("events") for outputs in step.cameras.values()]
    return sum(len(packet.t) for packet in packets if packet is not None and packet.t is not None)


@contextmanager
def _silent() -> Iterator[None]:
    """Says to nobody what simulations warn of; what counts is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SimulationWarning)
        yield


@contextmanager
def _noted(failed: dict[int, Exception], env: int) -> Iterator[None]:
    """Notes what one environment raises."""
    try:
        yield
    except Exception as error:
        failed[env] = error
