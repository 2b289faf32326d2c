#pragma once
#include "warp/native/builtin.h"

// Gives what sky_kernels.specular_means_by_sample gives, RUN samples at a time, of which there is a multiple of RUN. Two neighbouring
// texels are read as RUN numbers, so two numbers must follow the last texel. A place is held to the texels of its level
// before it becomes a whole number, for a direction may be no number.
static const auto specular_means = [](const auto& points, const auto& levels, const auto& texels, const auto& to_world,
    const auto& view, float alpha, float held, const auto& stretched, float widest) {
    constexpr int RUN = 8;
    constexpr float PI = 3.14159265f;
    typedef float floats __attribute__((ext_vector_type(RUN), aligned(4)));
    typedef int ints __attribute__((ext_vector_type(RUN), aligned(4)));
    // Of a number and no number both give b.
    const auto least = [](floats a, floats b) -> floats { return a < b ? a : b; };
    const auto most = [](floats a, floats b) -> floats { return a > b ? a : b; };
    const auto root = [](floats a) -> floats { return __builtin_elementwise_sqrt(a); };
    const auto whole = [](floats a) -> ints { return __builtin_convertvector(a, ints); };
    const auto real = [](ints a) -> floats { return __builtin_convertvector(a, floats); };
    // As sky_kernels.arctangent.
    const auto arctangent = [&](floats y, floats x) -> floats {
        const floats across = __builtin_elementwise_abs(x);
        const floats t = least(y, across) / most(most(y, across), 1.0e-30f);
        const floats s = t * t;
        floats p = -0.0161657367f + s * 0.0028662257f;
        p = -0.0752896400f + s * (0.0429096138f + s * p);
        p = -0.1420889944f + s * (0.1065626393f + s * p);
        const floats low = t * (1.0f + s * (-0.3333314528f + s * (0.1999355085f + s * p)));
        const floats angle = y > across ? 0.5f * PI - low : low;
        return x < 0.0f ? PI - angle : angle;
    };
    // log2 of a number > 0, to 1e-7 beside its rounding: its exponent, and a series where it is within sqrt(2) of 1.
    const auto logarithm = [&](floats number) -> floats {
        ints bits;
        __builtin_memcpy(&bits, &number, sizeof(bits));
        const ints beyond = bits - 0x3f3504f3;
        bits -= beyond & -0x800000;
        floats rest;
        __builtin_memcpy(&rest, &bits, sizeof(rest));
        const floats s = (rest - 1.0f) / (rest + 1.0f), ss = s * s;
        return real(beyond >> 23) + s * (2.88539008f + ss * (0.96179669f + ss * (0.57707802f + ss * 0.41219858f)));
    };
    const int count = points.shape[1], top = levels.shape[0] - 2;
    const int width = levels.data[0][1], height = levels.data[0][2];
    const float* numbers = points.data;
    const float a = alpha * alpha, along = view[0], up = view[1];
    const float shadow = __builtin_sqrtf(held * held * (1.0f - a) + a);
    floats base = 0.0f, rim = 0.0f, base_weight = 0.0f, rim_weight = 0.0f;
    for (int from = 0; from + RUN <= count; from += RUN) {
        const floats cosine = *(const floats*)(numbers + from), sine = *(const floats*)(numbers + count + from);
        const floats z = *(const floats*)(numbers + 2 * count + from) * (1.0f + stretched[2]) - stretched[2];
        const floats r = root(most(1.0f - z * z, 0.0f));
        const floats cap[3] = { r * cosine + stretched[0], r * sine + stretched[1], z + stretched[2] };
        const floats h[3] = { alpha * cap[0], alpha * cap[1], most(cap[2], 0.0f) };
        const floats hh = h[0] * h[0] + h[1] * h[1] + h[2] * h[2];
        const floats vh = along * h[0] + up * h[2];
        const floats twice = 2.0f * vh / hh;
        const floats l[3] = { twice * h[0] - along, twice * h[1], twice * h[2] - up };
        const ints seen = l[2] > 0.0f;
        const floats masked = 0.5f * l[2] / (l[2] * shadow + held * root(l[2] * l[2] * (1.0f - a) + a));
        const floats weight = seen ? masked : 0.0f;
        const floats m = least(most(1.0f - vh / root(hh), 0.0f), 1.0f);
        const floats glancing = weight * (m * m * m * m * m), straight = weight - glancing;
        base_weight += straight;
        rim_weight += glancing;
        floats world[3];
        for (int axis = 0; axis < 3; ++axis)
            world[axis] = to_world.data[axis][0] * l[0] + to_world.data[axis][1] * l[1] + to_world.data[axis][2] * l[2];
        const floats turn = arctangent(__builtin_elementwise_abs(world[1]), world[0]) * (0.5f / PI);
        const floats azimuth = world[1] < 0.0f ? -turn : turn;
        const floats polar = arctangent(root(world[0] * world[0] + world[1] * world[1]), world[2]) / PI;
        const floats narrow = hh / (cap[0] * cap[0] + cap[1] * cap[1] + cap[2] * cap[2]);
        const floats place = least(most(widest - logarithm(most(narrow, 1.0e-30f)), 0.0f), (float)top);
        const ints low = whole(place);
        const floats beyond = place - real(low);
        // Where the four texels of a sample are in both levels, and the weights of their rows and columns: in memory,
        // since one number of a register is slower to come by.
        int level[2][RUN], at[2][RUN], stride[2][RUN];
        float left[2][RUN], right[2][RUN], upper[2][RUN], lower[2][RUN];
        for (int n = 0; n < 2; ++n) {
            const ints there = low + n < top ? low + n : top;
            const ints w = (ints)(width) >> there, h = (ints)(height) >> there, half = w >> 1;
            const floats x = azimuth * real(w) - 0.5f, y = polar * real(h) - 0.5f;
            const floats i = least(most(__builtin_elementwise_floor(x), real(-half - 1)), real(w - half - 1));
            const floats j = least(most(__builtin_elementwise_floor(y), -1.0f), real(h - 1));
            const floats part = n == 0 ? 1.0f - beyond : beyond;
            *(ints*)level[n] = there;
            *(ints*)stride[n] = w + 2;
            *(ints*)at[n] = (whole(j) + 1) * (w + 2) + whole(i) + half + 1;
            *(floats*)left[n] = part * (1.0f - (x - i));
            *(floats*)right[n] = part * (x - i);
            *(floats*)upper[n] = 1.0f - (y - j);
            *(floats*)lower[n] = y - j;
        }
        for (int k = 0; k < RUN; ++k) {
            if (!seen[k])
                continue;
            floats colour = 0.0f;
            for (int n = 0; n < 2; ++n) {
                const wp::vec3* corner = texels.data + levels.data[level[n][k]][0] + at[n][k];
                const floats columns = *(const floats*)corner * upper[n][k]
                    + *(const floats*)(corner + stride[n][k]) * lower[n][k];
                const float first = left[n][k], next = right[n][k];
                const floats share = { first, first, first, next, next, next, 0.0f, 0.0f };
                colour += columns * share;
            }
            base += straight[k] * colour;
            rim += glancing[k] * colour;
        }
    }
    float base_whole = 0.0f, rim_whole = 0.0f;
    for (int k = 0; k < RUN; ++k) {
        base_whole += base_weight[k];
        rim_whole += rim_weight[k];
    }
    wp::mat_t<2, 3, float> found(0.0f);
    for (int c = 0; c < 3; ++c) {
        if (base_whole > 0.0f)
            found.data[0][c] = (base[c] + base[c + 3]) / base_whole;
        if (rim_whole > 0.0f)
            found.data[1][c] = (rim[c] + rim[c + 3]) / rim_whole;
    }
    return found;
};
