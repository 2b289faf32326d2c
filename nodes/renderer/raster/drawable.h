#pragma once
#include "warp/native/builtin.h"

// Gives which of the triangles first .. last - 1, 64 at most, may cover a pixel of rows row0 .. row1 - 1 through a
// pinhole, a bit for each, RUN at a time: what faces the camera before the near plane, unless its box, a little wider
// than bounds_kernels.bounds, holds no pixel centre.
static const auto drawable = [](const auto& view, int row0, int row1, const auto& vertices, const auto& triangles,
    int env, int first, int last, bool two_sided) -> wp::uint64 {
    constexpr int RUN = 8;
    constexpr float WIDER = 0.02f;
    typedef float floats __attribute__((ext_vector_type(RUN)));
    typedef int ints __attribute__((ext_vector_type(RUN)));
    const wp::vec3* corners = &wp::index(vertices, env, 0);
    const float x_centre = view.cx + (float)view.margin, y_centre = view.cy + (float)view.margin;
    const float right = (float)(view.width - 1), top = (float)row0, bottom = (float)(row1 - 1);
    wp::uint64 found = 0;
    for (int from = first; from < last; from += RUN) {
        floats p[3][3];
        for (int n = 0; n < RUN; ++n) {
            const wp::vec3i& k = triangles.data[from + n < last ? from + n : last - 1];
            for (int c = 0; c < 3; ++c)
                for (int axis = 0; axis < 3; ++axis)
                    p[c][axis][n] = corners[k[c]][axis];
        }
        floats ab[3], ac[3];
        for (int axis = 0; axis < 3; ++axis) {
            ab[axis] = p[1][axis] - p[0][axis];
            ac[axis] = p[2][axis] - p[0][axis];
        }
        const floats offset = (ab[1] * ac[2] - ab[2] * ac[1]) * p[0][0] + (ab[2] * ac[0] - ab[0] * ac[2]) * p[0][1]
            + (ab[0] * ac[1] - ab[1] * ac[0]) * p[0][2];
        ints kept = two_sided ? offset != 0.0f : offset < 0.0f;
        ints before = 0, whole = -1;
        floats x_min = 1.0e9f, x_max = -1.0e9f, y_min = 1.0e9f, y_max = -1.0e9f;
        for (int c = 0; c < 3; ++c) {
            const ints there = p[c][2] >= view.near;
            before |= there;
            whole &= there;
            const floats nearness = 1.0f / p[c][2];
            const floats x = view.fx * p[c][0] * nearness + x_centre, y = view.fy * p[c][1] * nearness + y_centre;
            x_min = x < x_min ? x : x_min;
            x_max = x > x_max ? x : x_max;
            y_min = y < y_min ? y : y_min;
            y_max = y > y_max ? y : y_max;
        }
        x_min = __builtin_elementwise_ceil(x_min - WIDER);
        x_max = __builtin_elementwise_floor(x_max + WIDER);
        y_min = __builtin_elementwise_ceil(y_min - WIDER);
        y_max = __builtin_elementwise_floor(y_max + WIDER);
        const ints empty = (x_min > x_max) | (y_min > y_max) | (x_max < 0.0f) | (x_min > right) | (y_max < top)
            | (y_min > bottom);
        kept &= before & ~(whole & empty);
        for (int n = 0; n < RUN && from + n < last; ++n)
            found |= (wp::uint64)(kept[n] & 1) << (from - first + n);
    }
    return found;
};
