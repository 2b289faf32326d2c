"""Runs workers as Ray actors, on one machine or many: one per core or GPU, each with warm simulations of its own."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import ray
from ray.exceptions import RayError, TaskUnschedulableError, WorkerCrashedError

from evis.dataset.errors import DatasetError
from evis.dataset.making.tasks import Answer, Answerer
from evis.dataset.recipe import Plan


class Actors:
    """Runs workers as actors; one that dies, alone or with its node, is made anew wherever there is room."""

    def __init__(self, count: int | None, out: str, address: str, per_gpu: int) -> None:
        """count: None = as many as the cluster has cores, or `per_gpu` for each GPU, where that is above 0. out: a
        place that every node reaches."""
        self._own = not ray.is_initialized()
        if self._own:
            try:
                ray.init(address=address, log_to_driver=False, logging_level="ERROR")
            except (ConnectionError, ValueError, RuntimeError) as error:
                raise DatasetError(f"no Ray cluster at {address}: {' '.join(str(error).split())}") from None
        what = "GPU" if per_gpu else "CPU"
        there = int(ray.cluster_resources().get(what, 0))
        if not there:
            raise DatasetError(f"the cluster at {address} has no {what}; start nodes that have some")
        self.count = count or there * max(1, per_gpu)
        # Ray gives each actor a part of one GPU, which is the only one that it sees.
        part = {"num_cpus": 0, "num_gpus": 1 / -(-self.count // there)} if per_gpu else {"num_cpus": 1}
        self._actor = ray.remote(**part)(Answerer)
        self._out = out
        self._all: dict[int, Any] = {}
        self._pending: dict[Any, tuple[int, list[int]]] = {}

    def assign(self, worker: int, plans: Sequence[Plan]) -> None:
        """Gives a worker its next plans; makes it where there is none."""
        if worker not in self._all:
            self._all[worker] = self._actor.remote(self._out)
        asked = self._all[worker].answers.remote([plan.as_dict() for plan in plans])
        self._pending[asked] = worker, [plan.index for plan in plans]

    def wait(self, timeout_s: float) -> Sequence[Answer]:
        """Waits for answers."""
        answers: list[Answer] = []
        done, _ = ray.wait(list(self._pending), timeout=timeout_s)
        for reference in done:
            worker, indices = self._pending.pop(reference)
            try:
                answers += [Answer(worker, **told) for told in ray.get(reference)]
            except RayError as error:
                with contextlib.suppress(Exception):
                    ray.kill(self._all[worker])
                del self._all[worker]
                answers += [Answer(worker, index, cause=_cause(error), died=True) for index in indices]
        return answers

    def close(self) -> None:
        """Ends all actors, and leaves the cluster where this has joined it."""
        for actor in self._all.values():
            ray.kill(actor)
        if self._own:
            ray.shutdown()


def _cause(error: RayError) -> str:
    """Why an actor gave no answer, in one line."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    if isinstance(error, (WorkerCrashedError, TaskUnschedulableError)):
        return lines[0]
    return f"the worker has died: {lines[0] if lines else type(error).__name__}"
