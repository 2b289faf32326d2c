#pragma once
#include "../model/constants.h"
#include "../cpu/logarithm.h"

// SplitMix64's output function (Steele, Lea and Flood, OOPSLA 2014).
static const auto mix = [](wp::uint64 h) {
    h += 0x9E3779B97F4A7C15ull;
    h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9ull;
    h = (h ^ (h >> 27)) * 0x94D049BB133111EBull;
    return h ^ (h >> 31);
};
// In (0, 1), from the upper 53 bits.
static const auto uniform = [](wp::uint64 h) { return ((double)(wp::int64)(h >> 11) + 0.5) * 0x1p-53; };

// Computes sin(2 pi w) for |w| <= 1/4 by its series up to the 19th power, to 3e-16.
static const auto sine_of_turn = [](double w) {
#pragma clang fp contract(off)
    const double q = w * w;
    double r = -0.012031585942120619;
    r = 0.10422916220813978 + q * r;
    r = -0.7181223017785001 + q * r;
    r = 3.8199525848482803 + q * r;
    r = -15.094642576822984 + q * r;
    r = 42.058693944897634 + q * r;
    r = -76.70585975306136 + q * r;
    r = 81.60524927607504 + q * r;
    r = -41.341702240399755 + q * r;
    r = 6.283185307179586 + q * r;
    return w * r;
};

// Computes when the events of an environment leave: D_i = max(t_i, D_{i-1} + service).
static const auto serve = [](const auto& queue, int env, wp::int64 begin, wp::int64 end, wp::int64 t_base,
    const auto& t, const auto& free, const auto& stamps, const auto& statistics) {
    const wp::int64* asks = t.data;
    wp::int64* leaves_at = stamps.data;
    const int fraction = (int)queue.fraction;
    const wp::int64 up = ((wp::int64)1 << fraction) - 1;
    const wp::int64 longest = queue.capacity * queue.service;
    wp::int64 ready = free.data[env];
    wp::int64 waited = 0, together = 0, most = 0, dropped = 0;
    for (wp::int64 i = begin; i < end; i++) {
        const wp::int64 arrival = (asks[i] - t_base) << fraction;
        if (queue.capacity > 0 && ready - arrival > longest) {
            leaves_at[i] = (wp::int64)TURNED_AWAY;
            dropped++;
            continue;
        }
        const wp::int64 leaves = arrival > ready ? arrival : ready;
        ready = leaves + queue.service;
        // Up to the next whole ns: nothing leaves before its turn.
        const wp::int64 late = leaves > arrival ? t_base + ((leaves + up) >> fraction) - asks[i] : 0;
        leaves_at[i] = asks[i] + late;
        waited += leaves > arrival;
        together += late;
        most = late > most ? late : most;
    }
    free.data[env] = ready;
    wp::int64* found = statistics.data + 4 * env;
    found[0] = waited;
    found[1] = together;
    found[2] = most;
    found[3] = dropped;
};

// Adds sigma (REACH + N) [ns] to the stamps, N standard normal and cut at +-REACH.
static const auto delay = [](const auto& queue, wp::uint64 seed, wp::int64 origin, wp::int64 begin, wp::int64 end,
    const auto& t, const auto& x, const auto& y, const auto& p, const auto& c, const auto& stamps) {
    const wp::int64* asks = t.data;
    const wp::uint16* xs = x.data;
    const wp::uint16* ys = y.data;
    const wp::uint8* ps = p.data;
    const wp::uint8* cs = c.shape[0] > 0 ? c.data : nullptr;
    wp::int64* leaves_at = stamps.data;
    const wp::uint64 mine = mix(seed) ^ STREAM;
    const double sigma = queue.sigma;
    const auto delayed = [&](wp::int64 i, wp::int64 channel) __attribute__((always_inline)) {
#pragma clang fp contract(off)
        const wp::int64 pixel = (channel * queue.height + ys[i]) * queue.width + xs[i];
        const wp::uint64 h = mix(mix(mine ^ (wp::uint64)(2 * pixel + ps[i])) ^ (wp::uint64)(asks[i] - origin));
        // Box and Muller; the cosine of a turn is the sine of a quarter less.
        const double radius = __builtin_sqrt(-2.0 * log_of(uniform(h)));
        const double w = __builtin_fabs(uniform(mix(h)) - 0.5) - 0.25;
        double normal = radius * sine_of_turn(w);
        normal = normal > -REACH ? normal : -REACH;
        normal = normal < REACH ? normal : REACH;
        const wp::int64 late = (wp::int64)(sigma * (REACH + normal) + 0.5);
        leaves_at[i] += leaves_at[i] == (wp::int64)TURNED_AWAY ? 0 : late;
    };
    if (cs)
        for (wp::int64 i = begin; i < end; i++) delayed(i, cs[i]);
    else
#pragma clang loop vectorize(assume_safety) vectorize_width(8) interleave_count(2)
        for (wp::int64 i = begin; i < end; i++) delayed(i, 0);
};

// Packs columns into keys; returns whether they ascend. The twin of key_of in model/key_kernels.py.
static const auto to_keys = [](const auto& sensor, wp::int64 t_base, const auto& env, const auto& t, const auto& x,
    const auto& y, const auto& p, const auto& c, const auto& keys) {
    const wp::int32* envs = env.data;
    const wp::int64* ts = t.data;
    const wp::uint16* xs = x.data;
    const wp::uint16* ys = y.data;
    const wp::uint8* ps = p.data;
    const wp::uint8* cs = c.shape[0] > 0 ? c.data : nullptr;
    wp::int64* key = keys.data;
    const int n = t.shape[0];
    const int shift_env = (int)sensor.shift_env;
    const int shift_t = (int)sensor.shift_t;
    const int shift_y = (int)sensor.shift_y;
    const int shift_x = (int)sensor.shift_x;
#pragma clang loop vectorize(assume_safety)
    for (int i = 0; i < n; i++) {
        const wp::int64 place = (wp::int64)ys[i] << shift_y | (wp::int64)xs[i] << shift_x | (ps[i] != 0);
        key[i] = (wp::int64)envs[i] << shift_env | (ts[i] - t_base) << shift_t | place;
    }
    if (cs)
        for (int i = 0; i < n; i++) key[i] |= (wp::int64)cs[i] << 1;
    bool rising = true;
#pragma clang loop vectorize(assume_safety)
    for (int i = 1; i < n; i++) rising &= key[i] >= key[i - 1];
    return rising;
};

// Sorts keys that are in order but for those of one time.
static const auto insertion_sort = [](int count, const auto& keys) {
    wp::int64* key = keys.data;
    for (int i = 1; i < count; i++) {
        const wp::int64 one = key[i];
        int j = i;
        for (; j > 0 && key[j - 1] > one; j--) key[j] = key[j - 1];
        key[j] = one;
    }
};
