# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes when a signal crosses a threshold inside a step: on a straight line, and on a cubic.

A straight line has two texts. The ideal sensor's lines run from sample to sample, so that one division serves all
events of a step (crossing_on_line). A line with leak or between two happenings is cut at any place u of a step, and its
crossing must stay on its piece (root_of_line, then stamp_of). The rounding differs: of one line they give the same
nanosecond or two neighbours.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def crossing_on_line(level: wp.float64, l0: wp.float64, slope: wp.float64, span: wp.float64):
    """Computes when L, linear inside a step, has a level: t = t0 + (level - L0) / (L1 - L0) (t1 - t0) [whole ns].

    slope: span / (L1 - L0), one division for all events of a step; the result lies in [1, span] after its start.
    """
    return wp.int64(wp.clamp((level - l0) * slope + wp.float64(0.5), wp.float64(1.0), span))


@wp.func
def root_of_line(s: wp.vec4d, level: wp.float64, a: wp.float64, b: wp.float64):
    """Computes u in [a, b] at which s[0] + s[1] u has a level; b on a line that does not rise or fall."""
    root = b
    if s[1] != wp.float64(0.0):
        root = wp.clamp((level - s[0]) / s[1], a, b)
    return root


@wp.func
def stamp_of(u: wp.float64, h: wp.float64, start: wp.int64):
    """Returns the stamp [ns] of the place u, in [0, 1], of a step of h ns from `start`, to the nearest after it."""
    return start + wp.max(wp.int64(u * h + wp.float64(0.5)), wp.int64(1))


@wp.func
def polynomial(c: wp.vec4d, u: wp.float64):
    """Computes the polynomial c[0] + c[1] u + c[2] u^2 + c[3] u^3."""
    return c[0] + u * (c[1] + u * (c[2] + u * c[3]))


@wp.func
def turning_points(c: wp.vec4d):
    """Computes where the polynomial turns, ascending; 2 stands for none in (0, 1)."""
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
def root_of_cubic(c: wp.vec4d, level: wp.float64, a: wp.float64, b: wp.float64):
    """Computes u in [a, b], where the polynomial is monotone, at which it has a level: Halley's method in a bracket."""
    low = a
    high = b
    f_low = polynomial(c, a) - level
    f_high = polynomial(c, b) - level
    u = b
    if f_low * f_high < wp.float64(0.0):
        u = a + (b - a) * f_low / (f_low - f_high)
        turn = int(0)
        while turn < 60:
            f = polynomial(c, u) - level
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
