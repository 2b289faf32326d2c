# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Writes the events of a pixel with a curve or a fault."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.crossing_kernels import polynomial, root_of_cubic, root_of_line, stamp_of
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.key_kernels import key_time
from nodes.event_sensor.model.sensor_kernels import DROPPED, EVENTS, Sensor
from nodes.event_sensor.model.step_kernels import Step, StepProgress

wp.set_module_options({"enable_backward": False})


@wp.func
def emit(
    sensor: Sensor,
    key: wp.int64,
    written: wp.int32,
    cap: wp.bool,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Writes one event; counts it even where it does not fit.

    written: events of this pixel in this step so far.
    """
    if cap and written >= sensor.event_cap:
        wp.atomic_add(counters, DROPPED, wp.int64(1))
    else:
        slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
        if slot < sensor.capacity:
            keys[slot] = key


@lru_cache
def make_curve_value(features: Features) -> Any:
    """Makes the function `curve_value`, S(u) of a step."""
    curved = features.curved

    @wp.func
    def curve_value(s: wp.vec4d, u: wp.float64):
        if wp.static(curved):
            return polynomial(s, u)
        return s[0] + u * s[1]

    return curve_value


@lru_cache
def make_emit_crossings(features: Features, at_once: Any = None) -> Any:
    """Makes the function `emit_crossings`: it writes the events of n crossings in one monotone piece of a step.

    It returns the time of the last. at_once: the same for all n together, see
    cpu.crossings_simd_kernels.
    """
    curved, cap = features.curved, features.cap
    together = at_once is not None and not features.refractory

    @wp.func(inline=True)
    def emit_crossings(
        # in
        sensor: Sensor,
        t_base: wp.int64,
        step: Step,
        s: wp.vec4d,
        progress: StepProgress,
        signed: wp.float64,
        n: wp.int32,
        piece: wp.float64,
        until: wp.int64,
        key: wp.int64,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Writes the events of the n levels beyond the reference that the curve s has between progress.u and `piece`.

        t_base: the message's start [ns]. signed: threshold with its sign. until: no event is later [ns]. key: but t.
        """
        time = wp.int64(progress.last_time)
        j = int(0)
        if wp.static(together):
            time = at_once(
                sensor, s, progress.reference, signed, n, progress.u, piece, step.start, until, step.h, t_base, key,
                time, progress.fired, wp.static(cap), keys, counters,
            )  # fmt: skip
            j = n
        u = wp.float64(progress.u)
        while j < n:
            level = progress.reference + wp.float64(j + 1) * signed
            if wp.static(curved):
                root = root_of_cubic(s, level, u, piece)
                u = root
            else:
                root = root_of_line(s, level, u, piece)
            time = wp.clamp(stamp_of(root, step.h, step.start), time, until)
            emit(sensor, key_time(sensor, time - t_base) | key, progress.fired + j, wp.static(cap), keys, counters)
            j += 1
        return time

    return emit_crossings
