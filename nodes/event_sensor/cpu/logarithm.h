#pragma once
#include "warp/native/builtin.h"

// Computes ln x for a positive, normal float64 to less than one unit in the last place.
//
// ln x = e ln 2 + ln m with m in [sqrt(1/2), sqrt(2)); with f = m - 1 and s = f / (2 + f),
// ln m = f - f^2 / 2 + s (f^2 / 2 + R) and R = 2 (s^2 / 3 + s^4 / 5 + ...) to 2e-16 of its size.
static const auto log_of = [](double x) {
#pragma clang fp contract(off)
    const wp::int64 root_half = 0x3FE6A09E667F3BCDll;
    const wp::int64 bits = __builtin_bit_cast(wp::int64, x) - root_half;
    const double e = (double)(bits >> 52);
    const double f = __builtin_bit_cast(double, (bits & 0x000FFFFFFFFFFFFFll) + root_half) - 1.0;
    const double s = f / (2.0 + f);
    const double z = s * s;
    double r = 0.14616449685043406;
    r = r * z + 0.15331721600556042;
    r = r * z + 0.18182889125261723;
    r = r * z + 0.2222221113479508;
    r = r * z + 0.28571428625975487;
    r = r * z + 0.39999999999899505;
    r = r * z + 0.666666666666667;
    const double half = 0.5 * f * f;
    // ln 2 in two parts, the first short enough for an exact product with e.
    return e * 0.6931467056274414 - ((half - (s * (half + r * z) + e * 4.7493250390316726e-07)) - f);
};
