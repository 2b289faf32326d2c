#pragma once
#include "warp/native/builtin.h"

// Filters samples margin to end of a row along x, which need no clamp, 16 at a time.
static const auto filter_runs = [](const auto& weights, const auto& image, int start, int channels, int margin,
    int end, int to, const auto& rows) {
    typedef float run __attribute__((ext_vector_type(16), aligned(4)));
    const float* weight = weights.data;
    const int taps = weights.shape[0];
    for (int first = margin; first < end; first += 16) {
        const int i = first < end - 16 ? first : end - 16;
        const float* here = image.data + start + i;
        run total = weight[0] * *(const run*)here;
        for (int j = 1; j < taps; ++j)
            total += weight[j] * (*(const run*)(here - j * channels) + *(const run*)(here + j * channels));
        *(run*)(rows.data + to + i) = total;
    }
};

// Filters a row along y, from the ring of rows filtered along x.
static const auto blend_rows = [](const auto& weights, const auto& rows, int y, int height, int ring, int row,
    int out, const auto& blurred) {
    typedef float run __attribute__((ext_vector_type(16), aligned(4)));
    const float* weight = weights.data;
    const int taps = weights.shape[0];
    const float* here = rows.data + y % ring * row;
    for (int first = 0; first < row; first += 64) {
        const int stop = first + 64 < row ? first + 64 : row;
        run total[4];
        int count = 0;
        for (int at = first; at < stop; at += 16)
            total[count++] = weight[0] * *(const run*)(here + (at < row - 16 ? at : row - 16));
        for (int j = 1; j < taps; ++j) {
            const float* above = rows.data + (y < j ? 0 : y - j) % ring * row;
            const float* below = rows.data + (y + j < height ? y + j : height - 1) % ring * row;
            int n = 0;
            for (int at = first; at < stop; at += 16, ++n) {
                const int i = at < row - 16 ? at : row - 16;
                total[n] += weight[j] * (*(const run*)(above + i) + *(const run*)(below + i));
            }
        }
        int n = 0;
        for (int at = first; at < stop; at += 16, ++n)
            *(run*)(blurred.data + out + (at < row - 16 ? at : row - 16)) = total[n];
    }
};
