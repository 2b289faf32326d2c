"""Writes what the decoders' kernels give: events, triggers, side words, and the report of a launch."""

from pathlib import Path

import warp as wp

from evis.native_code import native_code

_WRITING = [Path(__file__).with_name("writing.h")]


@wp.struct
class Span:
    """Describes the part of a stream that one launch decodes.

    start: first word. limit_us: events up to this time [us]. width, height: columns and rows of the words, 0 = unknown.
    """

    start: wp.int64
    limit_us: wp.int64
    width: wp.int32
    height: wp.int32


@wp.struct
class Sink:
    """Holds the state that a decoder's kernel continues from and the arrays it writes. All arrays are contiguous.

    state: see the codec's `Decoder`. out: next word, events, triggers, time [us] of the event at the cut or -1, side
    words. t [ns], x, y, p: events. trigger_t [ns], trigger_id, trigger_value. side_t [us], side_word: words of other
    parts of the sensor.
    """

    state: wp.array(dtype=wp.int64)
    out: wp.array(dtype=wp.int64)
    t: wp.array(dtype=wp.int64)
    x: wp.array(dtype=wp.uint16)
    y: wp.array(dtype=wp.uint16)
    p: wp.array(dtype=wp.uint8)
    trigger_t: wp.array(dtype=wp.int64)
    trigger_id: wp.array(dtype=wp.uint8)
    trigger_value: wp.array(dtype=wp.uint8)
    side_t: wp.array(dtype=wp.int64)
    side_word: wp.array(dtype=wp.uint16)


@wp.func_native(native_code(_WRITING, "put_event_at(n, time_ns, column, row, polarity, to);"))
def put_event(
    n: wp.int32,
    time_ns: wp.int64,
    column: wp.int32,
    row: wp.int32,
    polarity: wp.uint8,
    # out
    to: Sink,
):
    """Writes one event.

    Args:
        n: place of the event.
        time_ns: its time [ns].
        column: its pixel's column.
        row: its pixel's row.
        polarity: 1 = ON.
        to: where the event is written.
    """
    ...


@wp.func_native(native_code(_WRITING, "return keep_inside_of(first, last, columns, rows, to);"))
def keep_inside(
    # in
    first: wp.int32,
    last: wp.int32,
    columns: wp.int32,
    rows: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Removes the events outside the sensor from places first..last-1.

    Args:
        first: place of the first event.
        last: place behind the last event.
        columns: width of the sensor [px].
        rows: height of the sensor [px].
        to: where the events stand.

    Returns:
        the place behind the last event that is kept.
    """
    ...


@wp.func
def put_trigger(
    m: wp.int32,
    time_ns: wp.int64,
    channel: wp.int32,
    value: wp.int32,
    # out
    to: Sink,
):
    """Writes trigger m."""
    to.trigger_t[m] = time_ns
    to.trigger_id[m] = wp.uint8(channel)
    to.trigger_value[m] = wp.uint8(value)


@wp.func
def put_side(
    k: wp.int32,
    time_us: wp.int64,
    word: wp.uint16,
    # out
    to: Sink,
):
    """Writes side word k."""
    to.side_t[k] = time_us
    to.side_word[k] = word


@wp.func
def bound_of(size: wp.int32):
    """Returns the number of columns or rows that count as inside; all 16-bit addresses where the size is 0, unknown."""
    return wp.where(size == 0, 65536, size)


@wp.func
def report(
    at: wp.int32,
    events: wp.int32,
    triggers: wp.int32,
    next_us: wp.int64,
    # out
    to: Sink,
):
    """Reports the word to go on with, how much was written, and the time of the event at the cut or -1."""
    to.out[0] = wp.int64(at)
    to.out[1] = wp.int64(events)
    to.out[2] = wp.int64(triggers)
    to.out[3] = next_us
