"""What passes between who gives work and a worker: plans one way, answers the other, as plain values."""

from __future__ import annotations

import errno
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from evis.dataset.making.worker import Maker
from evis.dataset.recipe import Plan

HOPELESS = (errno.ENOSPC, errno.EDQUOT, errno.EACCES, errno.EPERM, errno.EROFS)
"""Faults of the place that is written to: nothing else can be written there either."""


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
    """Processes or actors that make sequences."""

    count: int

    def give(self, worker: int, plan: Plan) -> None:
        """Gives a worker its next plan, and first makes it anew where it has died."""

    def wait(self, timeout_s: float) -> Sequence[Answer]:
        """Waits for answers, at least one unless the time is over."""

    def close(self) -> None:
        """Ends all workers."""


class Answerer:
    """Makes what plans ask for, and turns what goes wrong into answers."""

    def __init__(self, out: str) -> None:
        self._maker = Maker(out)

    def answer(self, plan: dict[str, Any]) -> dict[str, Any]:
        """Makes one sequence; returns the fields of an Answer but for its worker."""
        try:
            entry = self._maker.make(Plan.from_dict(plan))
        except MemoryError:
            return {"index": plan["index"], "cause": "the worker ran out of memory"}
        except Exception as error:
            if number := _refused(error):
                return {"index": plan["index"], "cause": f"{plan['path']}: {os.strerror(number)}", "hopeless": True}
            text = " ".join(str(error).split()) or type(error).__name__
            if not isinstance(error, (ValueError, OSError)):
                text = f"{type(error).__name__}: {text}"
            return {"index": plan["index"], "cause": text}
        return {"index": plan["index"], "entry": entry.as_dict()}


def _refused(error: Exception) -> int:
    """The number of the fault for which nothing else can be written either; 0 for any other error."""
    if isinstance(error, OSError) and error.errno in HOPELESS:
        return error.errno
    # HDF5 says it in the text alone.
    return next((number for number in HOPELESS[:2] if os.strerror(number) in str(error)), 0)
