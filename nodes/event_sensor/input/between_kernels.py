# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Holds the further samples between the frames for kernels, and takes a pixel from one of its samples to the next.

A pixel's samples are those of the frames, and between these its further ones. Whoever goes through them in the order of
time keeps the next frame and the next further sample, and asks `next_sample` which of both comes first. Two walks are
written out beside these: that of the ideal sensor in C++ for vector units (cpu/further.h), and that of a call on a GPU,
whose arrays are known by their addresses alone (cuda/further_kernels.py).
"""

from typing import TYPE_CHECKING, Any

import warp as wp

if TYPE_CHECKING:
    from nodes.event_sensor.input.batch import SampleLists

wp.set_module_options({"enable_backward": False})


@wp.struct
class Between:
    """Holds further samples between the frames, see batch.SampleLists; with empty arrays where there are none."""

    first: wp.array(dtype=wp.int32)
    offset: wp.array(dtype=wp.int32)
    value: wp.array(dtype=wp.float32)
    shared: wp.int32


NOTHING = Between()


def between(lists: "SampleLists | None") -> Between:
    """Returns the further samples of a message for kernels."""
    if lists is None:
        return NOTHING
    struct: Any = Between()
    struct.first, struct.offset, struct.value, struct.shared = lists.first, lists.offset, lists.value, lists.shared
    return struct  # type: ignore[no-any-return]


@wp.func(inline=True)
def further_entries(between: Between, index: wp.int32):
    """Returns where the further samples of a pixel and channel begin and end in their arrays; 0 and 0 where there are
    none."""
    first = int(0)
    end = int(0)
    if between.first.shape[0] > 0:
        one = index // between.shared
        first = between.first[one]
        end = between.first[one + 1]
    return first, end


@wp.func(inline=True)
def next_sample(
    between: Between, index: wp.int32, entry: wp.int32, end: wp.int32, stamp: wp.int64, light: wp.float32
):  # fmt: skip
    """Finds which sample of a pixel and channel comes next; returns whether it is a further one, its time and light.

    entry, end: its further sample that is next, and where they end. stamp, light: of the frame that is next, and the
    pixel's light in it. Times are in ns from where the offsets of further samples count.
    """
    further = bool(False)
    now = wp.int64(stamp)
    sample = wp.float32(light)
    if entry < end:
        when = wp.int64(between.offset[entry])
        if when < stamp:
            further = True
            now = when
            shared = between.shared
            sample = between.value[wp.int64(entry) * wp.int64(shared) + wp.int64(index % shared)]
    return further, now, sample
