#pragma once
#include "warp/native/builtin.h"

// Writes the pixels of columns x0 .. x1 and rows y0 .. y1 that a triangle covers into the z-buffer, RUN of a row at a
// time, as triangle_kernels.cover does one by one, to the same bits. All of a run are in the image, which is at least
// so wide, and those beside x0 .. x1 stay as they are. plane: the triangle's offset, least and greatest depth.
static const auto cover_box = [](const auto& columns, const auto& rows, const auto& packed, int env, int x0, int x1,
    int y0, int y1, const auto& e0, const auto& e1, const auto& e2, const auto& slack, const auto& normal,
    const auto& plane, float near_z, int face) {
    constexpr int RUN = 8;
    typedef float floats __attribute__((ext_vector_type(RUN), aligned(4)));
    typedef int ints __attribute__((ext_vector_type(RUN), aligned(4)));
    typedef wp::uint32 words __attribute__((ext_vector_type(RUN), aligned(4)));
    typedef wp::int64 choices __attribute__((ext_vector_type(RUN), aligned(8)));
    typedef wp::uint64 entries __attribute__((ext_vector_type(RUN), aligned(8)));
    ints step;
    for (int n = 0; n < RUN; ++n)
        step[n] = n;
    const int last = packed.shape[2] - RUN;
    const wp::uint64 below = (wp::uint32)face;
    for (int y = y0; y <= y1; ++y) {
        const float dy = rows.data[y];
        const float s0 = e0[1] * dy + e0[2] + slack[0];
        const float s1 = e1[1] * dy + e1[2] + slack[1];
        const float s2 = e2[1] * dy + e2[2] + slack[2];
        const float s3 = normal[1] * dy + normal[2];
        wp::uint64* row = &wp::index(packed, env, y, 0);
        for (int at = x0; at <= x1; at += RUN) {
            const int x = at < last ? at : last;
            const floats dx = *(const floats*)(columns.data + x);
            const ints inside = (e0[0] * dx + s0 >= 0.0f) & (e1[0] * dx + s1 >= 0.0f) & (e2[0] * dx + s2 >= 0.0f)
                & (step >= x0 - x) & (step <= x1 - x);
            const floats z = plane[0] / (normal[0] * dx + s3);
            const floats least = z < plane[1] ? (floats)(plane[1]) : z;
            const floats held = least > plane[2] ? (floats)(plane[2]) : least;
            const choices covered = __builtin_convertvector(inside & (z >= near_z), choices);
            words depth;
            __builtin_memcpy(&depth, &held, sizeof(depth));
            const entries fresh = (__builtin_convertvector(depth, entries) << 32) | below;
            entries* there = (entries*)(row + x);
            *there = (covered & (fresh < *there)) ? fresh : *there;
        }
    }
};
