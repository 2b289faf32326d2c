#pragma once
#include "../model/constants.h"
#include "logarithm.h"

// Computes exp x to 3e-9 of its size, which is enough for the limits of a range.
static const auto exp_of = [](double x) {
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

// Tells whether L = ln(v + dark) is finite.
static const auto has_level = [](float v, double dark) { return v >= 0.0f && v <= LARGEST && v + dark > 0.0; };

// Lists the pixels of a block whose sample is outside of their inactive range; returns how many there are.
static const auto list_active = [](const auto& luminance, wp::int64 at, wp::int64 ahead, const auto& state, int index,
    int size, const auto& work) {
    typedef float floats __attribute__((vector_size(64)));
    typedef bool flags __attribute__((ext_vector_type(16)));
    const float* v = luminance.data + at;
    const float* lows = state.low.data + index;
    const float* highs = state.high.data + index;
    int* place = work.place.data;
    int n = 0;
    int i = 0;
    for (; i + 16 <= size; i += 16) {
        __builtin_prefetch(v + ahead + i, 0, 2);
        floats sample, low, high;
        memcpy(&sample, v + i, sizeof(sample));
        memcpy(&low, lows + i, sizeof(low));
        memcpy(&high, highs + i, sizeof(high));
        const flags inside = __builtin_convertvector((sample >= low) & (sample <= high), flags);
        unsigned short bits;
        memcpy(&bits, &inside, sizeof(bits));
        for (unsigned active = 0xFFFFu & ~bits; active != 0; active &= active - 1) place[n++] = i + __builtin_ctz(active);
    }
    for (; i < size; i++)
        if (!(v[i] >= lows[i] && v[i] <= highs[i])) place[n++] = i;
    return n;
};

// Takes the samples at both ends of step k of the listed pixels; the last good one stands for one that is not.
static const auto take_samples = [](const auto& sensor, const auto& luminance, wp::int64 at, wp::int64 stride,
    wp::int64 k, const auto& state, int index, int n, const auto& work) {
    const float* v = luminance.data + at;
    const float* earlier = k > 0 ? v - stride : state.last.data + index;
    for (int i = 0; i < n; i++) {
        const int place = work.place.data[i];
        float before = earlier[place];
        for (int back = 2; __builtin_expect(!has_level(before, sensor.dark_level) && back <= k + 1, 0); back++)
            before = back <= k ? v[place - back * stride] : state.last.data[index + place];
        work.before.data[i] = before;
        work.after.data[i] = v[place];
    }
};

// Finds the thresholds that the listed pixels cross in a step of `span` ns; returns the number of events.
static const auto cross_levels = [](const auto& sensor, wp::int64 span, const auto& state, int index, int first,
    int n, const auto& work) {
    const double dark = sensor.dark_level;
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
    const float* lows = state.low.data + index;
    const float* highs = state.high.data + index;
    const auto* levels = state.level.data + index;
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
        // Nothing lies below the floor, so a pixel resting on it is inside.
        work.low.data[i] = good ? (float)(bottom <= floor ? least : under) : lows[place];
        work.high.data[i] = good ? (float)over : highs[place];
        total += count;
        bad += !good;
        clipped += good && seen < floor;
    }
    work.set_aside.data[0] = bad;
    work.set_aside.data[1] = clipped;
    return total;
};

// Writes the state after the step.
static const auto commit = [](int index, int n, const auto& work, const auto& state, const auto& counters) {
    for (int i = 0; i < n; i++) {
        const int at = index + work.place.data[i];
        state.low.data[at] = work.low.data[i];
        state.high.data[at] = work.high.data[i];
        auto& level = state.level.data[at];
        level.base = work.base.data[i];
        level.net = work.net.data[i];
        level.n_off = work.n_off.data[i];
    }
    counters.data[NONFINITE] += work.set_aside.data[0];
    counters.data[CLIPPED] += work.set_aside.data[1];
};

// Writes the keys of the listed pixels' events, with their time from the step's start, from address `keys` on.
static const auto emit_listed = [](const auto& sensor, wp::int64 span, bool stamped, int n, const auto& work,
    wp::uint64 keys, wp::int64 at) {
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
};

// Keeps the last good sample of every pixel of a block.
static const auto keep_last = [](const auto& sensor, const auto& luminance, wp::int64 at, wp::int64 stride, int count,
    int index, int size, const auto& state) {
    const float* v = luminance.data + at;
    const float* lows = state.low.data + index;
    const float* highs = state.high.data + index;
    float* lasts = state.last.data + index;
    bool all = true;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < size; i++) {
        const bool inside = v[i] >= lows[i] && v[i] <= highs[i];
        lasts[i] = inside ? v[i] : lasts[i];
        all &= inside;
    }
    for (int i = 0; i < size && !all; i++)
        for (int back = 0; back < count && !(v[i] >= lows[i] && v[i] <= highs[i]); back++)
            if (has_level(v[i - back * stride], sensor.dark_level)) {
                lasts[i] = v[i - back * stride];
                break;
            }
};

// Takes those with further samples out of the n listed pixels; returns how many are left.
static const auto leave_further = [](const auto& first, int shared, int index, int n, const auto& work) {
    int* place = work.place.data;
    int left = 0;
    for (int i = 0; i < n; i++) {
        const int list = shared == 1 ? index + place[i] : (index + place[i]) / shared;
        place[left] = place[i];
        left += first.data[list] == first.data[list + 1];
    }
    return left;
};

// Keeps the last good sample of every pixel of a block that has no further samples.
static const auto keep_last_of_others = [](const auto& sensor, const auto& luminance, wp::int64 at, wp::int64 stride,
    int count, int index, int size, const auto& first, int shared, const auto& state, const auto& work) {
    float* lasts = state.last.data + index;
    memcpy(work.before.data, lasts, size * sizeof(float));
    keep_last(sensor, luminance, at, stride, count, index, size, state);
    const float* before = work.before.data;
    if (shared == 1) {
        const int* firsts = first.data + index;
#pragma clang loop vectorize(assume_safety)
        for (int i = 0; i < size; i++) lasts[i] = firsts[i] == firsts[i + 1] ? lasts[i] : before[i];
        return;
    }
    for (int i = 0; i < size; i++) {
        const int list = (index + i) / shared;
        lasts[i] = first.data[list] == first.data[list + 1] ? lasts[i] : before[i];
    }
};
