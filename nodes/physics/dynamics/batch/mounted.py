"""Places what is mounted on bodies of many environments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.exchange import cpu_array
from evis.warp_start import start_warp
from nodes.physics.dynamics.batch.mount_kernels import place_mounted

start_warp()

KERNELS = [(place_mounted, LAUNCH_BLOCK)]
"""What is launched, as `build_together` takes it."""


def put_mounted(mounted: Sequence[tuple[int, int, np.ndarray]], poses: np.ndarray, twists: np.ndarray) -> None:
    """Writes poses and twists of what is mounted on other bodies, to the bit as `Assembly.put_mounted` by numpy.

    mounted: of each, which of M bodies it is, which it is fixed on, and its pose float64 [7] there; what others are
    fixed on comes first. poses: float64 [E, S, M, 7]. twists: float64 [E, S, M, 6].
    """
    below = np.array([m for m, _, _ in mounted], np.int32)
    above = np.array([parent for _, parent, _ in mounted], np.int32)
    offsets = np.array([offset for _, _, offset in mounted], np.float64)
    inputs = [0, *(cpu_array(values) for values in (below, above, offsets, poses, twists))]
    wp.launch(place_mounted, len(poses), inputs, device="cpu")
