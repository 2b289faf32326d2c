"""Describes lists for kernels that add to them or go through them: the part that a band of rows has, and the
samples."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.image_kernels import pixel_type

wp.set_module_options({"enable_backward": False})


@wp.struct
class ListPart:
    """Holds where the part of a band begins, how many entries it has room for, the band, and the counts [bands].

    count[band]: how many entries it has, or would have if there were room for all.
    """

    start: int
    room: int
    band: int
    count: wp.array(dtype=int)


@wp.func
def take_entry(part: ListPart):
    """Takes the next place of a part, counted from its start: beyond its room there is none."""
    return take_place(part.count, part.band)


@wp.func
def end_of(part: ListPart):
    """Gives where the entries of a part end, those that are there."""
    return part.start + wp.min(part.count[part.band], part.room)


@cache
def make_sample_list(channels: int) -> Any:
    """Makes the struct of the samples of a gap; channels: 1 (luminance) or 3 (RGB).

    pixel: index into [E, h, w]. instant: in PARTS of the time from one instant to the next. value: radiance. made:
    samples before each list of pixels of the window.
    """
    kind = pixel_type(channels)

    class SampleList:
        pixel: wp.array(dtype=int)
        instant: wp.array(dtype=int)
        value: wp.array(dtype=kind)
        made: wp.array(dtype=int)

    SampleList.__qualname__ = f"SampleList{channels}"
    return wp.struct(SampleList)


@cache
def make_add_sample(channels: int) -> Any:
    """Makes the function `add_sample`; channels: 1 (luminance) or 3 (RGB)."""
    SampleList: Any = make_sample_list(channels)
    kind = pixel_type(channels)

    @wp.func
    def add_sample(samples: SampleList, place: int, pixel: int, instant: int, value: kind):
        """Writes a sample to its place, if there is room."""
        if place < samples.pixel.shape[0]:
            samples.pixel[place] = pixel
            samples.instant[place] = instant
            samples.value[place] = value

    return add_sample
