"""All crossings of a monotone piece of a step at once, eight by eight: in C++, on a CPU.

The same as model.emit_kernels event by event, in the same arithmetic; only the roots of a cubic are found
inside one bracket for all and not from root to root, which may move an event by a nanosecond.
"""

from typing import Any

import warp as wp

from nodes.event_sensor.cpu.simd_kernels import filled_in
from nodes.event_sensor.model.pixel_kernels import DROPPED, EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

LANES = """
#pragma clang fp contract(off)
    typedef double doubles __attribute__((vector_size(64)));
    typedef wp::int64 longs __attribute__((vector_size(64)));
    const doubles number = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0};
    const doubles zero = number - number;
    const doubles low = zero + u;
    const doubles high = zero + piece;
    const int shift = (int)sensor.shift_t;
    const int written = cap ? (fired >= sensor.cap ? 0 : n < sensor.cap - fired ? n : sensor.cap - fired) : n;
    const wp::int64 slot = counters.data[EVENTS];
    const bool room = slot + written <= sensor.capacity;
    wp::int64 time = here;
    for (int j = 0; j < n; j += 8) {
        const doubles level = reference + (number + (double)j) * threshold;
"""
LINE = """
        doubles root = high;
        if (s[1] != 0.0) {
            root = (level - s[0]) / s[1];
            root = root > low ? root : low;
            root = root < high ? root : high;
        }
"""
CURVE = """
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
"""
KEYS = """
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
"""
PLACES = {"EVENTS": str(int(EVENTS)), "DROPPED": str(int(DROPPED))}


@wp.func_native(filled_in(LANES + LINE + KEYS, **PLACES))
def fire_line(
    sensor: Sensor, s: wp.vec4d, reference: wp.float64, threshold: wp.float64, n: wp.int32, u: wp.float64,
    piece: wp.float64, start: wp.int64, until: wp.int64, h: wp.float64, t_base: wp.int64, place: wp.int64,
    here: wp.int64, fired: wp.int32, cap: wp.bool, keys: wp.array(dtype=wp.int64), counters: wp.array(dtype=wp.int64),
) -> wp.int64:  # fmt: skip
    """Events of n crossings of a straight line; returns the last's time. `keys` has SPARE places beyond its capacity.

    Parameters as in emit_kernels.crossings_fired; threshold with its sign; cap: no more than sensor.cap a step.
    """
    ...


@wp.func_native(filled_in(LANES + CURVE + KEYS, **PLACES))
def fire_curve(
    sensor: Sensor, s: wp.vec4d, reference: wp.float64, threshold: wp.float64, n: wp.int32, u: wp.float64,
    piece: wp.float64, start: wp.int64, until: wp.int64, h: wp.float64, t_base: wp.int64, place: wp.int64,
    here: wp.int64, fired: wp.int32, cap: wp.bool, keys: wp.array(dtype=wp.int64), counters: wp.array(dtype=wp.int64),
) -> wp.int64:  # fmt: skip
    """The same for a cubic."""
    ...


def fire_lanes(curved: bool) -> Any:
    """The function for a step's curve."""
    return fire_curve if curved else fire_line
