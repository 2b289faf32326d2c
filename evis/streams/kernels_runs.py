"""Inner loops of the EVT decoders, in C++: runs of words without a turn of the time, and vectors of pixels.

Array access in Warp tests the index's sign and multiplies by the stride each time, which costs more than the rest of
the work. All arrays here are contiguous, and callers see to the room.
"""

import warp as wp

RUN = 1024
"""Most words that `evt3_run` takes at a time: what it lays aside for them stays in the cache."""


@wp.func_native(f"""
    wp::uint64 kept[{RUN}];
    wp::int32 i = at, n = 0;
    const wp::int32 stop = end - at < {RUN} ? end : at + {RUN};
    const wp::uint32 same = 0x8000u | wp::uint32(high);
    wp::uint32 low = wp::uint32(state.data[2]), row = wp::uint32(state.data[4]);
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
    state.data[2] = low;
    state.data[4] = row;
    for (wp::int32 k = 0; k < n; ++k) {{
        t.data[first + k] = (since + wp::int64(kept[k] >> 32)) * 1000;
        x.data[first + k] = kept[k] & 0x7FF;
        y.data[first + k] = kept[k] >> 16 & 0x7FF;
        p.data[first + k] = kept[k] >> 11 & 1;
    }}
    out.data[1] = first + n;
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
    state: wp.array(dtype=wp.int64),
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
) -> wp.int32:
    """Rows, pixels and low times from word `at` up to the first other word, or a low time behind `latest`.

    Events go to place `first` on. Changes low time and row in `state`; out[1] = events. Returns the word to go on with.
    """
    ...


@wp.func_native("""
    wp::int32 i = at;
    while (i < end && words.data[i] >> 29 == 0) ++i;
    for (wp::int32 k = 0; k < i - at; ++k) {
        const wp::uint32 word = words.data[at + k];
        t.data[first + k] = (since + wp::int64(word >> 22 & 63)) * 1000;
        x.data[first + k] = word >> 11 & 0x7FF;
        y.data[first + k] = word & 0x7FF;
        p.data[first + k] = word >> 28;
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
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
) -> wp.int32:
    """Events from word `at` up to the first other word, to place `first` on. Returns the word to go on with."""
    ...


@wp.func_native("""
    bool all = true;
    for (wp::int32 k = first; k < last; ++k) all &= (x.data[k] < columns) & (y.data[k] < rows);
    if (all) return last;
    wp::int32 n = first;
    for (wp::int32 k = first; k < last; ++k) {
        const bool inside = (x.data[k] < columns) & (y.data[k] < rows);
        t.data[n] = t.data[k];
        x.data[n] = x.data[k];
        y.data[n] = y.data[k];
        p.data[n] = p.data[k];
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
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
) -> wp.int32:
    """Close the gaps that events outside leave in first..last-1. Returns the place behind the last that is kept."""
    ...


@wp.func_native("""
    for (int k = 0; k < 12; ++k) t.data[n + k] = time_ns;
    for (int k = 0; k < 12; ++k) y.data[n + k] = wp::uint16(row);
    for (int k = 0; k < 12; ++k) p.data[n + k] = polarity;
    for (int k = 0; k < 12; ++k) {
        x.data[n] = wp::uint16(column + k);
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
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
) -> wp.int32:
    """The pixels of a mask of 12 from `column` on; uses 12 places from n on. Returns the next place."""
    ...


@wp.func_native("""
    const wp::int32 first = n;
    for (wp::uint32 rest = mask; rest; rest &= rest - 1) x.data[n++] = wp::uint16(column + __builtin_ctz(rest));
    for (wp::int32 k = first; k < n; ++k) {
        t.data[k] = time_ns;
        y.data[k] = wp::uint16(row);
        p.data[k] = polarity;
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
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
) -> wp.int32:
    """The pixels of a mask of 32 from `column` on. Returns the next place."""
    ...
