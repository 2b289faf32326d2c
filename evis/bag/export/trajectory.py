"""Writes /state of a bag as one table: every body at every sub-step."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError
from msgs.header import Message
from msgs.world import WorldState

JOINTS = ("qpos", "qvel")


def write(messages: Iterable[Message], topic: str, out: BinaryIO) -> dict[str, Any]:
    """Writes an .npz of `table`. Raises BagError where the bodies change."""
    try:
        columns, count = table(messages)
    except ValueError as error:
        raise BagError(f"{topic}: {error}; export to .jsonl") from None
    np.savez(out, **columns)  # type: ignore[arg-type]
    return {"messages": count, "arrays": {n: list(v.shape) for n, v in columns.items()}}


def table(states: Iterable[Message]) -> tuple[dict[str, np.ndarray], int]:
    """Returns the arrays by name, and the number of messages.

    `t` int64 [T] ns; `episode` int64 [T]; `pose` float64 [T, E, N, 7] and `twist` [T, E, N, 6] of all bodies; `qpos`,
    `qvel` [T, E, n] where they are in every message; `names` of the N bodies.

    A message begins where the one before ended: that sub-step is there once. Raises ValueError where the bodies change.
    """
    columns: dict[str, list[np.ndarray]] = {name: [] for name in ("t", "episode", "pose", "twist", *JOINTS)}
    names: list[str] | None = None
    end: tuple[int, int] | None = None
    for state in states:
        assert isinstance(state, WorldState)
        if names is not None and names != state.names:
            raise ValueError("the bodies are others in later messages")
        names, episode = list(state.names), state.header.episode
        skip = int(bool(len(state.t)) and end == (episode, int(state.t[0])))
        end = (episode, state.header.stamp_ns)
        pose, twist = state.rows()
        columns["t"].append(np.array(state.t[skip:]))
        columns["episode"].append(np.full(len(state.t) - skip, episode, np.int64))
        steps = {"pose": pose, "twist": twist} | {n: a for n in JOINTS if (a := getattr(state, n)) is not None}
        for name, array in steps.items():
            columns[name].append(np.swapaxes(np.asarray(array), 0, 1)[skip:])
    count = len(columns["t"])
    whole = {name: np.concatenate(pieces) for name, pieces in columns.items() if pieces and len(pieces) == count}
    return {**whole, "names": np.array(names or [], str)}, count
