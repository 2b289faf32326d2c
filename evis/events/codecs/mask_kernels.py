"""Writes the events of masks of pixels, in C++ (`masks.h`)."""

from pathlib import Path

import warp as wp

from evis.events.codecs.writing_kernels import Sink
from evis.native_code import native_code

_MASKS = [Path(__file__).with_name("masks.h")]


@wp.func_native(native_code(_MASKS, "return put_12(n, time_ns, column, row, polarity, mask, to);"))
def put_vector(
    n: wp.int32,
    time_ns: wp.int64,
    column: wp.int32,
    row: wp.int32,
    polarity: wp.uint8,
    mask: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Writes an event for each pixel of a mask of 12 in a row; places n to n + 11 are overwritten.

    Args:
        n: place of the first event.
        time_ns: time of the events [ns].
        column: column of the first pixel.
        row: row of the pixels.
        polarity: 1 = ON.
        mask: bit i stands for pixel column + i.
        to: where the events are written.

    Returns:
        the place behind the last event.
    """
    ...


@wp.func_native(native_code(_MASKS, "return put_32(n, time_ns, column, row, polarity, mask, to);"))
def put_mask(
    n: wp.int32,
    time_ns: wp.int64,
    column: wp.int32,
    row: wp.int32,
    polarity: wp.uint8,
    mask: wp.uint32,
    # out
    to: Sink,
) -> wp.int32:
    """Writes an event for each pixel of a mask of 32 in a row.

    Args:
        n: place of the first event.
        time_ns: time of the events [ns].
        column: column of the first pixel.
        row: row of the pixels.
        polarity: 1 = ON.
        mask: bit i stands for pixel column + i.
        to: where the events are written.

    Returns:
        the place behind the last event.
    """
    ...


@wp.func_native(native_code(_MASKS, "return put_column(n, time_ns, column, row, polarity, mask, columns, rows, to);"))
def put_rows(
    n: wp.int32,
    time_ns: wp.int64,
    column: wp.int32,
    row: wp.int32,
    polarity: wp.uint8,
    mask: wp.int32,
    columns: wp.int32,
    rows: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Writes an event for each pixel of a mask in a column that lies inside the sensor.

    Args:
        n: place of the first event.
        time_ns: time of the events [ns].
        column: column of the pixels.
        row: row of the first pixel.
        polarity: 1 = ON.
        mask: bit i stands for pixel row + i.
        columns: width of the sensor [px].
        rows: height of the sensor [px].
        to: where the events are written.

    Returns:
        the place behind the last event.
    """
    ...


@wp.func_native("return __builtin_popcount(mask);")
def ones(mask: wp.int32) -> wp.int32:
    """Counts the pixels of a mask."""
    ...
