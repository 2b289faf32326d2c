"""Gives arrays in the host's memory, without Warp where none is Warp's."""

from __future__ import annotations

from typing import Any

import numpy as np


def host_array(array: Any) -> np.ndarray:
    """Gives numpy's array of the same values, in the same memory where that is the host's; waits for a GPU."""
    return array if isinstance(array, np.ndarray) else np.asarray(array.numpy())
