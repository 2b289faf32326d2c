"""Reads arrays of a device on the host: at once, or small ones without a wait for what is launched after them.

Warp is loaded with the first array of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import warp as wp

MOST = 3
"""Copies of an array that are kept; the next one takes the place of the first."""


def host_array(array: Any) -> np.ndarray:
    """Gives numpy's array of the same values, in the same memory where that is the host's; waits for a GPU."""
    return array if isinstance(array, np.ndarray) else np.asarray(array.numpy())


@cache
def copying_stream(alias: str) -> wp.Stream:
    """Gives the stream of a CUDA device, by its alias, for copies to the host beside all other work."""
    import warp as wp

    return wp.Stream(alias)


class HostCopies:
    """Copies an array to the host behind what was launched so far, to be read later."""

    def __init__(self, array: wp.array) -> None:
        """Takes the device's array."""
        import warp as wp

        device: Any = array.device
        self._array, self._device = array, device
        cuda = self._device.is_cuda
        self._kept = cycle(
            (
                wp.empty(array.shape, dtype=array.dtype, device="cpu", pinned=cuda),
                wp.Event(self._device) if cuda else None,
            )
            for _ in range(MOST)
        )

    def take(self) -> Callable[[], np.ndarray]:
        """Copies it as it will be then; what this returns waits for that and gives it."""
        import warp as wp

        host, there = next(self._kept)
        wp.copy(host, self._array)
        if there is not None:
            self._device.stream.record_event(there)

        def read() -> np.ndarray:
            if there is not None:
                wp.synchronize_event(there)
            values: Any = host.numpy()
            return np.array(values)

        return read
