#pragma once
// Lays down what a decoder's kernel gives. Warp's own access to an array tests the sign of the index and multiplies it by
// the stride each time, which costs more than the stores; all arrays here are contiguous, and callers see to the room.

// Writes event n.
static const auto put_event_at = [](int n, wp::int64 time_ns, int column, int row, wp::uint8 polarity, const auto& to) {
    to.t.data[n] = time_ns;
    to.x.data[n] = wp::uint16(column);
    to.y.data[n] = wp::uint16(row);
    to.p.data[n] = polarity;
};

// Closes the gaps that events outside leave in first..last-1. Returns the place behind the last that is kept.
static const auto keep_inside_of = [](int first, int last, int columns, int rows, const auto& to) {
    bool all = true;
    for (int k = first; k < last; ++k) all &= (to.x.data[k] < columns) & (to.y.data[k] < rows);
    if (all) return last;
    int n = first;
    for (int k = first; k < last; ++k) {
        const bool inside = (to.x.data[k] < columns) & (to.y.data[k] < rows);
        to.t.data[n] = to.t.data[k];
        to.x.data[n] = to.x.data[k];
        to.y.data[n] = to.y.data[k];
        to.p.data[n] = to.p.data[k];
        n += inside;
    }
    return n;
};
