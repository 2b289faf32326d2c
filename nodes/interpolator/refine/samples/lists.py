"""Holds lists on a device that grow as need be."""

from __future__ import annotations

from typing import Any

import warp as wp

SPARE = 1.5
"""Allocated size over needed size, so that lists seldom grow."""
ENTRIES = ("before", "after", "seen")
"""Fields that hold z-buffer entries, uint64."""
VALUES = ("start", "end", "rise", "tail")
"""Fields that hold ln I or changes of it."""


class GrowingList:
    """Holds a growing list on a device, as a struct of arrays for kernels: `kernel`, of `size` entries.

    Each of so many bands has an equal part of it, of `most` entries.
    """

    def __init__(self, struct: Any, pixel: Any, bands: int, device: Any) -> None:
        """pixel: the type of ln I."""
        self.kernel: Any = struct()
        self._types = {
            name: pixel if name in VALUES else wp.uint64 if name in ENTRIES else wp.int32 for name in struct.vars
        }
        self._bands, self._device, self.most = bands, device, 0

    @property
    def size(self) -> int:
        """Returns the number of entries of all bands together."""
        return self._bands * self.most

    def reserve(self, most: int) -> bool:
        """Makes room for `most` entries of each band; entries there are lost where the arrays must grow: then True."""
        if most <= self.most:
            return False
        self.most = int(SPARE * most)
        for name, dtype in self._types.items():
            setattr(self.kernel, name, wp.empty(self.size, dtype=dtype, device=self._device))
        return True


class Samples:
    """Holds the samples of a gap on a device, `arrays`: pixel, instant and value of each.

    pixel: index into [E, h, w]. instant: in PARTS of the time from one to the next. value: radiance.
    """

    def __init__(self, pixel: Any, device: Any) -> None:
        """pixel: the type of a value."""
        self._device = device
        self.arrays: list[wp.array] = [wp.empty(0, dtype=t, device=device) for t in (wp.int32, wp.int32, pixel)]

    @property
    def size(self) -> int:
        """Tells how many samples there is room for."""
        return int(self.arrays[0].size)

    def reserve(self, size: int, kept: int) -> bool:
        """Makes room for `size` samples, of which the first `kept` stay; True where the arrays have grown."""
        if size <= self.size:
            return False
        grown = []
        for old in self.arrays:
            new = wp.empty(int(SPARE * size), dtype=old.dtype, device=self._device)
            if kept:
                wp.copy(new, old, 0, 0, kept)
            grown.append(new)
        self.arrays = grown
        return True
