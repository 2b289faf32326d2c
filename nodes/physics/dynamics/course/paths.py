"""Holds the arrays that the motion of an interval is written to, and kernels' launches on them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.exchange import cpu_array
from evis.gpu.repeated_launch import RepeatedLaunch
from msgs.world import EVERY
from nodes.physics.dynamics.course.moving_kernels import find_moving

KERNELS = [(find_moving, LAUNCH_BLOCK)]
"""What is launched, as `build_together` takes it."""

SMALL, MOST_KEPT = 1 << 17, 8
"""Numbers of poses up to which arrays are used again, and how many: to show new ones to kernels takes longer than to
copy those out."""


class Paths:
    """Holds poses float64 [E, S, M, 7] and twists [E, S, M, 6] of bodies that may move.

    launches: what kernels write to them, kept by whoever launches these. kept: whether later intervals are written to
    the same arrays.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        """Allocates the paths. shape: E, S, M."""
        self.poses: np.ndarray = np.empty((*shape, 7))
        self.twists: np.ndarray = np.empty((*shape, 6))
        self.launches: dict[Any, Any] = {}
        self.kept = self.poses.size <= SMALL

    @cached_property
    def views(self) -> tuple[wp.array, wp.array]:
        """Gives poses and twists as kernels take them."""
        return cpu_array(self.poses), cpu_array(self.twists)

    @cached_property
    def _moving(self) -> tuple[np.ndarray, RepeatedLaunch]:
        found = np.zeros((self.poses.shape[0], self.poses.shape[2]), np.int32)
        bits = [cpu_array(values.view(np.int64), wp.int64) for values in (self.poses, self.twists)]
        return found, RepeatedLaunch(find_moving, [*bits, cpu_array(found)])

    def moving(self, part: slice | None = None) -> np.ndarray:
        """Finds which bodies are not at one pose without velocity throughout, to the bit, bool [M]; of a part of the
        environments while others look at the rest."""
        found, launch = self._moving
        if part is None:
            launch.whole(len(found))
        else:
            launch.part(part.start, len(found[part]))
        return np.asarray(found[part or EVERY].any(axis=0))


class PathsByShape:
    """Gives Paths for intervals that are made one after the other."""

    def __init__(self) -> None:
        self._kept: dict[tuple[int, int, int], Paths] = {}

    def of(self, shape: tuple[int, int, int]) -> Paths:
        """Gives arrays of E, S and M, which hold anything."""
        paths = self._kept.get(shape) or Paths(shape)
        if paths.kept and shape not in self._kept:
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[shape] = paths
        return paths
