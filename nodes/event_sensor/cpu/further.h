#pragma once
#include "../model/constants.h"
#include "ideal_simd.h"
#include "logarithm.h"

// Takes the pixels from `inner` on that have further samples through a message, each in the order of its samples' time.
// Returns the first that finds no room for its events, which is left as it was, or the number of pixels.
//
// Samples go by in runs: their logarithms together, then one after the other against the thresholds themselves, so that
// no inactive range is needed but the one that is left at the end.
static const auto walk_further = [](const auto& sensor, const auto& luminance, const auto& t, wp::int64 t_base,
    const auto& first, const auto& offset, const auto& value, int shared, const auto& state, int env, int inner,
    const auto& keys, const auto& counters) {
#pragma clang fp contract(off)
    constexpr int RUN = 64;
    const double dark = sensor.dark_level;
    const double floor = sensor.floor;
    const double c_on = sensor.threshold_on;
    const double c_off = sensor.threshold_off;
    const double reach_on = sensor.gain_on * (1.0 - GUARD);
    const double reach_off = sensor.gain_off * (1.0 + GUARD);
    const double least = dark > 0.0 ? 0.0 : SMALLEST;
    const int channels = sensor.channels;
    const int row = sensor.width * channels;
    const int size = sensor.height * row;
    const int frames = t.shape[0];
    const int shift = (int)sensor.shift_t;
    const wp::int64 head = (wp::int64)env << sensor.shift_env;
    const int* firsts = first.data;
    const int* offsets = offset.data;
    const wp::int64* stamps = t.data;
    wp::int64 slot = counters.data[EVENTS];
    wp::int64 bad = 0;
    wp::int64 clipped = 0;
    float light[RUN];
    double level[RUN];
    wp::int64 when[RUN];
    for (; inner < size; inner++) {
        const int index = env * size + inner;
        const int list = shared == 1 ? index : index / shared;
        int i = firsts[list];
        const int end = firsts[list + 1];
        if (i == end) continue;
        const float* further = value.data + index % shared;
        const float* frame = luminance.data + (wp::int64)env * frames * size + inner;
        float low = state.low.data[index];
        float high = state.high.data[index];
        double base = state.level.data[index].base;
        int net = state.level.data[index].net;
        int n_off = state.level.data[index].n_off;
        const int y = inner / row;
        const int column = inner - y * row;
        const wp::int64 place = head | (wp::int64)y << sensor.shift_y | (wp::int64)(column / channels) << sensor.shift_x |
            column % channels << 1;
        const auto light_range = [&](double reference) {
            const double around = exp_of(reference);
            const double bottom = around * reach_off;
            const double under = __builtin_fmin(__builtin_fmax(bottom - dark, 0.0), LARGEST);
            low = (float)(bottom <= floor ? least : under);
            high = (float)__builtin_fmin(around * reach_on - dark, LARGEST);
        };
        bool begun = low <= LARGEST;  // has a reference
        bool moved = false;
        wp::int64 here = slot;
        wp::int64 bad_here = 0;
        wp::int64 clipped_here = 0;
        wp::int64 start = 0;
        double reference = base + net * c_on + n_off * (c_on - c_off);
        float last = state.last.data[index];
        double earlier = log_of(__builtin_fmax(last + dark, floor));
        for (int k = 0; k < frames;) {
            int run = 0;
            for (; run < RUN && k < frames; run++) {
                const wp::int64 stamp = stamps[k] - t_base;
                const bool between = i < end && offsets[i] < stamp;
                when[run] = between ? offsets[i] : stamp;
                light[run] = between ? further[(wp::int64)i * shared] : *frame;
                i += between;
                k += !between;
                frame += between ? 0 : size;
            }
#pragma clang loop vectorize(assume_safety)
            for (int j = 0; j < run; j++) {
                const double seen = light[j] + dark;
                const bool good = light[j] >= 0.0f && light[j] <= LARGEST && seen > 0.0;
                level[j] = log_of(good ? __builtin_fmax(seen, floor) : 1.0);
            }
            for (int j = 0; j < run; j++) {
                const wp::int64 before = start;
                start = when[j];
                if (__builtin_expect(!has_level(light[j], dark), 0)) {
                    // The last good value is held, so the next step starts here.
                    bad_here++;
                    continue;
                }
                if (__builtin_expect(light[j] + dark < floor, 0)) {
                    if (begun && moved) light_range(reference);
                    clipped_here += !(begun && light[j] >= low && light[j] <= high);
                }
                const double l1 = level[j];
                const double l0 = earlier;
                earlier = l1;
                last = light[j];
                if (__builtin_expect(!begun, 0)) {
                    base = reference = l1;
                    net = n_off = 0;
                    begun = moved = true;
                    continue;
                }
                const double delta = l1 - reference;
                const bool on = delta > 0.0;
                const double c = on ? c_on : c_off;
                const double reached = __builtin_fabs(delta) + TOLERANCE;
                if (reached < c) continue;
                const double threshold = on ? c_on : -c_off;
                const int count = (int)(reached / c);
                if (here + count > sensor.capacity) {
                    counters.data[EVENTS] = slot;
                    counters.data[NONFINITE] += bad;
                    counters.data[CLIPPED] += clipped;
                    return inner;
                }
                const double span = (double)(start - before);
                const double slope = span / (l1 - l0);
                for (int m = 1; m <= count; m++) {
                    double ns = (reference + (double)m * threshold - l0) * slope + 0.5;
                    ns = ns > 1.0 ? ns : 1.0;
                    ns = ns < span ? ns : span;
                    keys.data[here++] = (before + (wp::int64)ns) << shift | place | on;
                }
                net += on ? count : -count;
                n_off += on ? 0 : count;
                reference = base + net * c_on + n_off * (c_on - c_off);
                moved = true;
            }
        }
        if (moved) light_range(reference);
        state.last.data[index] = last;
        state.low.data[index] = low;
        state.high.data[index] = high;
        state.level.data[index].base = base;
        state.level.data[index].net = net;
        state.level.data[index].n_off = n_off;
        slot = here;
        bad += bad_here;
        clipped += clipped_here;
    }
    counters.data[EVENTS] = slot;
    counters.data[NONFINITE] += bad;
    counters.data[CLIPPED] += clipped;
    return inner;
};

// Merges n sorted keys into the `count` sorted keys of a list, which has room for them.
static const auto merge_sorted = [](const auto& more, wp::int64 n, wp::int64 count, const auto& keys) {
    typedef wp::int64 longs __attribute__((vector_size(64)));
    const wp::int64* source = more.data;
    wp::int64* list = keys.data;
    wp::int64 left = count;
    for (wp::int64 b = n - 1; b >= 0; b--) {
        // The keys of the list above this one, in strides that grow, then by halves.
        const wp::int64 key = source[b];
        wp::int64 above = left;
        wp::int64 stride = 1;
        while (above - stride >= 0 && list[above - stride] > key) {
            above -= stride;
            stride *= 2;
        }
        wp::int64 below = above - stride >= 0 ? above - stride : -1;
        while (above - below > 1) {
            const wp::int64 middle = (above + below) / 2;
            const bool higher = list[middle] > key;
            above = higher ? middle : above;
            below = higher ? below : middle;
        }
        // From the top down, eight at a time: what is written over has been read.
        wp::int64 from = left;
        for (; from - 8 >= above; from -= 8) {
            longs eight;
            memcpy(&eight, list + from - 8, sizeof(eight));
            memcpy(list + from - 8 + b + 1, &eight, sizeof(eight));
        }
        for (; from > above; from--) list[from + b] = list[from - 1];
        list[above + b] = key;
        left = above;
    }
};
