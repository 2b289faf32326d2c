# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Cubics between two samples of L, and where they cross a level.

Inside a step L(u) = l0 + u (m0 + u (3 d - 2 m0 - m1 + u (m0 + m1 - 2 d))), u in [0, 1], d = l1 - l0; m0 and m1 are the
slopes at its ends times the step's length. Slopes with 0 <= m / d <= 3 at both ends make it monotone (Fritsch and
Carlson 1980, their square). A curve outside the square runs over its end values: wanted at the top of a smooth signal,
where straight lines lose events, and wrong beside an edge. The two are told apart by how the curvature goes on.
"""

import warp as wp

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
    """True when a slope keeps the curve monotone."""
    return m * d >= wp.float64(0.0) and wp.abs(m) <= wp.float64(3.0) * wp.abs(d)


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
def cubic_slopes(
    earlier: wp.float64, bend0: wp.float64, bend1: wp.float64, before: wp.float64, d: wp.float64, sharp: wp.vec2d
):
    """Slopes of the Catmull-Rom curve, or `sharp` at an edge.

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
    """Slopes at the end of what is known, where one neighbour gives the curvature: a parabola if it bends little."""
    half = wp.float64(0.5) * bend
    return wp.where(wp.abs(bend) > BENT * wp.abs(d), sharp, wp.vec2d(d - half, d + half))


@wp.func
def known_slopes(m_before: wp.float64, m0: wp.float64, m1: wp.float64, d: wp.float64):
    """Known slopes; the chord's at an edge, where they do not agree with the samples or the curvature turns round.

    m_before: one sample earlier; not finite where it is not known, which counts as an edge.
    """
    apart = wp.abs(d - wp.float64(0.5) * (m0 + m1))
    edge = apart > TRAPEZOID * wp.float64(0.5) * (wp.abs(m0) + wp.abs(m1))
    if not (in_square(m0, d) and in_square(m1, d)):
        unknown = not wp.isfinite(m_before)
        edge = edge or unknown or (m0 - m_before) * (m1 - m0) < wp.float64(0.0)
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
    """u in [a, b], where the polynomial is monotone, at which it has this level: Halley's method inside a bracket."""
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
            here_is_low = f * f_low > wp.float64(0.0)
            low = wp.where(here_is_low, u, low)
            high = wp.where(here_is_low, high, u)
            slope = c[1] + u * (wp.float64(2.0) * c[2] + u * wp.float64(3.0) * c[3])
            bend = c[2] + u * wp.float64(3.0) * c[3]
            move = f * slope / (slope * slope - f * bend)
            u = u - move
            # Within 1e-6 by Newton's step; what this one leaves is about the cube of it. (Halley's own step is short
            # where the slope is nearly 0, also far from the root.)
            if wp.abs(f) <= wp.float64(1.0e-6) * wp.abs(slope):
                u = wp.clamp(u, a, b)
                turn = 60
            elif not (u > low and u < high):
                u = wp.float64(0.5) * (low + high)
            turn += 1
    elif f_low == wp.float64(0.0):
        u = a
    return u
