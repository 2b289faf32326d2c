# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""How a pixel with a curve or a fault makes its events."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.cpu.simd_fire_kernels import fire_lanes
from nodes.event_sensor.model.curve_kernels import at, crossing
from nodes.event_sensor.model.pixel_kernels import DROPPED, EVENTS, Sensor
from nodes.event_sensor.model.state_kernels import Features

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
    """One event. written: events of this pixel in this step so far."""
    if cap and written >= sensor.cap:
        wp.atomic_add(counters, DROPPED, wp.int64(1))
    else:
        slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
        if slot < sensor.capacity:
            keys[slot] = key


@lru_cache
def curve_value(features: Features) -> Any:
    """Function: S(u) of a step."""
    curved = features.curved

    @wp.func
    def value(s: wp.vec4d, u: wp.float64):
        if wp.static(curved):
            return at(s, u)
        return s[0] + u * s[1]

    return value


@lru_cache
def crossings_fired(features: Features, lanes: bool) -> Any:
    """Function: the events of n crossings in one monotone piece of a step; returns the last's time and the count.

    lanes: several events at a time, for a CPU.
    """
    curved, cap = features.curved, features.cap
    lanes, at_once = lanes and not features.refractory, fire_lanes(curved)

    @wp.func
    def fire(
        # in
        sensor: Sensor,
        s: wp.vec4d,
        reference: wp.float64,
        signed: wp.float64,
        n: wp.int32,
        u: wp.float64,
        piece: wp.float64,
        start: wp.int64,
        until: wp.int64,
        h: wp.float64,
        t_base: wp.int64,
        place: wp.int64,
        here: wp.int64,
        fired: wp.int32,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """signed: threshold with its sign. u, piece: the piece's ends; start, h: of the step [ns]. place: key but t."""
        time = here
        j = int(0)
        if wp.static(lanes):
            time = at_once(
                sensor, s, reference, signed, n, u, piece, start, until, h, t_base, place, here, fired, wp.static(cap),
                keys, counters,
            )  # fmt: skip
            j = n
        while j < n:
            level = reference + wp.float64(j + 1) * signed
            if wp.static(curved):
                root = crossing(s, level, u, piece)
                u = root
            else:
                root = piece
                if s[1] != wp.float64(0.0):
                    root = wp.clamp((level - s[0]) / s[1], u, piece)
            ns = start + wp.max(wp.int64(root * h + wp.float64(0.5)), wp.int64(1))
            time = wp.clamp(ns, time, until)
            emit(sensor, ((time - t_base) << sensor.shift_t) | place, fired + j, wp.static(cap), keys, counters)
            j += 1
        return time, fired + n

    return fire
