#pragma once
#include "../model/constants.h"

// Computes where a straight line s0 + s1 u has eight levels, in [low, high].
static const auto line_roots = [](const auto& s, auto level, auto low, auto high) {
#pragma clang fp contract(off)
    auto root = high;
    if (s[1] != 0.0) {
        root = (level - s[0]) / s[1];
        root = root > low ? root : low;
        root = root < high ? root : high;
    }
    return root;
};

// Computes where the cubic s0 + u (s1 + u (s2 + u s3)), monotone in [low, high], has eight levels: Halley's method in a
// bracket.
static const auto cubic_roots = [](const auto& s, auto level, auto low, auto high) {
#pragma clang fp contract(off)
    typedef decltype(level) doubles;
    typedef wp::int64 longs __attribute__((vector_size(64)));
    const doubles zero = {};
    const double c0 = s[0], c1 = s[1], c2 = s[2], c3 = s[3];
    const auto at = [&](doubles x) { return c0 + x * (c1 + x * (c2 + x * c3)); };
    const auto size = [&](doubles x) { return x < zero ? -x : x; };
    const doubles f_low = at(low) - level;
    const doubles f_high = at(high) - level;
    longs open = f_low * f_high < zero;
    doubles a = low;
    doubles b = high;
    doubles root = open ? low + (high - low) * f_low / (f_low - f_high) : f_low == zero ? low : high;
    // Halley's method inside a bracket.
    for (int turn = 0; turn < 60 && __builtin_reduce_or(open) != 0; turn++) {
        const doubles f = at(root) - level;
        const longs below = f * f_low > zero;
        a = below ? root : a;
        b = below ? b : root;
        const doubles slope = c1 + root * (2.0 * c2 + root * 3.0 * c3);
        const doubles bend = c2 + root * 3.0 * c3;
        const doubles next = root - f * slope / (slope * slope - f * bend);
        const longs close = size(f) <= 1.0e-6 * size(slope);
        const longs inside = (next > a) & (next < b);
        doubles kept = next > low ? next : low;
        kept = kept < high ? kept : high;
        root = open ? (close ? kept : inside ? next : 0.5 * (a + b)) : root;
        open = open & ~close;
    }
    return root;
};

// Writes the events of n crossings of one monotone piece of a step, eight at a time; returns the time of the last.
static const auto emit_crossings = [](const auto& roots, const auto& sensor, const auto& s, double reference,
    double threshold, int n, double u, double piece, wp::int64 start, wp::int64 until, double h, wp::int64 t_base,
    wp::int64 place, wp::int64 here, int fired, bool cap, const auto& keys, const auto& counters) {
#pragma clang fp contract(off)
    typedef double doubles __attribute__((vector_size(64)));
    typedef wp::int64 longs __attribute__((vector_size(64)));
    const doubles number = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0};
    const doubles low = number - number + u;
    const doubles high = number - number + piece;
    const int shift = (int)sensor.shift_t;
    const int written = cap ? (fired >= sensor.event_cap ? 0 : n < sensor.event_cap - fired ? n : sensor.event_cap - fired) : n;
    const wp::int64 slot = counters.data[EVENTS];
    const bool room = slot + written <= sensor.capacity;
    wp::int64 time = here;
    for (int j = 0; j < n; j += 8) {
        const doubles level = reference + (number + (double)j) * threshold;
        const doubles root = roots(s, level, low, high);
        longs ns = __builtin_convertvector(root * h + 0.5, longs);
        ns = start + (ns > 1 ? ns : 1);
        ns = ns < until ? ns : until;
        const int many = n - j < 8 ? n - j : 8;
        // Events of a pixel never go back in time.
        for (int lane = 0; lane < many; lane++) {
            time = ns[lane] > time ? ns[lane] : time;
            ns[lane] = time;
        }
        const longs key = (ns - t_base) << shift | place;
        if (room && j < written) memcpy(keys.data + slot + j, &key, sizeof(key));
    }
    counters.data[EVENTS] = slot + written;
    counters.data[DROPPED] += n - written;
    return time;
};
