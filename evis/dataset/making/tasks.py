"""Defines what passes between who gives work and a worker: plans one way, answers the other, as plain values."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from evis.dataset.errors import refused_by_place
from evis.dataset.making.finished import Entry
from evis.dataset.making.worker import Maker
from evis.dataset.recipe import Plan
from evis.files.damage import error_text


@dataclass(frozen=True)
class Answer:
    """Says how one plan ended. entry: of the finished sequence, as dataset.json has it, or None.

    cause: why there is none. hopeless: no other sequence can be written either. died: the worker is gone.
    """

    worker: int
    index: int
    entry: dict[str, Any] | None = None
    cause: str = ""
    hopeless: bool = False
    died: bool = False


class Workers(Protocol):
    """Defines the processes or actors that make sequences."""

    count: int

    def assign(self, worker: int, plans: Sequence[Plan]) -> None:
        """Gives a worker plans that it may make at once, and first makes it anew where it has died."""

    def wait(self, timeout_s: float) -> Sequence[Answer]:
        """Waits for answers, at least one unless the time is over; those of plans that were given together come
        together."""

    def close(self) -> None:
        """Ends all workers."""


class Answerer:
    """Makes the sequences that plans ask for, and turns errors into answers."""

    def __init__(self, out: str) -> None:
        self._maker = Maker(out)
        self._apart: set[str] = set()
        """Scenes of which sequences could not be made together."""

    def answers(self, plans: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Makes sequences, at once where that can be; returns the fields of an Answer but for its worker, of each."""
        wanted = [Plan.from_dict(plan) for plan in plans]
        if len(wanted) > 1 and wanted[0].scene not in self._apart:
            try:
                made = self._maker.make_together(wanted)
                return [_told(plan, one) for plan, one in zip(wanted, made)]
            except Exception as error:
                if refused_by_place(error):
                    return [_told(plan, error) for plan in wanted]
                self._apart.add(wanted[0].scene)  # by themselves they may well do
        return [self._answer(plan) for plan in wanted]

    def _answer(self, plan: Plan) -> dict[str, Any]:
        try:
            return _told(plan, self._maker.make(plan))
        except Exception as error:
            return _told(plan, error)


def _told(plan: Plan, made: Entry | Exception) -> dict[str, Any]:
    """The fields of an Answer."""
    if isinstance(made, Entry):
        return {"index": plan.index, "entry": made.as_dict()}
    if isinstance(made, MemoryError):
        return {"index": plan.index, "cause": "the worker ran out of memory"}
    if number := refused_by_place(made):
        return {"index": plan.index, "cause": f"{plan.path}: {os.strerror(number)}", "hopeless": True}
    text = error_text(made)
    if not isinstance(made, (ValueError, OSError)):
        text = f"{type(made).__name__}: {text}"
    return {"index": plan.index, "cause": text}
