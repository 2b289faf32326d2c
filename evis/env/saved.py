"""Holds where the environments of a batch are, so that they can go on from there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from evis.simulation.saved import SimulationState


@dataclass(frozen=True)
class BatchState:
    """Holds where the environments of a batch are. kinds, parts: what is observed, by name, and what that keeps.

    kept: attributes of the batch. painted: what pictures are made of.
    """

    simulation: SimulationState
    kinds: Mapping[str, type]
    parts: Mapping[str, Any]
    task: Any
    kept: Mapping[str, Any]
    painted: Mapping[int, Any]
