# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Cubics between two samples of L, and where they cross a level.

Inside a step L(u) = l0 + u (m0 + u (3 d - 2 m0 - m1 + u (m0 + m1 - 2 d))), u in [0, 1], d = l1 - l0; m0 and m1 are the
slopes at its ends times the step's length. Slopes with 0 <= m / d <= 3 at both ends make it monotone (Fritsch and
Carlson 1980, their square). A curve outside the square runs over its end values: wanted at the top of a smooth signal,
where straight lines lose events, and wrong beside an edge. The two are told apart by the curvature.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

RATIO = wp.constant(wp.float64(3.0))
"""Beside an extremum the curvature at one end may be this many times that at the other; at an edge it is more."""
STEEP = wp.constant(wp.float64(0.7))
"""Curvature of opposite signs at both ends, relative to the chord, that shows an edge; 0.46 for a sinusoid with six
samples per period, 1 for a jump."""
REVERSAL = wp.constant(wp.float64(0.85))
"""Curvature of the other sign one step earlier, relative to the step's own, that shows a corner. A sinusoid with six
samples per period has up to 0.77, the corner of a square wave 1."""
TRAPEZOID = wp.constant(wp.float64(0.3))
"""Slopes that are known agree with the samples when their mean is within this of the chord; 0.1 for that sinusoid."""


@wp.func
def in_square(m: wp.float64, d: wp.float64):
    """True when a slope keeps the curve monotone."""
    return m * d >= wp.float64(0.0) and wp.abs(m) <= wp.float64(3.0) * wp.abs(d)


@wp.func
def to_square(m: wp.float64, d: wp.float64):
    """The nearest slope that keeps the curve monotone."""
    limit = wp.float64(3.0) * d
    return wp.clamp(m, wp.min(limit, wp.float64(0.0)), wp.max(limit, wp.float64(0.0)))


@wp.func
def parabola_bend(before: wp.float64, d: wp.float64, h_before: wp.float64, h: wp.float64):
    """Twice the chord d less the slope at its start of the parabola through three samples: d - before if h = h_before.

    before, d: differences of L over the two steps of lengths h_before and h. Kept to what equal steps could give, so
    that a short step beside a long one cannot throw the curve.
    """
    bend = wp.float64(2.0) * h / (h + h_before) * (d - before * h / h_before)
    most = wp.abs(d) + wp.abs(before)
    return wp.clamp(bend, -most, most)


@wp.func
def cubic_slopes(earlier: wp.float64, bend0: wp.float64, bend1: wp.float64, d: wp.float64):
    """Slopes of the Catmull-Rom curve, the chord's at an edge. bend0, bend1, earlier: curvature at the ends, before."""
    m0 = d - wp.float64(0.5) * bend0
    m1 = d + wp.float64(0.5) * bend1
    least = wp.min(wp.abs(bend0), wp.abs(bend1))
    edge = bend0 * bend1 < wp.float64(0.0) and least > STEEP * wp.abs(d)
    if not (in_square(m0, d) and in_square(m1, d)):
        corner = earlier * bend0 < wp.float64(0.0) and wp.abs(earlier) > REVERSAL * least
        uneven = wp.max(wp.abs(bend0), wp.abs(bend1)) > RATIO * least
        edge = edge or corner or uneven or bend0 * bend1 < wp.float64(0.0)
    return wp.where(edge, wp.vec2d(d, d), wp.vec2d(m0, m1))


@wp.func
def known_slopes(m_before: wp.float64, m0: wp.float64, m1: wp.float64, d: wp.float64):
    """Known slopes, the chord's where they do not agree with the samples or the curvature turns round (an edge)."""
    apart = wp.abs(d - wp.float64(0.5) * (m0 + m1))
    edge = apart > TRAPEZOID * wp.float64(0.5) * (wp.abs(m0) + wp.abs(m1))
    if not (in_square(m0, d) and in_square(m1, d)):
        edge = edge or (m0 - m_before) * (m1 - m0) < wp.float64(0.0)
    return wp.where(edge, wp.vec2d(d, d), wp.vec2d(m0, m1))


@wp.func
def butland(before: wp.float64, after: wp.float64, h_before: wp.float64, h_after: wp.float64):
    """Slope [1/ns] at a sample, weighted harmonic mean of the two secants (Fritsch and Butland 1984); 0 at extrema."""
    slope = wp.float64(0.0)
    if before * after > wp.float64(0.0):
        w_before = wp.float64(2.0) * h_after + h_before
        w_after = h_after + wp.float64(2.0) * h_before
        slope = (w_before + w_after) / (w_before * h_before / before + w_after * h_after / after)
    return slope


@wp.func
def at(c: wp.vec4d, u: wp.float64):
    """The polynomial c[0] + c[1] u + c[2] u^2 + c[3] u^3."""
    return c[0] + u * (c[1] + u * (c[2] + u * c[3]))


@wp.func
def turning_points(c: wp.vec4d):
    """Where the polynomial turns, ascending; 2 stands for none in (0, 1)."""
    one = wp.float64(1.0)
    none = wp.float64(2.0)
    first = none
    second = none
    a = wp.float64(3.0) * c[3]
    b = c[2]  # half of the middle coefficient of the derivative
    square = b * b - a * c[1]
    if square > wp.float64(0.0):
        # q avoids the difference of two nearly equal numbers.
        q = -(b + wp.where(b < wp.float64(0.0), -wp.sqrt(square), wp.sqrt(square)))
        if a != wp.float64(0.0):
            first = q / a
        if q != wp.float64(0.0):
            second = c[1] / q
    first = wp.where(first > wp.float64(0.0) and first < one, first, none)
    second = wp.where(second > wp.float64(0.0) and second < one, second, none)
    return wp.vec2d(wp.min(first, second), wp.max(first, second))


@wp.func
def crossing(c: wp.vec4d, level: wp.float64, a: wp.float64, b: wp.float64):
    """u in [a, b], where the polynomial is monotone, at which it has this level: Newton's method inside a bracket."""
    low = a
    high = b
    f_low = at(c, a) - level
    f_high = at(c, b) - level
    u = b
    if f_low * f_high < wp.float64(0.0):
        u = a + (b - a) * f_low / (f_low - f_high)
        turn = int(0)
        while turn < 60:
            f = at(c, u) - level
            if f * f_low > wp.float64(0.0):
                low = u
            else:
                high = u
            slope = c[1] + u * (wp.float64(2.0) * c[2] + u * wp.float64(3.0) * c[3])
            to = u - f / slope
            if not (to > low and to < high):
                to = wp.float64(0.5) * (low + high)
            moved = wp.abs(to - u)
            u = to
            # The next step, whose length is about the square of this one's, is left out.
            if moved < wp.float64(1.0e-7):
                turn = 60
            turn += 1
    elif f_low == wp.float64(0.0):
        u = a
    return u
