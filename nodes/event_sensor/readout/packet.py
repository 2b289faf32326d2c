"""Holds the events of one message in columns: parted at a time, and merged."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass
class Events:
    """Holds events sorted by environment, t, y, x.

    t int64 [n] ns; x, y uint16 [n]; p uint8 [n], 1 = ON; c uint8 [n] or None.

    env_offsets int64 [E + 1]: events of environment e are [offsets[e], offsets[e + 1]).
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    c: np.ndarray | None
    env_offsets: np.ndarray
    signal: np.ndarray | None = None
    """uint8 [n], 1 = made by light, 0 = by noise; of a sensor that marks its events."""


def merged(
    packets: Sequence[tuple[dict[str, np.ndarray], np.ndarray]], envs: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Joins columns and offsets of packets, each being later in every environment than those before it."""
    parts = [(columns, slice(offsets[e], offsets[e + 1])) for e in range(envs) for columns, offsets in packets]
    columns = {name: np.concatenate([c[name][s] for c, s in parts]) for name in packets[0][0]}
    return columns, np.sum([offsets for _, offsets in packets], axis=0)


def parted(
    columns: dict[str, np.ndarray], offsets: np.ndarray, end: int
) -> tuple[tuple[dict[str, np.ndarray], np.ndarray], tuple[dict[str, np.ndarray], np.ndarray]]:
    """Splits columns and offsets at `end` [ns] into those of the events up to it and of the later ones."""
    early = columns["t"] <= end
    counts = [np.count_nonzero(early[a:b]) for a, b in itertools.pairwise(offsets)]
    before = np.append(0, np.cumsum(counts)).astype(np.int64)
    return (
        ({name: c[early] for name, c in columns.items()}, before),
        ({name: c[~early] for name, c in columns.items()}, offsets - before),
    )
