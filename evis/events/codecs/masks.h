#pragma once
// Pixels of the masks that words carry, as events from place n on. All arrays are contiguous; callers see to the room.

// Writes the pixels of a mask of 12 side by side; uses 12 places. Returns the next place.
static const auto put_12 = [](int n, wp::int64 time_ns, int column, int row, wp::uint8 polarity, int mask,
    const auto& to) {
    for (int k = 0; k < 12; ++k) to.t.data[n + k] = time_ns;
    for (int k = 0; k < 12; ++k) to.y.data[n + k] = wp::uint16(row);
    for (int k = 0; k < 12; ++k) to.p.data[n + k] = polarity;
    for (int k = 0; k < 12; ++k) {
        to.x.data[n] = wp::uint16(column + k);
        n += mask >> k & 1;
    }
    return n;
};

// Writes the pixels of a mask of 32 side by side. Returns the next place.
static const auto put_32 = [](int n, wp::int64 time_ns, int column, int row, wp::uint8 polarity, wp::uint32 mask,
    const auto& to) {
    const int first = n;
    for (wp::uint32 rest = mask; rest; rest &= rest - 1) to.x.data[n++] = wp::uint16(column + __builtin_ctz(rest));
    for (int k = first; k < n; ++k) {
        to.t.data[k] = time_ns;
        to.y.data[k] = wp::uint16(row);
        to.p.data[k] = polarity;
    }
    return n;
};

// Writes the pixels of a mask one below the other, those inside. Returns the next place.
static const auto put_column = [](int n, wp::int64 time_ns, int column, int row, wp::uint8 polarity, int mask,
    int columns, int rows, const auto& to) {
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
        const int at = row + __builtin_ctz(rest), pixel = at & 0xFFFF;
        to.t.data[n] = time_ns;
        to.x.data[n] = wp::uint16(column);
        to.y.data[n] = wp::uint16(pixel);
        to.p.data[n] = polarity;
        n += (at >= 0) & (pixel < rows) & (column < columns);
    }
    return n;
};
