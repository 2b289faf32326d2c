# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""The threads that walk over the pixels of the sensor with curves and faults: rows on a CPU, pixels on a GPU."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.cpu.row_kernels import list_active_row
from nodes.event_sensor.cpu.run_kernels import passed, run_margins
from nodes.event_sensor.model.inactive_kernels import RUN, Quiet, Run, left_over, saved
from nodes.event_sensor.model.nonideal_kernels import sense_pixel
from nodes.event_sensor.model.pixel_kernels import LEFT, Sensor
from nodes.event_sensor.model.state_kernels import Cold, Features

wp.set_module_options({"enable_backward": False})


@wp.func_native("__builtin_prefetch(&wp::index(colds, 0, pixel), 1, 3);")
def fetch(colds: wp.array2d(dtype=Cold), pixel: wp.int32):
    """Bring what is kept of a pixel nearer."""
    ...


@lru_cache
def full_kernels(features: Features) -> tuple[Any, Any]:
    """(kernel over rows, kernel over pixels) with just these features."""
    sense, sense_alone = sense_pixel(features, True), sense_pixel(features, False)
    margins_of, (run_passes, pixel_passes) = run_margins(features), passed(features)
    looks_on, straight = features.crossing == "cubic", features.hasty

    @wp.kernel(module="unique")
    def sense_rows(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        episodes: wp.array2d(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        luminance_runs: wp.array(dtype=Run),
        dlog_dt: wp.array(dtype=wp.float32),
        slope_runs: wp.array(dtype=Run),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        resume: wp.int32,
        # in and out
        quiet: Quiet,
        side: wp.array(dtype=wp.int32),
        loud: wp.array(dtype=wp.int32),
        # out
        colds: wp.array2d(dtype=Cold),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One row per thread: on a CPU, where threads run one after the other, events come in the order of pixels."""
        env, y = wp.tid()
        if counters[LEFT] != wp.int64(0):
            return
        row = sensor.width * sensor.channels
        size = sensor.height * row
        start = env * size + y * row
        at_first = wp.int64(env) * wp.int64(frames) * wp.int64(size) + wp.int64(y * row)
        at_end = at_first + wp.int64(count - 1) * wp.int64(size)
        # Environments that begin here have no band yet, and a cubic without the frame after has another curve.
        whole = begin[env] == 0 and not (wp.static(looks_on) and frames == count)
        t_end = t[count - 1]
        longest = wp.float32(t[0] - t_base)
        k = int(1)
        while k < count:
            longest = wp.max(longest, wp.float32(t[k] - t[k - 1]))
            k += 1
        # First the pixels to which something may happen are listed, so that what is kept of them can be on its way.
        j = int(0)
        going_on = resume - 1 - start
        if resume > 0 and going_on >= row:
            return
        if resume > 0 and going_on >= 0:
            while loud[j + 1] < going_on:
                j += 1
        elif wp.static(straight) and whole:
            list_active_row(luminance, at_first, wp.int64(size), count, t_end, quiet, start, row, colds, loud)
        else:
            loud[0] = 0
            i = int(0)
            margins = Run()
            while i < row:
                lanes = wp.min(row - i, wp.static(RUN))
                margins = Run(-1.0)
                if wp.static(not features.coin and features.curved):
                    if whole and lanes == wp.static(RUN):
                        margins = margins_of(
                            sensor, quiet, luminance_runs, slope_runs, start + i, at_first + wp.int64(i),
                            wp.int64(size), count, longest, t_end,
                        )  # fmt: skip
                        if wp.min(margins) >= 0.0:
                            run_passes(
                                sensor, luminance, luminance_runs, dlog_dt, slope_runs, start + i, at_end + wp.int64(i),
                                wp.int64(size), count, quiet,
                            )  # fmt: skip
                            i += wp.static(RUN)
                            continue
                lane = int(0)
                while lane < lanes:
                    if margins[lane] >= 0.0:
                        pixel_passes(
                            sensor, luminance, dlog_dt, start + i, at_end + wp.int64(i), wp.int64(size), count, quiet
                        )  # fmt: skip
                    else:
                        loud[0] = loud[0] + 1
                        loud[loud[0]] = i
                        fetch(colds, start + i)
                    i += 1
                    lane += 1
        while j < loud[0]:
            i = loud[j + 1]
            kept = saved(counters)
            sense(
                sensor, env, y, i // sensor.channels, i % sensor.channels, begin[env], episodes, luminance,
                dlog_dt, frames, count, t, t_base, t_before,
                quiet, side, quiet, side, colds, keys, counters,
            )  # fmt: skip
            if left_over(sensor, kept, start + i, counters):
                return
            j += 1

    @wp.kernel(module="unique")
    def sense_pixels(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        episodes: wp.array2d(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        before: Quiet,
        side_before: wp.array(dtype=wp.int32),
        # out
        after: Quiet,
        side_after: wp.array(dtype=wp.int32),
        colds: wp.array2d(dtype=Cold),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One pixel and channel per thread, for a GPU; keys come out in any order and are sorted afterwards."""
        env, y, column = wp.tid()
        sense_alone(
            sensor, env, y, column // sensor.channels, column % sensor.channels, begin[env], episodes, luminance,
            dlog_dt, frames, count, t, t_base, t_before,
            before, side_before, after, side_after, colds, keys, counters,
        )  # fmt: skip

    return sense_rows, sense_pixels
