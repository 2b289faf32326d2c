"""Places what is mounted on bodies of environments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.exchange import cpu_array
from evis.gpu.repeated_launch import RepeatedLaunch
from nodes.physics.dynamics.course.mount_kernels import place_mounted
from nodes.physics.dynamics.course.paths import Paths

KERNELS = [(place_mounted, LAUNCH_BLOCK)]
"""What is launched, as `build_together` takes it."""


class Mounted:
    """Computes poses and twists of bodies mounted on others, to the bit as se3.compose and se3.compose_twist."""

    def __init__(self, mounted: Sequence[tuple[int, int, np.ndarray]]) -> None:
        """Takes the bodies that are fixed on others.

        mounted: of each, which of M bodies it is, which it is fixed on, and its pose float64 [7] there; a body comes
        before those that are fixed on it.
        """
        below = np.array([m for m, _, _ in mounted], np.int32)
        above = np.array([parent for _, parent, _ in mounted], np.int32)
        offsets = np.array([offset for _, _, offset in mounted], np.float64)
        self._given = [cpu_array(values) for values in (below, above, offsets)]

    def put(self, paths: Paths, part: slice | None = None) -> None:
        """Writes them into the paths of all environments, or of a part of them while others write to the rest."""
        launch = paths.launches.get(self)
        if launch is None:
            launch = paths.launches[self] = RepeatedLaunch(place_mounted, [*self._given, *paths.views])
        if part is None:
            launch.whole(len(paths.poses))
        else:
            launch.part(part.start, len(paths.poses[part]))
