"""Inner loops of the EVT decoders, in C++: runs of words without a turn of the time, and vectors of pixels.

Array access in Warp tests the index's sign and multiplies by the stride each time, which costs more than the rest of
the work. All arrays here are contiguous, and callers see to the room.
"""

import warp as wp

from evis.events.codecs.writing_kernels import Sink

RUN = 1024
"""Most words that `evt3_run` takes at a time: what it lays aside for them stays in the cache."""


@wp.func_native(f"""
    wp::uint64 kept[{RUN}];
    wp::int32 i = at, n = 0;
    const wp::int32 stop = end - at < {RUN} ? end : at + {RUN};
    const wp::uint32 same = 0x8000u | wp::uint32(high);
    wp::uint32 low = wp::uint32(to.state.data[2]), row = wp::uint32(to.state.data[4]);
    // rows, pixels and times follow each other in an order that no processor can guess: no branches on them
    while (i < stop && low <= wp::uint32(latest)) {{
        const wp::uint32 word = words.data[i], kind = word >> 12, value = word & 0xFFF;
        if (__builtin_unpredictable((0x3F3Au >> kind & 1) & (word != same))) break;
        kept[n] = wp::uint64(low) << 32 | row << 16 | value;
        n += kind == 2;
        low = kind == 6 ? value : low;
        row = kind == 0 ? value & 0x7FF : row;
        ++i;
    }}
    to.state.data[2] = low;
    to.state.data[4] = row;
    for (wp::int32 k = 0; k < n; ++k) {{
        to.t.data[first + k] = (since + wp::int64(kept[k] >> 32)) * 1000;
        to.x.data[first + k] = kept[k] & 0x7FF;
        to.y.data[first + k] = kept[k] >> 16 & 0x7FF;
        to.p.data[first + k] = kept[k] >> 11 & 1;
    }}
    to.out.data[1] = first + n;
    return i;
""")
def evt3_run(
    # in
    words: wp.array(dtype=wp.uint16),
    at: wp.int32,
    end: wp.int32,
    since: wp.int64,
    high: wp.int32,
    latest: wp.int32,
    first: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Rows, pixels and low times from word `at` up to the first other word, or a low time behind `latest`.

    Events go to place `first` on. Changes low time and row in its state; out[1] = events. Returns the word to go on
    with.
    """
    ...


@wp.func_native("""
    wp::int32 i = at;
    while (i < end && words.data[i] >> 29 == 0) ++i;
    for (wp::int32 k = 0; k < i - at; ++k) {
        const wp::uint32 word = words.data[at + k];
        to.t.data[first + k] = (since + wp::int64(word >> 22 & 63)) * 1000;
        to.x.data[first + k] = word >> 11 & 0x7FF;
        to.y.data[first + k] = word & 0x7FF;
        to.p.data[first + k] = word >> 28;
    }
    return i;
""")
def evt2_run(
    # in
    words: wp.array(dtype=wp.uint32),
    at: wp.int32,
    end: wp.int32,
    since: wp.int64,
    first: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Events from word `at` up to the first other word, to place `first` on. Returns the word to go on with."""
    ...


@wp.func_native("""
    bool all = true;
    for (wp::int32 k = first; k < last; ++k) all &= (to.x.data[k] < columns) & (to.y.data[k] < rows);
    if (all) return last;
    wp::int32 n = first;
    for (wp::int32 k = first; k < last; ++k) {
        const bool inside = (to.x.data[k] < columns) & (to.y.data[k] < rows);
        to.t.data[n] = to.t.data[k];
        to.x.data[n] = to.x.data[k];
        to.y.data[n] = to.y.data[k];
        to.p.data[n] = to.p.data[k];
        n += inside;
    }
    return n;
""")
def keep_inside(
    # in
    first: wp.int32,
    last: wp.int32,
    columns: wp.int32,
    rows: wp.int32,
    # out
    to: Sink,
) -> wp.int32:
    """Close the gaps that events outside leave in first..last-1. Returns the place behind the last that is kept."""
    ...


@wp.func_native("""
    for (int k = 0; k < 12; ++k) to.t.data[n + k] = time_ns;
    for (int k = 0; k < 12; ++k) to.y.data[n + k] = wp::uint16(row);
    for (int k = 0; k < 12; ++k) to.p.data[n + k] = polarity;
    for (int k = 0; k < 12; ++k) {
        to.x.data[n] = wp::uint16(column + k);
        n += mask >> k & 1;
    }
    return n;
""")
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
    """The pixels of a mask of 12 from `column` on; uses 12 places from n on. Returns the next place."""
    ...


@wp.func_native("""
    const wp::int32 first = n;
    for (wp::uint32 rest = mask; rest; rest &= rest - 1) to.x.data[n++] = wp::uint16(column + __builtin_ctz(rest));
    for (wp::int32 k = first; k < n; ++k) {
        to.t.data[k] = time_ns;
        to.y.data[k] = wp::uint16(row);
        to.p.data[k] = polarity;
    }
    return n;
""")
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
    """The pixels of a mask of 32 from `column` on. Returns the next place."""
    ...


@wp.func_native("""
    if (row >= 0 && row + 32 - __builtin_clz(mask | 1) <= rows && column < columns) {
        for (wp::uint32 rest = mask; rest; rest &= rest - 1, ++n) {
            to.t.data[n] = time_ns;
            to.x.data[n] = wp::uint16(column);
            to.y.data[n] = wp::uint16(row + __builtin_ctz(rest));
            to.p.data[n] = polarity;
        }
        return n;
    }
    for (wp::uint32 rest = mask; rest; rest &= rest - 1) {
        const wp::int32 at = row + __builtin_ctz(rest), pixel = at & 0xFFFF;
        to.t.data[n] = time_ns;
        to.x.data[n] = wp::uint16(column);
        to.y.data[n] = wp::uint16(pixel);
        to.p.data[n] = polarity;
        n += (at >= 0) & (pixel < rows) & (column < columns);
    }
    return n;
""")
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
    """The pixels of a mask, one below the other from `row` on, that are inside. Returns the next place."""
    ...


@wp.func_native("return __builtin_popcount(mask);")
def ones(mask: wp.int32) -> wp.int32:
    """Pixels of a mask."""
    ...
