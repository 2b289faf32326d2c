"""Holds lists on a device that grow as need be."""

from __future__ import annotations

from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.samples.list_kernels import ListPart, make_sample_list

SPARE = 1.5
"""Allocated size over needed size, so that lists seldom grow."""
ENTRIES = ("before", "after", "seen")
"""Fields that hold z-buffer entries, uint64."""
VALUES = ("start", "end", "rise", "tail")
"""Fields that hold ln I or changes of it."""
POINTS = ("weights",)
"""Fields that hold weights of a triangle's corners."""


def part_of(start: int, room: int, band: int, count: wp.array) -> Any:
    """Makes the ListPart of a band."""
    part: Any = ListPart()
    part.start, part.room, part.band, part.count = start, room, band, count
    return part


class GrowingList:
    """Holds a growing list on a device, as a struct of arrays for kernels: `kernel`, of `size` entries.

    Each of so many bands has an equal part of it, of `most` entries.
    """

    def __init__(self, struct: Any, pixel: Any, bands: int, device: Any) -> None:
        """Makes an empty list of a struct's fields. pixel: the type of ln I."""
        self.kernel: Any = struct()
        kinds = {
            **dict.fromkeys(VALUES, pixel),
            **dict.fromkeys(ENTRIES, wp.uint64),
            **dict.fromkeys(POINTS, wp.vec3),
        }
        self._types = {name: kinds.get(name, wp.int32) for name in struct.vars}
        self._bands, self._device, self.most = bands, device, 0
        self._parts: dict[tuple[int, int], Any] = {}

    @property
    def size(self) -> int:
        """Returns the number of entries of all bands together."""
        return self._bands * self.most

    def part(self, band: int, count: wp.array) -> Any:
        """Gives the ListPart of a band, whose entries are counted in count[band]."""
        key = band, count.ptr
        if key not in self._parts:
            self._parts[key] = part_of(band * self.most, self.most, band, count)
        return self._parts[key]

    def reserve(self, most: int) -> bool:
        """Makes room for `most` entries of each band; entries there are lost where the arrays must grow: then True."""
        if most <= self.most:
            return False
        self.most = int(SPARE * most)
        self._parts.clear()
        for name, dtype in self._types.items():
            setattr(self.kernel, name, wp.empty(self.size, dtype=dtype, device=self._device))
        return True


class Samples:
    """Holds the samples of a gap on a device, as a struct SampleList for kernels: `kernel`."""

    def __init__(self, channels: int, made: wp.array, device: Any) -> None:
        """Makes an empty list. channels: 1 (luminance) or 3 (RGB). made: samples before each list of pixels of a
        window."""
        self._device = device
        self.kernel: Any = make_sample_list(channels)()
        self.kernel.made = made
        kinds: dict[str, Any] = {
            "pixel": wp.int32,
            "instant": wp.int32,
            "value": pixel_type(channels),
        }
        for name, kind in kinds.items():
            setattr(self.kernel, name, wp.empty(0, dtype=kind, device=device))

    @property
    def arrays(self) -> list[wp.array]:
        """Gives pixel, instant and value of each sample."""
        return [self.kernel.pixel, self.kernel.instant, self.kernel.value]

    @property
    def size(self) -> int:
        """Tells how many samples there is room for."""
        return int(self.kernel.pixel.size)

    def reserve(self, size: int, kept: int) -> bool:
        """Makes room for `size` samples, of which the first `kept` stay; True where the arrays have grown."""
        if size <= self.size:
            return False
        for name in ("pixel", "instant", "value"):
            old = getattr(self.kernel, name)
            new = wp.empty(int(SPARE * size), dtype=old.dtype, device=self._device)
            if kept:
                wp.copy(new, old, 0, 0, kept)
            setattr(self.kernel, name, new)
        return True
