"""Computes the leak: the reference of a pixel falls in the dark as in the light, as a drift or as the paper's coin per
step.

The drift is leak_rate x threshold_on; it and the signal share one crossing. A pixel that leaks was last reset at some
time before the episode: with leak alone in the light of the first frame u / leak_rate before, u uniform in [0, 1), one
number per pixel and episode. So its reference begins u x threshold_on below the first frame, where a pixel without leak
has it at the first frame; in constant light the first event comes within (0, 1 / leak_rate] and the rate is leak_rate
from the start. As there is one reference, the signal meets it too, then as at any later time: a rise by a x
threshold_on fires floor(a + u) ON events, a on average, and a fall by as much floor(a - u) OFF events where the
thresholds are equal. A drift that shares its crossing with the signal can have its phase nowhere else.
"""

import warp as wp

from evis.random_number_kernels import draw, mix, uniform
from nodes.event_sensor.model.faults.random_kernels import LONGEST, NEVER, PHASE

wp.set_module_options({"enable_backward": False})


@wp.func
def leak_origin(stream: wp.uint64, leak: wp.float32, now: wp.int64):
    """Draws when a pixel whose episode begins at `now` was last reset by its leak [Hz]: less than 1 / leak before."""
    origin = now
    if leak > 0.0:
        age = uniform(draw(stream, PHASE)) / wp.float64(leak) * wp.float64(1.0e9)
        origin = now - wp.int64(wp.min(age, LONGEST))
    return origin


@wp.func
def bernoulli_leak_time(stream: wp.uint64, leak: wp.float32, start: wp.int64, now: wp.int64, origin: wp.int64):
    """Draws when a leak that is a Bernoulli trial per step fires in (start, now], or NEVER.

    leak: its rate [Hz]. origin: when the episode began [ns].
    """
    bits = mix(stream ^ mix(wp.uint64(now - origin)))
    length = wp.float64(now - start)
    when = NEVER
    if uniform(bits) < wp.float64(leak) * length * wp.float64(1.0e-9):
        place = uniform(mix(bits)) * length
        when = start + wp.int64(1) + wp.int64(wp.min(place, wp.float64(now - start - wp.int64(1))))
    return when
