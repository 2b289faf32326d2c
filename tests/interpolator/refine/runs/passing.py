"""Radiance of what pixels pass from and to, and the rays that they look along."""

import numpy as np
from rigid_rig import HEIGHT, WIDTH

WALL, NEAR = 0.2, 0.9


def rays(scene):
    """Pixels' rays float64 [h, w, 3] with z = 1."""
    k = scene.cameras[0].k
    columns, rows = (np.arange(WIDTH) - k[0, 2]) / k[0, 0], (np.arange(HEIGHT) - k[1, 2]) / k[1, 1]
    return np.stack([*np.meshgrid(columns, rows), np.ones((HEIGHT, WIDTH))], axis=-1)
