"""Evaluates the curve of L between two samples, by the slopes at its ends.

Inside a step L(u) = l0 + u (m0 + u (3 d - 2 m0 - m1 + u (m0 + m1 - 2 d))), u in [0, 1], d = l1 - l0; m0 and m1 are the
slopes at its ends times the step's length. Slopes with 0 <= m / d <= 3 at both ends make it monotone (Fritsch and
Carlson 1980, their square). A curve outside the square runs over its end values: wanted at the top of a smooth signal,
where straight lines lose events, and wrong beside an edge. The two are told apart by how the curvature goes on.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.sensor_kernels import UNKNOWN_SLOPES, Sensor, has_level, log_level
from nodes.event_sensor.model.state_kernels import UNKNOWN_LEVEL, Frequent
from nodes.event_sensor.model.step_kernels import Levels, Sample

wp.set_module_options({"enable_backward": False})

STEEP = wp.constant(wp.float64(0.7))
"""Curvature of opposite signs at both ends, relative to the chord, that shows an edge; 0.46 for a sinusoid with six
samples per period, 1 for a jump."""
LEAST_TURN = wp.constant(wp.float64(1.1))
MOST_TURN = wp.constant(wp.float64(2.1))
"""Neighbouring second differences of a sinusoid with phase step a: s[k-1] + s[k+1] = 2 cos(a) s[k]. Beside an extremum
the factor lies between these: 1.1 for 6.4 samples per period, 2 for ever more."""
AGREEMENT = wp.constant(wp.float64(0.05))
"""Part of the curvature by which the first differences may miss the same law; none for a sinusoid."""
SHARPNESS = wp.constant(wp.float64(0.75))
"""At an edge the slopes lie this part of the way from the chord's to Butland's, which are 0 beside a jump. A jump may
be anywhere in its step: crossings nearer to the middle are off by less than crossings spread evenly over the step."""
BENT = wp.constant(wp.float64(0.7))
"""Curvature relative to the chord above which one neighbour alone shows an edge."""
TRAPEZOID = wp.constant(wp.float64(0.15))
"""Slopes that are known agree with the samples when their mean is within this of the chord; 0.1 for a sinusoid with six
samples per period."""


@wp.func
def in_square(m: wp.float64, d: wp.float64):
    """Tells whether a slope keeps the curve monotone."""
    return m * d >= wp.float64(0.0) and wp.abs(m) <= wp.float64(3.0) * wp.abs(d)


@wp.func
def parabola_bend(before: wp.float64, d: wp.float64, h_before: wp.float64, h: wp.float64):
    """Computes twice the chord d less the slope at its start of the parabola through three samples.

    That is d - before if h = h_before.

    before, d: differences of L over the two steps of lengths h_before and h. Kept to what equal steps could give, so
    that a short step beside a long one cannot throw the curve.
    """
    bend = wp.float64(2.0) * h / (h + h_before) * (d - before * h / h_before)
    most = wp.abs(d) + wp.abs(before)
    return wp.clamp(bend, -most, most)


@wp.func
def cubic_slopes(
    earlier: wp.float64, bend0: wp.float64, bend1: wp.float64, before: wp.float64, d: wp.float64, sharp: wp.vec2d
):
    """Returns the slopes of the Catmull-Rom curve, or `sharp` at an edge.

    bend0, bend1, earlier: curvature at the ends and one step earlier; before, d: chords of the step before and this.
    """
    m0 = d - wp.float64(0.5) * bend0
    m1 = d + wp.float64(0.5) * bend1
    least = wp.min(wp.abs(bend0), wp.abs(bend1))
    edge = bend0 * bend1 < wp.float64(0.0) and least > STEEP * wp.abs(d)
    if not (in_square(m0, d) and in_square(m1, d)):
        # Over its samples the curve may go only where five of them look like a sinusoid's.
        turn = (earlier + bend1) / bend0
        apart = wp.abs(before - earlier + d - turn * before)
        smooth = turn >= LEAST_TURN and turn <= MOST_TURN and apart <= AGREEMENT * wp.abs(bend0)
        edge = edge or not smooth or bend0 * bend1 < wp.float64(0.0)
    return wp.where(edge, sharp, wp.vec2d(m0, m1))


@wp.func
def end_slopes(bend: wp.float64, d: wp.float64, sharp: wp.vec2d):
    """Returns the slopes at the end of what is known, where one neighbour gives the bend: a parabola if it is low."""
    half = wp.float64(0.5) * bend
    return wp.where(wp.abs(bend) > BENT * wp.abs(d), sharp, wp.vec2d(d - half, d + half))


@wp.func
def known_slopes(m_before: wp.float64, m0: wp.float64, m1: wp.float64, d: wp.float64):
    """Returns known slopes, or the chord's at an edge.

    There they do not agree with the samples, or the curvature turns round. m_before: one sample
    earlier; not finite where it is not known, which counts as an edge.
    """
    apart = wp.abs(d - wp.float64(0.5) * (m0 + m1))
    edge = apart > TRAPEZOID * wp.float64(0.5) * (wp.abs(m0) + wp.abs(m1))
    if not (in_square(m0, d) and in_square(m1, d)):
        unknown = not wp.isfinite(m_before)
        edge = edge or unknown or (m0 - m_before) * (m1 - m0) < wp.float64(0.0)
    return wp.where(edge, wp.vec2d(d, d), wp.vec2d(m0, m1))


@wp.func
def butland(before: wp.float64, after: wp.float64, h_before: wp.float64, h_after: wp.float64):
    """Computes the slope [1/ns] at a sample: 0 at extrema, else a weighted harmonic mean of both secants.

    Fritsch and Butland, 1984.
    """
    slope = wp.float64(0.0)
    if before * after > wp.float64(0.0):
        w_before = wp.float64(2.0) * h_after + h_before
        w_after = h_after + wp.float64(2.0) * h_before
        slope = (w_before + w_after) / (w_before * h_before / before + w_after * h_after / after)
    return slope


@wp.func
def slope_of(sensor: Sensor, dlog_dt: wp.float32, intensity: wp.float32):
    """Computes dL/dt [1/s] of L = ln(I + I_dark) from d ln I/dt; NaN where it is not known."""
    light = wp.float64(intensity)
    return wp.float32(wp.float64(dlog_dt) * light / (light + sensor.dark_level))


@lru_cache
def make_step_curve(features: Features) -> Any:
    """Makes the function `step_curve`."""
    cubic, hermite = features.crossing == "cubic", features.crossing == "hermite"
    ahead = features.ahead

    @wp.func
    def step_curve(
        # in
        sensor: Sensor,
        frequent: Frequent,
        sample: Sample,
        l1: wp.float64,
        h: wp.float64,
        h_before: wp.float64,
        h_after: wp.float64,
        # in and out
        levels: Levels,
        # out
        counters: wp.array(dtype=wp.int64),
    ):
        """Computes the coefficients of the curve L(u), u in [0, 1], of a step, and L of the samples beside it.

        levels.last, l1: L at both ends. h, h_before, h_after: lengths of the step and of its neighbours [ns].
        """
        zero = wp.float64(0.0)
        l0 = wp.float64(levels.last)
        levels.next = UNKNOWN_LEVEL
        d = l1 - l0
        s = wp.vec4d(l0, d, zero, zero)
        m = wp.vec2d(d, d)
        if wp.static(hermite):
            g0 = wp.float64(frequent.early) * h * wp.float64(1.0e-9)
            g1 = wp.float64(sample.slope) * h * wp.float64(1.0e-9)
            g_before = wp.float64(frequent.earlier) * h * wp.float64(1.0e-9)
            if not wp.isfinite(g1):
                wp.atomic_add(counters, UNKNOWN_SLOPES, wp.int64(1))
                g1 = d
            if not wp.isfinite(g0):
                g0 = d
            m = known_slopes(g_before, g0, g1, d)
        if wp.static(ahead):
            has_early = frequent.early >= 0.0
            d_before = zero
            if has_early:
                if levels.early == UNKNOWN_LEVEL:
                    levels.early = log_level(sensor, frequent.early)
                d_before = l0 - levels.early
            d_after = zero
            if sample.has_next:
                levels.next = l1
                if has_level(sensor, sample.following):
                    levels.next = log_level(sensor, sample.following)
                d_after = levels.next - l1
            if has_early:
                m[0] = h * butland(d_before, d, h_before, h)
            if sample.has_next:
                m[1] = h * butland(d, d_after, h, h_after)
            if wp.static(cubic):
                sharp = SHARPNESS * m + (wp.float64(1.0) - SHARPNESS) * wp.vec2d(d, d)
                if has_early and sample.has_next:
                    bend0 = parabola_bend(d_before, d, h_before, h)
                    # What came before is unknown at an episode's start; take it for a corner.
                    bend_before = -bend0
                    if frequent.earlier >= 0.0:
                        if levels.earlier == UNKNOWN_LEVEL:
                            levels.earlier = log_level(sensor, frequent.earlier)
                        bend_before = d_before - (levels.early - levels.earlier)
                    m = cubic_slopes(bend_before, bend0, parabola_bend(-d_after, -d, h_after, h), d_before, d, sharp)
                elif has_early:
                    m = end_slopes(parabola_bend(d_before, d, h_before, h), d, sharp)
                elif sample.has_next:
                    m = end_slopes(parabola_bend(-d_after, -d, h_after, h), d, sharp)
        s[1] = m[0]
        s[2] = wp.float64(3.0) * d - wp.float64(2.0) * m[0] - m[1]
        s[3] = m[0] + m[1] - wp.float64(2.0) * d
        return s, levels

    return step_curve
