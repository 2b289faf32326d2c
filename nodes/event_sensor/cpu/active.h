#pragma once
#include "warp/native/builtin.h"

// Lists the pixels of a row whose samples leave their inactive range, that wake by `t_end` or that have further samples;
// the others keep their last sample.
static const auto list_active_row = [](const auto& luminance, wp::int64 at, wp::int64 stride, int count,
    wp::int64 t_end, const auto& state, int index, int row, const auto& rare, const auto& first,
    int shared, const auto& active) {
    typedef float floats __attribute__((vector_size(64)));
    typedef int ints __attribute__((vector_size(64)));
    typedef wp::int64 longs __attribute__((vector_size(128)));
    typedef bool flags __attribute__((ext_vector_type(16)));
    const float* v = luminance.data + at;
    const float* lows = state.low.data + index;
    const float* highs = state.high.data + index;
    float* lasts = state.last.data + index;
    const bool timed = state.wake.shape[0] > 0;
    const wp::int64* wakes = timed ? state.wake.data + index : nullptr;
    const bool apart = first.shape[0] > 0;
    const wp::int64 end = (wp::int64)(count - 1) * stride;
    int* list = active.data + 1;
    int n = 0;
    const auto step = [&](int i, int many) __attribute__((always_inline)) {
        floats low = {}, high = {}, last = {}, sample = {};
        memcpy(&low, lows + i, many * sizeof(float));
        memcpy(&high, highs + i, many * sizeof(float));
        memcpy(&last, lasts + i, many * sizeof(float));
        ints stays = low == low;
        for (wp::int64 k = 0; k <= end; k += stride) {
            memcpy(&sample, v + k + i, many * sizeof(float));
            stays &= (sample >= low) & (sample <= high);
        }
        if (apart) {
            ints none = {};
            for (int lane = 0; lane < many; lane++) {
                const int list = (index + i + lane) / shared;
                none[lane] = -(first.data[list] == first.data[list + 1]);
            }
            stays &= none;
        }
        flags still = __builtin_convertvector(stays, flags);
        if (timed) {
            longs wake = {};
            memcpy(&wake, wakes + i, many * sizeof(wp::int64));
            still &= __builtin_convertvector(wake > t_end, flags);
        }
        last = __builtin_convertvector(still, ints) != 0 ? sample : last;
        memcpy(lasts + i, &last, many * sizeof(float));
        unsigned short bits;
        memcpy(&bits, &still, sizeof(bits));
        for (unsigned left = ~(unsigned)bits & (0xFFFFu >> (16 - many)); left != 0; left &= left - 1) {
            const int place = i + __builtin_ctz(left);
            // What is kept of the pixel can be on its way.
            __builtin_prefetch(rare.data + index + place, 1, 3);
            list[n++] = place;
        }
    };
    int i = 0;
    for (; i + 16 <= row; i += 16) step(i, 16);
    if (i < row) step(i, row - i);
    active.data[0] = n;
};
