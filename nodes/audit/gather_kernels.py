"""Gathers the values of a few pixels out of frames that lie on a GPU."""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})


@cache
def _make_take(dtype: Any) -> wp.Kernel:
    @wp.kernel(module="unique", enable_backward=False)
    def take(frames: wp.array(dtype=dtype), places: wp.array(dtype=wp.int64), out: wp.array(dtype=dtype)):  # type: ignore[valid-type]
        """Copies the values at `places`."""
        i = wp.tid()
        out[i] = frames[places[i]]

    return take


def gather(frames: wp.array, env: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Gives [A, K, n(, 3)] of frames [E, K, h, w(, 3)] on a GPU, at env int64 [A, 1], y and x int64 [A, n]."""
    _, count, height, width = frames.shape[:4]
    k = np.arange(count)[None, :, None]
    places = ((env[:, :, None] * count + k) * height + y[:, None]) * width + x[:, None]
    if frames.ndim == 5:
        places = places[..., None] * 3 + np.arange(3)
    flat = frames.flatten()
    out = wp.empty(places.size, dtype=flat.dtype, device=frames.device)
    inputs = [flat, wp.array(places.reshape(-1), dtype=wp.int64, device=frames.device)]
    wp.launch(_make_take(flat.dtype), places.size, inputs, [out], device=frames.device)
    taken = out.numpy()
    return taken.reshape(*places.shape, *taken.shape[1:])
