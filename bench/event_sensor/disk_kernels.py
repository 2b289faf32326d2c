"""Draws the test picture of `bench.event_sensor.disk` and the slope of its logarithm."""

import math

import warp as wp

wp.set_module_options({"enable_backward": False})

RADIUS = wp.constant(wp.float64(120.0))
SPIN = wp.constant(wp.float64(50.0))
DRIFT = wp.constant(wp.float64(100.0))
SPAN = wp.constant(wp.float64(math.log(1e5)))


@wp.kernel
def draw(
    # in
    t: wp.array(dtype=wp.float64),
    patches: wp.array2d(dtype=wp.float64),
    soft: wp.float64,
    # out
    luminance: wp.array3d(dtype=wp.float32),
    dlog_dt: wp.array3d(dtype=wp.float32),
):
    """Draws the picture at one instant.

    soft: width of the edges between sectors [px], 1 as by a box filter, 0 as by point samples."""
    k, y, x = wp.tid()
    half = wp.float64(0.5)
    width = wp.float64(luminance.shape[2])
    px = wp.float64(x) + half - half * width
    py = wp.float64(y) + half - half * wp.float64(luminance.shape[1])
    r = wp.sqrt(px * px + py * py)
    rate = SPAN * DRIFT / width
    value = wp.float64(0.01) * wp.exp(SPAN * (wp.float64(x) + half) / width + rate * t[k])
    if r < RADIUS:
        sectors = wp.float64(patches.shape[1])
        pitch = wp.float64(2.0 * wp.pi) / sectors
        turns = (wp.atan2(py, px) - SPIN * t[k]) / pitch
        inside = turns - wp.floor(turns)
        sector = wp.int32(wp.floor(turns)) % patches.shape[1]
        if sector < 0:
            sector += patches.shape[1]
        ring = wp.int32(r / RADIUS * wp.float64(patches.shape[0]))
        mine = patches[ring, sector]
        # Distance to the nearer edge [px]; the other side's share falls from 1/2 at the edge to 0 at soft / 2.
        side = wp.where(inside < half, -1, 1)
        away = wp.min(inside, wp.float64(1.0) - inside) * pitch * r
        other = patches[ring, (sector + side + patches.shape[1]) % patches.shape[1]]
        share = wp.float64(0.0)
        change = wp.float64(0.0)
        if away < half * soft:
            share = half - away / soft
            change = (other - mine) * wp.where(side < 0, SPIN * r / soft, -SPIN * r / soft)
        value = mine + (other - mine) * share
        rate = change / value
        value = value * (wp.float64(1.0) + wp.float64(0.2) * px / RADIUS)
    luminance[k, y, x] = wp.float32(value)
    dlog_dt[k, y, x] = wp.float32(rate)
