#pragma once
// The constants that kernels are compiled with, for an editor; Python puts their values in front of a header's text.
#include "warp/native/builtin.h"

// Of the model, see sensor_kernels.py.
extern const float LARGEST;
extern const double SMALLEST, GUARD, TOLERANCE;
extern const int EVENTS, NONFINITE, CLIPPED, DROPPED;
// Of cpu/order_kernels.py.
extern const int MOST_BITS;
// Of readout/readout_kernels.py.
extern const double REACH;
extern const wp::uint64 STREAM;
extern const wp::uint64 TURNED_AWAY;
// Of optics/photoreceptor_simd_kernels.py.
extern const bool TWO, VARYING, BENDS;
extern const double LN2, GRAIN, PIECE;
