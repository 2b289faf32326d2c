#pragma once
#include "../model/constants.h"

// Filters one step of a block of pixels, 16 at a time; returns how many samples it lists in `place` and leaves alone.
static const auto step_block = [](const auto& receptor, const auto& luminance, wp::int64 at, wp::int64 ahead,
    int index, int size, double half, int halvings, double constant_d, double constant_f, const auto& last_sample,
    const auto& first_pole, const auto& second_pole, const auto& filtered, const auto& place, double chord,
    const auto& bent) {
    typedef double doubles __attribute__((vector_size(128)));
    typedef wp::int64 longs __attribute__((vector_size(128)));
    typedef float floats __attribute__((vector_size(64)));
    typedef int ints __attribute__((vector_size(64)));
    typedef bool flags __attribute__((ext_vector_type(16)));
    const auto bits = [](doubles x) { return (longs)x; };
    const auto number = [](longs x) { return (doubles)x; };
    const auto wide = [](floats x) { return __builtin_convertvector(x, doubles); };
    const auto narrow = [](doubles x) { return __builtin_convertvector(x, floats); };
    const auto mask_of = [](auto found) {
        const flags set = __builtin_convertvector(found, flags);
        unsigned short bits_set;
        memcpy(&bits_set, &set, sizeof(bits_set));
        return (unsigned)bits_set;
    };
    const doubles zero = {};
#if defined(__FMA__) || defined(__aarch64__)
    const auto fused = [](doubles a, doubles b, doubles c) { return __builtin_elementwise_fma(a, b, c); };
#else
    const auto fused = [](doubles a, doubles b, doubles c) { return a * b + c; };
#endif
    const auto fma = [&](doubles a, doubles b, auto c) { return fused(a, b, zero + c); };
    const double magic = 6755399441055744.0;  // 1.5 * 2^52 + n has n in its last bits
    // ln(a / b) = n ln 2 + 2 artanh(z), |z| < 0.201.
    const auto log_of_ratio = [&](doubles a, doubles b) {
        const longs n = (bits(a) - bits(b) + (1ll << 51)) >> 52;
        const doubles near = number(bits(a) - (n << 52));
        const doubles z = (near - b) / (near + b);
        const doubles w = z * z;
        doubles p = fma(zero + 0.2427519835662999, w, 0.2849352781156012);
        p = fma(p, w, 0.4000119466224084);
        p = fma(p, w, 0.6666666027892256);
        p = fma(p, w, 2.0000000000545515);
        const doubles whole = number(n + bits(zero + magic)) - magic;
        return fma(whole, zero + LN2, z * p);
    };
    // exp(x) - c = 2^m (exp(r) - 1) + 2^m - c, |r| <= ln 2 / 2; c is 1, or 0 where the 1 would hide exp(x).
    const auto exp_less = [&](doubles x, doubles c) {
        const doubles shifted = fma(x, zero + 1.4426950408889634, magic);
        const doubles r = fma(shifted - magic, zero - LN2, x);
        const doubles scale = number((bits(shifted) << 52) + (1023ll << 52));
        doubles q = fma(zero + 0.00019841356787150873, r, 0.0013941040873473253);
        q = fma(q, r, 0.00833340278370267);
        q = fma(q, r, 0.0416663539166566);
        q = fma(q, r, 0.16666666249590453);
        q = fma(q, r, 0.5000000046809947);
        q = fma(q, r, 1.0000000000312703);
        return fma(scale, r * q, scale - c);
    };
    const double dark = receptor.dark;
    const float least = dark < receptor.floor ? (float)(receptor.floor - dark) : 0.0f;
    const double slope = VARYING ? half / receptor.level : 0.0;
    const double doubled = (double)(1ll << halvings);
    const float* v = luminance.data + at;
    float* out = filtered.data + at;
    float* lasts = last_sample.data + index;
    double* firsts = first_pole.data + index;
    double* seconds = TWO ? second_pole.data + index : firsts;
    int listed = 0;
    const auto step = [&](int i, int many) __attribute__((always_inline)) {
        floats sample = {}, last = {};
        doubles e1 = {}, e2 = {};
        memcpy(&sample, v + i, many * sizeof(float));
        memcpy(&last, lasts + i, many * sizeof(float));
        memcpy(&e1, firsts + i, many * sizeof(double));
        if (TWO) memcpy(&e2, seconds + i, many * sizeof(double));
        if (mask_of((sample == last) & (last >= 0.0f)) == 0xFFFF) {
            const longs at_rest = TWO ? (e1 == 0.0) & (e2 == 0.0) : e1 == 0.0;
            if (mask_of(at_rest) == 0xFFFF) {
                memcpy(out + i, &sample, many * sizeof(float));
                return;
            }
        }
        const ints good_sample = (sample >= least) & (sample <= LARGEST) & (last >= least);
        const longs good = __builtin_convertvector(good_sample, longs);
        const doubles now = wide(sample), then = wide(last);
        const doubles level = now + dark, before = then + dark;
        const doubles grown = log_of_ratio(level, before);
        doubles f = zero + constant_f, d = zero + constant_d, a = zero + 2.0 * half;
        if (VARYING) {
            doubles x0 = before * slope, x1 = level * slope;
            if constexpr (POWERED) {
                // share^k = exp(k ln share), of a share below 1.
                const doubles white = zero + (double)receptor.level;
                const doubles power = zero + (double)receptor.exponent;
                const doubles s0 = log_of_ratio(before < white ? before : white, white);
                const doubles s1 = log_of_ratio(level < white ? level : white, white);
                x0 = fma(exp_less(power * s0, zero + 1.0), zero + half, half);
                x1 = fma(exp_less(power * s1, zero + 1.0), zero + half, half);
            }
            const doubles x = (x0 < half ? x0 : zero + half) + (x1 < half ? x1 : zero + half);
            f = fma(zero + 0.00015950258469507082, x, -0.0013629675199575155);
            f = fma(f, x, 0.008324581249129392);
            f = fma(f, x, -0.041665133771611136);
            f = fma(f, x, 0.16666653788211405);
            f = fma(f, x, -0.4999999959143334);
            f = fma(f, x, 0.9999999999786587);
            d = fma(-x, f, 1.0);
            for (int turn = 0; turn < halvings; turn++) {
                f = fma(f, d, f);
                d = d * d;
            }
            f = f * (1.0 / doubled);
            a = x * doubled;
        }
        if constexpr (BENDS) {
            // See trace_kernels: pixels whose output may lie further than `chord` from a line, or whose line has pieces.
            const auto size_of = [&](doubles x) { return x < zero ? -x : x; };
            const doubles lead = fma(e1, a, grown);
            const doubles tilt = size_of(lead);
            const doubles longest = a > 3.0 ? a : zero + 3.0;
            const doubles bend = TWO ? fma(longest, tilt, size_of(fma(e2, a, 2.0 * (grown - lead)))) : tilt;
            longs found = (bend * a > 8.0 * chord * (1.0 - 1e-6)) & (bend > chord * (1.0 - 1e-6) * a);
            if (VARYING) found |= size_of(grown) > PIECE * (1.0 - 1e-6);
            for (unsigned bends = mask_of(found & good); bends != 0; bends &= bends - 1)
                bent.data[index + i + __builtin_ctz(bends)] = 1;
        }
        const doubles e1_before = e1;
        doubles y = (fma(e1, d, -(grown * f)) + GRAIN) - GRAIN;
        e1 = good ? y : e1;
        memcpy(firsts + i, &e1, many * sizeof(double));
        if (TWO) {
            y = (fma(e2, d, fma(e1_before, a * d, grown * fma(zero - 2.0, f, d))) + GRAIN) - GRAIN;
            e2 = good ? y : e2;
            memcpy(seconds + i, &e2, many * sizeof(double));
        }
        last = good_sample ? sample : last;
        memcpy(lasts + i, &last, many * sizeof(float));
        // Far behind a light that is much brighter, the output is no difference from it.
        const longs near = y > -16.0;
        floats light = narrow(fma(level, exp_less(y, near ? zero + 1.0 : zero), near ? now : zero - dark));
        light = light > 0.0f ? light : floats{};
        light = light < LARGEST ? light : floats{} + LARGEST;
        // What is listed stays as it is: the samples may lie where the result goes.
        light = good_sample ? light : sample;
        memcpy(out + i, &light, many * sizeof(float));
        for (unsigned bad = ~mask_of(good_sample) & (0xFFFFu >> (16 - many)); bad != 0; bad &= bad - 1)
            place.data[listed++] = i + __builtin_ctz(bad);
    };
    int i = 0;
    for (; i + 16 <= size; i += 16) {
        __builtin_prefetch(v + ahead + i, 0, 2);
        step(i, 16);
    }
    if (i < size) step(i, size - i);
    return listed;
};

// Takes one pixel alone through a step, to the bits of step_block; returns the output, or -1 where the sample would be
// listed, which is left alone.
static const auto step_alone = [](const auto& receptor, float sample, int index, double half, int halvings,
    double constant_d, double constant_f, const auto& last_sample, const auto& first_pole, const auto& second_pole) {
    struct Light {
        float* data;
    };
    struct Places {
        int* data;
    };
    float out = 0.0f;
    int listed = 0;
    const Places place = {&listed};
    const int left = step_block(receptor, Light{&sample}, 0, 0, index, 1, half, halvings, constant_d, constant_f,
        last_sample, first_pole, second_pole, Light{&out}, place, 0.0, place);
    return left ? -1.0f : out;
};
