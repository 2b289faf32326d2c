# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""RUN pixels of a row at a time through a whole message: whether nothing can happen to them, what they keep."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.inactive_kernels import RUN, Quiet, Run, quiet_margins
from nodes.event_sensor.model.pixel_kernels import Sensor
from nodes.event_sensor.model.state_kernels import Features
from nodes.event_sensor.model.step_kernels import slope_of

wp.set_module_options({"enable_backward": False})


@lru_cache
def run_margins(features: Features) -> Any:
    """Function: a number per pixel of a run, below 0 where something may happen to it up to `t_end`."""
    cubic, hermite, timed = features.crossing == "cubic", features.crossing == "hermite", features.timed

    @wp.func
    def over_and_under(
        # in
        sensor: Sensor,
        quiet: Quiet,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        longest: wp.float32,
    ):
        """The same bounds as surely_quiet, for all steps of `longest` ns at most together."""
        dark = Run(wp.float32(sensor.dark))
        v = luminance_runs[at]
        least = wp.min(v, quiet.last_runs[index])
        most = wp.max(v, quiet.last_runs[index])
        early = quiet.early_runs[index]
        finite = v - v
        steepest = wp.max(early, -early)
        if wp.static(cubic):
            least = wp.min(least, early)
            most = wp.max(most, early)
        k = int(0)
        last = wp.where(wp.static(cubic), count + 1, count)
        while k < last:
            v = luminance_runs[at + wp.int64(k) * stride]
            least = wp.min(least, v)
            most = wp.max(most, v)
            finite += v - v
            if wp.static(hermite):
                slope = slope_runs[at + wp.int64(k) * stride]
                steepest = wp.max(steepest, wp.max(slope, -slope))
                finite += slope - slope
            k += 1
        a = least + dark
        b = most + dark
        low = quiet.low_runs[index] + dark
        high = quiet.high_runs[index] + dark
        if wp.static(cubic):
            reach = 3.0 * a + b
            above = 4.0 * wp.cw_mul(a, high) - wp.cw_mul(b, reach)
            below = 4.0 * wp.cw_mul(a, a) - wp.cw_mul(reach, low)
            # A product of two negative numbers must not pass for a margin.
            return wp.min(wp.min(above, below), wp.min(early, least)) + finite
        third = steepest * (longest * 3.4e-10)
        over = Run(1.0) + third + wp.cw_mul(third, third)
        margins = wp.min(high - wp.cw_mul(b, over), a - wp.cw_mul(low, over))
        return wp.min(margins, Run(0.999) - third) + finite + (early - early)

    @wp.func
    def margins_of(
        # in
        sensor: Sensor,
        quiet: Quiet,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        longest: wp.float32,
        t_end: wp.int64,
    ):
        """index, at: of the run's first pixel in the state and in the first frame."""
        margins = Run()
        if wp.static(cubic or hermite):
            margins = over_and_under(sensor, quiet, luminance_runs, slope_runs, index, at, stride, count, longest)
            margins = wp.max(margins, Run(-1.0))  # -1 for NaN
        else:
            margins = quiet_margins(quiet, luminance_runs, index, at, stride, count)
        if wp.static(timed):
            wakes = quiet.wake_runs[index]
            if wp.min(wakes) <= t_end:
                for lane in range(wp.static(RUN)):
                    if wakes[lane] <= t_end:
                        margins[lane] = -1.0
        return margins

    return margins_of


@lru_cache
def passed(features: Features) -> tuple[Any, Any]:
    """(function of a run, function of a pixel): what is kept of a message through which it was quiet."""
    curved, hermite = features.curved, features.crossing == "hermite"

    @wp.func
    def one(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        slopes: wp.array(dtype=wp.float32),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        # in and out
        quiet: Quiet,
    ):
        """at: place of the pixel in the last frame."""
        if wp.static(hermite):
            quiet.earlier[index] = quiet.early[index]
            if count > 1:
                quiet.earlier[index] = slope_of(sensor, slopes[at - stride], luminance[at - stride])
            quiet.early[index] = slope_of(sensor, slopes[at], luminance[at])
        elif wp.static(curved):
            before = quiet.last[index]
            if count > 2:
                quiet.earlier[index] = luminance[at - wp.int64(2) * stride]
            else:
                quiet.earlier[index] = wp.where(count == 2, before, quiet.early[index])
            if count > 1:
                before = luminance[at - stride]
            quiet.early[index] = before
        quiet.last[index] = luminance[at]

    @wp.func
    def run(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        luminance_runs: wp.array(dtype=Run),
        slopes: wp.array(dtype=wp.float32),
        slope_runs: wp.array(dtype=Run),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        # in and out
        quiet: Quiet,
    ):
        """As for one pixel, RUN of them; without dark level L's slope is that of ln I."""
        if wp.static(hermite):
            if sensor.dark > wp.float64(0.0):
                lane = int(0)
                while lane < wp.static(RUN):
                    one(sensor, luminance, slopes, index + lane, at + wp.int64(lane), stride, count, quiet)
                    lane += 1
                return
            quiet.earlier_runs[index] = quiet.early_runs[index]
            if count > 1:
                quiet.earlier_runs[index] = slope_runs[at - stride]
            quiet.early_runs[index] = slope_runs[at]
        elif wp.static(curved):
            before = quiet.last_runs[index]
            if count > 2:
                quiet.earlier_runs[index] = luminance_runs[at - wp.int64(2) * stride]
            elif count == 2:
                quiet.earlier_runs[index] = before
            else:
                quiet.earlier_runs[index] = quiet.early_runs[index]
            if count > 1:
                before = luminance_runs[at - stride]
            quiet.early_runs[index] = before
        quiet.last_runs[index] = luminance_runs[at]

    return run, one
