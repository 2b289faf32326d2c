"""Makes the data set of a recipe: gives sequences to workers, retries what fails, and keeps the index."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from evis.dataset.errors import DatasetError
from evis.dataset.layouts import writer_of
from evis.dataset.making.batches import batches
from evis.dataset.making.store import INDEX_FORMAT, Store, is_remote, store_of
from evis.dataset.making.tasks import Answer, Workers
from evis.dataset.recipe import Plan, Recipe
from evis.simulation.errors import SimulationError
from evis.simulation.graph import Planner
from evis.simulation.outputs import parse

RETRIES = 2
"""How often a sequence that failed is tried again."""
INDEX_EVERY_S = 5.0
"""Shortest time between two writings of dataset.json while sequences are made."""
TICK_S = 0.5


@dataclass
class MakingResult:
    """Describes what a run has done. there: sequences that are finished now. made: those of this run.

    failed: cause by index. retried: how often by index. stopped: why it ended early. notes: what the layout cannot
    hold of the sequences of this run.
    """

    there: int = 0
    made: int = 0
    events: int = 0
    seconds: float = 0.0
    failed: dict[int, str] = field(default_factory=dict)
    retried: dict[int, int] = field(default_factory=dict)
    stopped: str = ""
    notes: list[str] = field(default_factory=list)


def check(recipe: Recipe) -> None:
    """Plans each scene with all arguments at the ends of their ranges.

    Raises DatasetError with file:line, LayoutError where the layout's package is not installed.
    """
    writer_of(recipe.layout).check_installed()
    asked = parse([*recipe.outputs, *(f"labels.{kind}" for kind in recipe.labels)])
    for scene in recipe.scenes:
        for arguments in scene.corners():
            try:
                Planner(scene.target, asked, arguments).plan(0)
            except SimulationError as error:
                raise DatasetError(f"{scene.where}: {error}") from None


def open_store(recipe: Recipe, out: str, resume: bool) -> Store:
    """Returns where the data set goes. Raises DatasetError for a place that is not free for it."""
    store = store_of(out)
    index = store.index()
    if index is None and not store.is_empty():
        raise DatasetError(f"{out} is a file, or is not empty, and holds no data set; name a new folder")
    if index is not None and index.get("recipe_digest") != recipe.digest:
        other = index.get("recipe", {}).get("name", "another one")
        which = f"this one as it was before ({other})" if other == recipe.name else other
        if changed := recipe.changed(index):
            which = f"this one as it was before {changed} changed"
        raise DatasetError(f"{out} holds the data set of another recipe, {which}; name a new folder")
    if index is not None and not resume:
        raise DatasetError(f"{out} holds this data set already; --resume goes on with it")
    return store


def make(
    recipe: Recipe,
    out: str,
    workers: Callable[[str], Workers],
    count: int | None = None,
    resume: bool = False,
    tick: Callable[[MakingResult, int], None] = lambda made, wanted: None,
    say: Callable[[str], None] = lambda line: None,
    retries: int = RETRIES,
    batch: int = 1,
) -> MakingResult:
    """Makes the sequences that are not there yet; what is there stays, whatever happens.

    Args:
        out: folder of the data set, local or as fsspec names it.
        workers: makes the workers, for a place that all of them can reach.
        count: how many sequences, in place of what the recipe says.
        resume: go on with what is there; failed ones are tried again.
        tick: is told of progress, and how many sequences are wanted.
        say: is told in one line of each sequence that has failed, and of what the layout cannot hold.
        batch: how many sequences a worker makes at once, as environments of one simulation, where they can be.

    Raises DatasetError, LayoutError, OSError before anything is made.
    """
    check(recipe)
    store = open_store(recipe, out, resume)
    with store.alone():
        run = _Run(recipe, store, recipe.sequences(count), tick, say, retries, batch)
        if run.todo:
            hands = workers(out if is_remote(out) else str(store_path(out)))
            try:
                run.go(hands)
            finally:
                hands.close()
                run.save()
        return run.made


def store_path(out: str) -> str:
    """Returns a local place as every process of the machine knows it."""
    return os.path.abspath(out)


class _Run:
    """One run of `make`."""

    def __init__(
        self,
        recipe: Recipe,
        store: Store,
        plans: Sequence[Plan],
        tick: Callable[[MakingResult, int], None],
        say: Callable[[str], None],
        retries: int,
        batch: int,
    ) -> None:
        self._recipe, self._store, self._plans = recipe, store, plans
        self._tick, self._say, self._retries = tick, say, retries
        self._entries = {entry["index"]: entry for entry in store.entries()}
        self._tries: dict[int, int] = {}
        self._began = time.monotonic()
        self.todo = deque(batches([plan for plan in plans if plan.index not in self._entries], batch))
        self.made = MakingResult(there=len(self._entries))
        self.save()

    def go(self, workers: Workers) -> None:
        """Keeps all workers busy until everything is made, has failed, or nothing can be written any more."""
        idle = set(range(min(workers.count, len(self.todo))))
        busy: dict[int, dict[int, Plan]] = {}
        while (self.todo or busy) and not self.made.stopped:
            while idle and self.todo:
                worker = min(idle)
                idle.remove(worker)
                plans = self.todo.popleft()
                busy[worker] = {plan.index: plan for plan in plans}
                workers.assign(worker, plans)
            for answer in workers.wait(TICK_S):
                self._take(busy[answer.worker].pop(answer.index), answer)
                if not busy[answer.worker]:
                    del busy[answer.worker]
                    idle.add(answer.worker)
            self.made.seconds = time.monotonic() - self._began
            self._tick(self.made, len(self._plans))
            if time.monotonic() - self._saved > INDEX_EVERY_S:
                self.save()

    def _take(self, plan: Plan, answer: Answer) -> None:
        """Notes how one sequence has ended."""
        if answer.entry is not None:
            self._entries[plan.index] = answer.entry
            self.made.there += 1
            self.made.made += 1
            self.made.events += answer.entry["events"]
            for note in answer.entry.get("notes", []):
                if note not in self.made.notes:
                    self.made.notes.append(note)
                    self._say(f"note: {note}")
            return
        if answer.hopeless:
            self.made.stopped = answer.cause
            return
        tries = self._tries[plan.index] = self._tries.get(plan.index, 0) + 1
        if tries <= self._retries:
            self.made.retried[plan.index] = tries
            self.todo.append([plan])  # by itself: nobody else shall suffer from it, nor it from others
            return
        self.made.failed[plan.index] = answer.cause
        self._say(f"{plan.name} failed {tries} times: {answer.cause}")

    def save(self) -> None:
        """Writes dataset.json of what is there."""
        recipe = self._recipe
        self._store.write_index(
            {
                "format": INDEX_FORMAT,
                "recipe": {"name": recipe.name, **recipe.text},
                "recipe_digest": recipe.digest,
                **({"recipe_files": recipe.files} if recipe.files else {}),
                "layout": recipe.layout,
                "sequences": [self._entries[index] for index in sorted(self._entries)],
                "failed": [{"index": index, "cause": self.made.failed[index]} for index in sorted(self.made.failed)],
            }
        )
        self._saved = time.monotonic()
