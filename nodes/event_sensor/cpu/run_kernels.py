# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Takes RUN pixels of a row at a time through a whole message: whether nothing can happen to them, what they keep."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.curve_kernels import slope_of
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.inactive_kernels import THIRD_NS
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.model.state_kernels import RUN, FrequentState, Run

wp.set_module_options({"enable_backward": False})


@wp.func
def straight_margins(
    state: FrequentState,
    luminance_runs: wp.array(dtype=Run),
    index: wp.int32,
    at: wp.int64,
    stride: wp.int64,
    count: wp.int32,
):
    """Computes by how much `count` samples of RUN pixels stay in their inactive ranges; below 0 where one does not."""
    v = luminance_runs[at]
    least = v
    most = v
    finite = v - v  # NaN where a sample is not finite
    k = int(1)
    while k < count:
        v = luminance_runs[at + wp.int64(k) * stride]
        least = wp.min(least, v)
        most = wp.max(most, v)
        finite += v - v
        k += 1
    margins = wp.min(least - state.low_runs[index], state.high_runs[index] - most) + finite
    return wp.max(margins, Run(-1.0))  # -1 for NaN


@lru_cache
def make_run_margins(features: Features) -> Any:
    """Makes the function `run_margins`: a number per pixel of a run, below 0 where something may happen to it."""
    cubic, hermite, timed = features.crossing == "cubic", features.crossing == "hermite", features.timed

    @wp.func
    def over_and_under(
        # in
        sensor: Sensor,
        state: FrequentState,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        longest: wp.float32,
    ):
        """Computes the margins to the bounds of `curve_inactive`, for all steps of `longest` ns at most together."""
        dark = Run(wp.float32(sensor.dark_level))
        v = luminance_runs[at]
        least = wp.min(v, state.last_runs[index])
        most = wp.max(v, state.last_runs[index])
        early = state.early_runs[index]
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
        low = state.low_runs[index] + dark
        high = state.high_runs[index] + dark
        if wp.static(cubic):
            over = Run(0.75) + 0.25 * wp.cw_div(b, a)
            above = high - wp.cw_mul(b, over)
            below = a - wp.cw_mul(low, over)
            # What a negative intensity gives must not pass for a margin.
            return wp.min(wp.min(above, below), wp.min(early, least)) + finite
        third = steepest * (longest * THIRD_NS)
        over = Run(1.0) + third + wp.cw_mul(third, third)
        margins = wp.min(high - wp.cw_mul(b, over), a - wp.cw_mul(low, over))
        return wp.min(margins, Run(0.999) - third) + finite + (early - early)

    @wp.func
    def run_margins(
        # in
        sensor: Sensor,
        state: FrequentState,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        longest: wp.float32,
        t_end: wp.int64,
    ):
        """Computes a run's margins. index, at: of the run's first pixel in the state and in the first frame."""
        margins = Run()
        if wp.static(cubic or hermite):
            margins = over_and_under(sensor, state, luminance_runs, slope_runs, index, at, stride, count, longest)
            margins = wp.max(margins, Run(-1.0))  # -1 for NaN
        else:
            margins = straight_margins(state, luminance_runs, index, at, stride, count)
        if wp.static(timed):
            wakes = state.wake_runs[index]
            if wp.min(wakes) <= t_end:
                for lane in range(wp.static(RUN)):
                    if wakes[lane] <= t_end:
                        margins[lane] = -1.0
        return margins

    return run_margins


@lru_cache
def make_pass_inactive(features: Features) -> tuple[Any, Any]:
    """Makes the functions `pass_inactive_run` and `pass_inactive_pixel`: they keep what is needed of a message in which
    nothing happened."""
    curved, hermite = features.curved, features.crossing == "hermite"

    @wp.func
    def pass_inactive_pixel(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        slopes: wp.array(dtype=wp.float32),
        index: wp.int32,
        at: wp.int64,
        stride: wp.int64,
        count: wp.int32,
        # in and out
        state: FrequentState,
    ):
        """Keeps what is needed of a pixel. at: its place in the last frame."""
        if wp.static(hermite):
            state.earlier[index] = state.early[index]
            if count > 1:
                state.earlier[index] = slope_of(sensor, slopes[at - stride], luminance[at - stride])
            state.early[index] = slope_of(sensor, slopes[at], luminance[at])
        elif wp.static(curved):
            before = state.last[index]
            if count > 2:
                state.earlier[index] = luminance[at - wp.int64(2) * stride]
            else:
                state.earlier[index] = wp.where(count == 2, before, state.early[index])
            if count > 1:
                before = luminance[at - stride]
            state.early[index] = before
        state.last[index] = luminance[at]

    @wp.func
    def pass_inactive_run(
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
        state: FrequentState,
    ):
        """Keeps what is needed of RUN pixels; without dark level L's slope is that of ln I."""
        if wp.static(hermite):
            if sensor.dark_level > wp.float64(0.0):
                lane = int(0)
                while lane < wp.static(RUN):
                    pass_inactive_pixel(
                        sensor, luminance, slopes, index + lane, at + wp.int64(lane), stride, count, state
                    )
                    lane += 1
                return
            state.earlier_runs[index] = state.early_runs[index]
            if count > 1:
                state.earlier_runs[index] = slope_runs[at - stride]
            state.early_runs[index] = slope_runs[at]
        elif wp.static(curved):
            before = state.last_runs[index]
            if count > 2:
                state.earlier_runs[index] = luminance_runs[at - wp.int64(2) * stride]
            elif count == 2:
                state.earlier_runs[index] = before
            else:
                state.earlier_runs[index] = state.early_runs[index]
            if count > 1:
                before = luminance_runs[at - stride]
            state.early_runs[index] = before
        state.last_runs[index] = luminance_runs[at]

    return pass_inactive_run, pass_inactive_pixel
