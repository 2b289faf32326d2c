#pragma once
#include "../model/constants.h"
#include "ideal_simd.h"
#include "logarithm.h"

// Takes the pixels from `inner` on that have further samples through a message, each in the order of its samples' time.
// Returns the first that finds no room for its events, which is left as it was, or the number of pixels.
static const auto walk_further = [](const auto& sensor, const auto& luminance, const auto& t, wp::int64 t_base,
    const auto& first, const auto& offset, const auto& value, int shared, const auto& state, int env, int inner,
    const auto& keys, const auto& counters) {
#pragma clang fp contract(off)
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
    for (; inner < size; inner++) {
        const int index = env * size + inner;
        const int list = index / shared;
        int i = firsts[list];
        const int end = firsts[list + 1];
        if (i == end) continue;
        const float* further = value.data + index % shared;
        const float* frame = luminance.data + (wp::int64)env * frames * size + inner;
        float before = state.last.data[index];
        float low = state.low.data[index];
        float high = state.high.data[index];
        double base = state.level.data[index].base;
        int net = state.level.data[index].net;
        int n_off = state.level.data[index].n_off;
        const int y = inner / row;
        const int column = inner - y * row;
        const wp::int64 place = head | (wp::int64)y << sensor.shift_y | (wp::int64)(column / channels) << sensor.shift_x |
            column % channels << 1;
        const auto light_range = [&](double level) {
            const double light = exp_of(level);
            const double bottom = light * reach_off;
            const double under = __builtin_fmin(__builtin_fmax(bottom - dark, 0.0), LARGEST);
            low = (float)(bottom <= floor ? least : under);
            high = (float)__builtin_fmin(light * reach_on - dark, LARGEST);
        };
        wp::int64 here = slot;
        wp::int64 start = 0;
        wp::int64 bad_here = 0;
        wp::int64 clipped_here = 0;
        double earlier = 0.0;  // L of `before`, where it is known
        bool known = false;
        for (int k = 0; k < frames; k++, frame += size) {
            const wp::int64 stamp = stamps[k] - t_base;
            for (bool between = true; between;) {
                between = i < end && offsets[i] < stamp;
                const wp::int64 now = between ? offsets[i] : stamp;
                const float sample = between ? further[(wp::int64)i * shared] : *frame;
                const wp::int64 span = now - start;
                const wp::int64 begun = start;
                i += between;
                start = now;
                if (sample >= low && sample <= high) {
                    before = sample;
                    known = false;
                    continue;
                }
                if (!has_level(sample, dark)) {
                    bad_here++;
                    continue;
                }
                const double seen = sample + dark;
                const double l1 = log_of(__builtin_fmax(seen, floor));
                clipped_here += seen < floor;
                if (low > LARGEST) {
                    base = l1;
                    net = n_off = 0;
                    light_range(l1);
                } else {
                    const double l0 = known ? earlier : log_of(__builtin_fmax(before + dark, floor));
                    const double reference = base + net * c_on + n_off * (c_on - c_off);
                    const double delta = l1 - reference;
                    const bool on = delta > 0.0;
                    const double threshold = on ? c_on : -c_off;
                    const int count = (int)((__builtin_fabs(delta) + TOLERANCE) / (on ? c_on : c_off));
                    if (count > 0) {
                        if (here + count > sensor.capacity) {
                            counters.data[EVENTS] = slot;
                            counters.data[NONFINITE] += bad;
                            counters.data[CLIPPED] += clipped;
                            return inner;
                        }
                        const double slope = (double)span / (l1 - l0);
                        for (int j = 1; j <= count; j++) {
                            double ns = (reference + (double)j * threshold - l0) * slope + 0.5;
                            ns = ns > 1.0 ? ns : 1.0;
                            ns = ns < (double)span ? ns : (double)span;
                            keys.data[here++] = (begun + (wp::int64)ns) << shift | place | on;
                        }
                        net += on ? count : -count;
                        n_off += on ? 0 : count;
                        light_range(reference + count * threshold);
                    }
                }
                before = sample;
                earlier = l1;
                known = true;
            }
        }
        state.last.data[index] = before;
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
    const wp::int64* source = more.data;
    wp::int64* list = keys.data;
    wp::int64 a = count - 1;
    wp::int64 b = n - 1;
    for (wp::int64 to = count + n - 1; b >= 0; to--) {
        const bool own = a >= 0 && list[a] > source[b];
        list[to] = own ? list[a] : source[b];
        a -= own;
        b -= !own;
    }
};
