"""One step of many pixels, on a CPU: functions in C++ whose loops the compiler turns into vector code.

The strides of a Warp array are known only when it runs, so a compiler cannot vectorise over it; the arrays here are
contiguous. What is computed is what model.pixel_kernels says, in float64 and without fused multiply-add, so that
every machine finds the same; ln is a polynomial whose error is below one unit in the last place.
"""

from typing import Any

import warp as wp

from nodes.event_sensor.model.pixel_kernels import CLIPPED, GUARD, LARGEST, NONFINITE, SMALLEST, TOLERANCE, Sensor

wp.set_module_options({"enable_backward": False})

BLOCK = 2048
"""Pixels that are looked at together: their bands stay in the nearest cache for all steps of a call."""
SPARE = 8
"""Places that a list of keys needs beyond its events."""


@wp.struct
class Level:
    """The reference of a pixel is base + net C_on + n_off (C_on - C_off); see pixel_kernels.Pixel."""

    base: wp.float64
    net: wp.int32
    n_off: wp.int32


@wp.struct
class Bands:
    """State per pixel and channel. Intensities in [low, high] cannot fire; low infinite: no reference yet.

    last: the sample before the call, or the last good one.
    """

    last: wp.array(dtype=wp.float32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    level: wp.array(dtype=Level)


@wp.struct
class Listed:
    """Pixels of a block in which a step may have an event, each array with a place for every pixel of a block.

    place: in the block. before, after: the samples at the step's ends. reference: before the step; its crossing of
    level j, j = 1..count, is at (reference + j threshold - origin) slope [ns] from the step's start, threshold having
    its sign. tail: of the events' keys. base, net, n_off, low, high: the state after the step. set_aside: how many
    samples were not finite and how many below the floor, of them all.
    """

    place: wp.array(dtype=wp.int32)
    before: wp.array(dtype=wp.float32)
    after: wp.array(dtype=wp.float32)
    reference: wp.array(dtype=wp.float64)
    threshold: wp.array(dtype=wp.float64)
    origin: wp.array(dtype=wp.float64)
    slope: wp.array(dtype=wp.float64)
    count: wp.array(dtype=wp.int32)
    tail: wp.array(dtype=wp.int64)
    base: wp.array(dtype=wp.float64)
    net: wp.array(dtype=wp.int32)
    n_off: wp.array(dtype=wp.int32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    set_aside: wp.array(dtype=wp.int64)


def room_for_block() -> Any:
    """A Listed for a block."""
    work: Any = Listed()
    for name, field in Listed.vars.items():
        setattr(work, name, wp.zeros(BLOCK, dtype=field.type.dtype, device="cpu"))
    return work


def filled_in(source: str, **values: Any) -> str:
    """Source code with constants for their names in capitals."""
    for name, value in values.items():
        source = source.replace(name, value)
    return source


CONSTANTS = {
    "LARGEST": f"{float(LARGEST)!r}f",
    "SMALLEST": f"{float(SMALLEST)!r}",
    "GUARD": f"{float(GUARD)!r}",
    "TOLERANCE": f"{float(TOLERANCE)!r}",
    "CLIPPED": str(int(CLIPPED)),
    "NONFINITE": str(int(NONFINITE)),
}

LIST = """
    typedef float floats __attribute__((vector_size(64)));
    typedef bool flags __attribute__((ext_vector_type(16)));
    const float* v = luminance.data + at;
    const float* lows = bands.low.data + index;
    const float* highs = bands.high.data + index;
    int* place = work.place.data;
    int n = 0;
    int i = 0;
    for (; i + 16 <= size; i += 16) {
        __builtin_prefetch(v + ahead + i, 0, 2);
        floats sample, low, high;
        memcpy(&sample, v + i, sizeof(sample));
        memcpy(&low, lows + i, sizeof(low));
        memcpy(&high, highs + i, sizeof(high));
        const flags quiet = __builtin_convertvector((sample >= low) & (sample <= high), flags);
        unsigned short lanes;
        memcpy(&lanes, &quiet, sizeof(lanes));
        for (unsigned loud = 0xFFFFu & ~lanes; loud != 0; loud &= loud - 1) place[n++] = i + __builtin_ctz(loud);
    }
    for (; i < size; i++)
        if (!(v[i] >= lows[i] && v[i] <= highs[i])) place[n++] = i;
    return n;
"""


@wp.func_native(LIST)
def list_loud(
    luminance: wp.array(dtype=wp.float32), at: wp.int64, ahead: wp.int64, bands: Bands, index: wp.int32, size: wp.int32,
    work: Listed,
) -> wp.int32:  # fmt: skip
    """List the pixels of a block whose sample is not inside the quiet band; returns how many there are.

    at, index: of the block's first pixel, in the frame and in the state. ahead: how far from here the samples lie that
    will be looked at next. size: of the block.
    """
    ...


VALID = """
    const auto valid = [&sensor](float v) { return v >= 0.0f && v <= LARGEST && v + sensor.dark > 0.0; };
"""
SAMPLES = """
    const float* v = luminance.data + at;
    const float* earlier = k > 0 ? v - stride : bands.last.data + index;
    for (int i = 0; i < n; i++) {
        const int place = work.place.data[i];
        float before = earlier[place];
        for (int back = 2; __builtin_expect(!valid(before) && back <= k + 1, 0); back++)
            before = back <= k ? v[place - back * stride] : bands.last.data[index + place];
        work.before.data[i] = before;
        work.after.data[i] = v[place];
    }
"""


@wp.func_native(filled_in(VALID + SAMPLES, **CONSTANTS))
def take_samples(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, k: wp.int32, bands: Bands,
    index: wp.int32, n: wp.int32, work: Listed,
):  # fmt: skip
    """The samples at both ends of step k of the n pixels that are listed; the last good one stands for one that is not.

    stride: from frame to frame.
    """
    ...


LOG = """
    // ln x = e ln 2 + ln m with m in [sqrt(1/2), sqrt(2)); with f = m - 1 and s = f / (2 + f),
    // ln m = f - f^2 / 2 + s (f^2 / 2 + R) and R = 2 (s^2 / 3 + s^4 / 5 + ...) to 2e-16 of its size.
    const auto log_of = [](double x) {
#pragma clang fp contract(off)
        const wp::int64 root_half = 0x3FE6A09E667F3BCDll;
        const wp::int64 bits = __builtin_bit_cast(wp::int64, x) - root_half;
        const double e = (double)(bits >> 52);
        const double f = __builtin_bit_cast(double, (bits & 0x000FFFFFFFFFFFFFll) + root_half) - 1.0;
        const double s = f / (2.0 + f);
        const double z = s * s;
        double r = 0.14616449685043406;
        r = r * z + 0.15331721600556042;
        r = r * z + 0.18182889125261723;
        r = r * z + 0.2222221113479508;
        r = r * z + 0.28571428625975487;
        r = r * z + 0.39999999999899505;
        r = r * z + 0.666666666666667;
        const double half = 0.5 * f * f;
        // ln 2 in two parts, the first short enough for an exact product with e.
        return e * 0.6931467056274414 - ((half - (s * (half + r * z) + e * 4.7493250390316726e-07)) - f);
    };
"""
EXP = """
    // To 3e-9 of its size, which is enough for a band.
    const auto exp_of = [](double x) {
        const double e = __builtin_rint(x * 1.4426950408889634);
        const double f = x - e * 0.6931471805599453;
        double p = 0.0013941108433972674;
        p = p * f + 0.008375126398153335;
        p = p * f + 0.04166635289677516;
        p = p * f + 0.16666415514653277;
        p = p * f + 0.5000000047117757;
        p = p * f + 1.000000037716214;
        p = p * f + 1.0;
        return p * __builtin_bit_cast(double, ((wp::int64)e + 1023) << 52);
    };
"""
CROSS = """
    const double dark = sensor.dark;
    const double floor = sensor.floor;
    const double c_on = sensor.threshold_on;
    const double c_off = sensor.threshold_off;
    const double reach_on = sensor.gain_on * (1.0 - GUARD);
    const double reach_off = sensor.gain_off * (1.0 + GUARD);
    const double least = dark > 0.0 ? 0.0 : SMALLEST;
    const double length = (double)span;
    const wp::int64 channels = sensor.channels;
    const wp::int64 row = sensor.width * channels;
    const double per_row = 1.0 / row;
    const double per_channel = 1.0 / channels;
    const int shift_x = (int)sensor.shift_x;
    const int shift_y = (int)sensor.shift_y;
    const float* lows = bands.low.data + index;
    const float* highs = bands.high.data + index;
    const auto* levels = bands.level.data + index;
    wp::int64 total = 0;
    wp::int64 bad = 0;
    wp::int64 clipped = 0;
#pragma clang loop vectorize(assume_safety) vectorize_width(8)
    for (int i = 0; i < n; i++) {
#pragma clang fp contract(off)
        const int place = work.place.data[i];
        const float v = work.after.data[i];
        const double seen = v + dark;
        const bool good = v >= 0.0f && v <= LARGEST && seen > 0.0;
        const bool fresh = lows[place] > LARGEST;
        const double l0 = log_of(__builtin_fmax(work.before.data[i] + dark, floor));
        const double l1 = log_of(good ? __builtin_fmax(seen, floor) : 1.0);
        const double base = levels[place].base;
        const int net = levels[place].net;
        const int n_off = levels[place].n_off;
        const double reference = base + net * c_on + n_off * (c_on - c_off);
        const double delta = l1 - reference;
        const bool on = delta > 0.0;
        const double c = on ? c_on : c_off;
        const double threshold = on ? c_on : -c_off;
        const int count = good && !fresh ? (int)((__builtin_fabs(delta) + TOLERANCE) / c) : 0;
        work.reference.data[i] = reference;
        work.threshold.data[i] = threshold;
        work.origin.data[i] = l0;
        work.slope.data[i] = length / (l1 - l0);
        work.count.data[i] = count;
        // Divisions of whole numbers: no product of float64 comes near enough to the next one.
        const wp::int64 inner = first + place;
        const wp::int64 y = (wp::int64)((inner + 0.5) * per_row);
        const wp::int64 column = inner - y * row;
        const wp::int64 x = (wp::int64)((column + 0.5) * per_channel);
        work.tail.data[i] = y << shift_y | x << shift_x | (column - x * channels) << 1 | on;
        const bool begins = good && fresh;
        const double light = exp_of(begins ? l1 : reference + count * threshold);
        const double bottom = light * reach_off;
        const double under = __builtin_fmin(__builtin_fmax(bottom - dark, 0.0), LARGEST);
        const double over = __builtin_fmin(light * reach_on - dark, LARGEST);
        work.base.data[i] = begins ? l1 : base;
        work.net.data[i] = begins ? 0 : on ? net + count : net - count;
        work.n_off.data[i] = begins ? 0 : on ? n_off : n_off + count;
        // Nothing lies below the floor, so a pixel resting on it is quiet.
        work.low.data[i] = good ? (float)(bottom <= floor ? least : under) : lows[place];
        work.high.data[i] = good ? (float)over : highs[place];
        total += count;
        bad += !good;
        clipped += good && seen < floor;
    }
    work.set_aside.data[0] = bad;
    work.set_aside.data[1] = clipped;
    return total;
"""


@wp.func_native(filled_in(LOG + EXP + CROSS, **CONSTANTS))
def cross_levels(
    sensor: Sensor, span: wp.int64, bands: Bands, index: wp.int32, first: wp.int32, n: wp.int32, work: Listed
) -> wp.int64:
    """What a step of `span` ns does to the n pixels that are listed; returns the number of events.

    first: the block's first pixel in its environment.
    """
    ...


COMMIT = """
    for (int i = 0; i < n; i++) {
        const int at = index + work.place.data[i];
        bands.low.data[at] = work.low.data[i];
        bands.high.data[at] = work.high.data[i];
        auto& level = bands.level.data[at];
        level.base = work.base.data[i];
        level.net = work.net.data[i];
        level.n_off = work.n_off.data[i];
    }
    counters.data[NONFINITE] += work.set_aside.data[0];
    counters.data[CLIPPED] += work.set_aside.data[1];
"""


@wp.func_native(filled_in(COMMIT, **CONSTANTS))
def commit(index: wp.int32, n: wp.int32, work: Listed, bands: Bands, counters: wp.array(dtype=wp.int64)):
    """The state after the step."""
    ...


EMIT = """
#pragma clang fp contract(off)
    typedef double doubles __attribute__((vector_size(64)));
    typedef wp::int64 longs __attribute__((vector_size(64)));
    const doubles number = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0};
    const doubles least = number - number + 1.0;
    const doubles most = number - number + (double)span;
    const int shift = (int)sensor.shift_t;
    wp::int64* out = (wp::int64*)keys + at;
    for (int i = 0; i < n; i++) {
        const int count = work.count.data[i];
        for (int j = 0; j < count; j += 8) {
            doubles ns = most;
            if (!stamped) {
                // L is linear inside the step: t = t0 + (L_j - L_0) / (L_1 - L_0) (t1 - t0), to the nearest ns.
                const doubles level = work.reference.data[i] + (number + (double)j) * work.threshold.data[i];
                ns = (level - work.origin.data[i]) * work.slope.data[i] + 0.5;
                ns = ns > least ? ns : least;
                ns = ns < most ? ns : most;
            }
            const longs key = __builtin_convertvector(ns, longs) << shift | work.tail.data[i];
            memcpy(out + j, &key, sizeof(key));
        }
        out += count;
    }
"""


@wp.func_native(EMIT)
def emit_listed(
    sensor: Sensor, span: wp.int64, stamped: wp.bool, n: wp.int32, work: Listed, keys: wp.uint64, at: wp.int64
):
    """Keys of the events, with their time from the step's start, to the address `keys`, from place `at` on.

    Up to SPARE - 1 places beyond them are overwritten. stamped: events are at the step's end.
    """
    ...


KEEP = """
    const float* v = luminance.data + at;
    const float* lows = bands.low.data + index;
    const float* highs = bands.high.data + index;
    float* lasts = bands.last.data + index;
    bool all = true;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < size; i++) {
        const bool quiet = v[i] >= lows[i] && v[i] <= highs[i];
        lasts[i] = quiet ? v[i] : lasts[i];
        all &= quiet;
    }
    for (int i = 0; i < size && !all; i++)
        for (int back = 0; back < count && !(v[i] >= lows[i] && v[i] <= highs[i]); back++)
            if (valid(v[i - back * stride])) {
                lasts[i] = v[i - back * stride];
                break;
            }
"""


@wp.func_native(filled_in(VALID + KEEP, **CONSTANTS))
def keep_last(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, count: wp.int32,
    index: wp.int32, size: wp.int32, bands: Bands,
):  # fmt: skip
    """The last good samples of a block, whose first pixel is at `at` in the last of `count` frames."""
    ...
