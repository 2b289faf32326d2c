#pragma once
#include "../model/constants.h"

// Sorts n keys by the digit of `bits` bits at `shift`, stably, and adds `add` to each.
static const auto counting_pass = [](wp::uint64 source_keys, wp::uint64 to, wp::int64 n, wp::int64 shift, int bits,
    wp::int64 add) {
    wp::int64* source = (wp::int64*)source_keys;
    wp::int64* target = (wp::int64*)to;
    const wp::int64 mask = ((wp::int64)1 << bits) - 1;
    unsigned place[1 << MOST_BITS];
    memset(place, 0, sizeof(unsigned) << bits);
    for (wp::int64 i = 0; i < n; i++) place[source[i] >> shift & mask]++;
    unsigned total = 0;
    for (int digit = 0; digit <= mask; digit++) {
        const unsigned here = place[digit];
        place[digit] = total;
        total += here;
    }
    for (wp::int64 i = 0; i < n; i++) target[place[source[i] >> shift & mask]++] = source[i] + add;
};

// Writes keys to columns; the twin of unpack_to in model/key_kernels.py.
static const auto to_columns = [](const auto& sensor, wp::int64 t_base, const auto& keys, const auto& t,
    const auto& x, const auto& y, const auto& p) {
    const wp::int64* key = keys.data;
    wp::int64* ts = t.data;
    wp::uint16* xs = x.data;
    wp::uint16* ys = y.data;
    wp::uint8* ps = p.data;
    const int n = keys.shape[0];
    const int shift_t = (int)sensor.shift_t;
    const int shift_y = (int)sensor.shift_y;
    const int shift_x = (int)sensor.shift_x;
    const wp::int64 mask_t = ((wp::int64)1 << (sensor.shift_env - shift_t)) - 1;
    const wp::int64 mask_y = ((wp::int64)1 << (shift_t - shift_y)) - 1;
    const wp::int64 mask_x = ((wp::int64)1 << (shift_y - shift_x)) - 1;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < n; i++) {
        const wp::int64 one = key[i];
        ts[i] = t_base + (one >> shift_t & mask_t);
        ys[i] = (wp::uint16)(one >> shift_y & mask_y);
        xs[i] = (wp::uint16)(one >> shift_x & mask_x);
        ps[i] = (wp::uint8)(one & 1);
    }
};
