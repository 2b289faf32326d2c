"""Defines the tolerance of a body's error in position and rotation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Tolerance:
    """Holds how much error of position [m] and rotation [rad] a body may gather in a simulated second."""

    position: float
    rotation: float

    @classmethod
    def of(cls, values: Sequence[Any]) -> Tolerance | None:
        """Reads a parameter of one or two numbers, None for none at all. Raises ValueError for others."""
        try:
            numbers = [float(value) for value in values]
        except (TypeError, ValueError):
            numbers = [-1.0]
        if not numbers:
            return None
        if len(numbers) > 2 or not all(0 < number < np.inf for number in numbers):
            told = ",".join(map(str, values))
            raise ValueError(f"physics_tolerance is {told}; it must be metres and radians above 0, as 0.001,0.001")
        return cls(numbers[0], numbers[-1])
