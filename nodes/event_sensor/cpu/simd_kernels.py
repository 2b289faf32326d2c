"""Takes many pixels through one step, on a CPU: functions in C++ whose loops the compiler turns into vector code.

The strides of a Warp array are known only when it runs, so a compiler cannot vectorise over it; the arrays here are
contiguous.

What is computed is what model.threshold_kernels and model.crossing_kernels say, in float64 and without fused
multiply-add, so that every machine finds the same; ln is a polynomial whose error is below one unit in the last place.
"""

from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.model.sensor_kernels import (
    CLIPPED,
    DROPPED,
    EVENTS,
    GUARD,
    LARGEST,
    NONFINITE,
    SMALLEST,
    TOLERANCE,
    Sensor,
)
from nodes.event_sensor.model.state_kernels import Reference

wp.set_module_options({"enable_backward": False})

BLOCK = 2048
"""Pixels that are looked at together: their state stays in the nearest cache for all steps of a call."""
SPARE = 8
"""Places that a list of keys needs beyond its events."""


@wp.struct
class IdealState:
    """Holds the state per pixel and channel, see model.state_kernels: last sample, inactive range and reference.

    last: the sample before the call, or the last good one.
    """

    last: wp.array(dtype=wp.float32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    level: wp.array(dtype=Reference)


@wp.struct
class Listed:
    """Lists pixels of a block in which a step may have an event, each array with a place for every pixel of a block.

    place: in the block. before, after: the samples at the step's ends. reference: before the step; its crossing of
    level j, j = 1..count, is at (reference + j threshold - origin) slope [ns] from the step's start, threshold having
    its sign. tail: of the events' keys. base, net, n_off, low, high: the state after the step. set_aside: how many
    samples were not finite and how many below the floor, of them all.
    """

    place: wp.array(dtype=wp.int32)
    before: wp.array(dtype=wp.float32)
    after: wp.array(dtype=wp.float32)
    reference: wp.array(dtype=wp.float64)
    threshold: wp.array(dtype=wp.float64)
    origin: wp.array(dtype=wp.float64)
    slope: wp.array(dtype=wp.float64)
    count: wp.array(dtype=wp.int32)
    tail: wp.array(dtype=wp.int64)
    base: wp.array(dtype=wp.float64)
    net: wp.array(dtype=wp.int32)
    n_off: wp.array(dtype=wp.int32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    set_aside: wp.array(dtype=wp.int64)


def room_for_block() -> Any:
    """Makes a Listed for a block."""
    work: Any = Listed()
    for name, field in Listed.vars.items():
        setattr(work, name, wp.zeros(BLOCK, dtype=field.type.dtype, device="cpu"))
    return work


LOGARITHM = Path(__file__).with_name("logarithm.h")
IDEAL = Path(__file__).with_name("ideal_simd.h")
CONSTANTS: dict[str, Any] = {
    "LARGEST": np.float32(LARGEST),
    "SMALLEST": float(SMALLEST),
    "GUARD": float(GUARD),
    "TOLERANCE": float(TOLERANCE),
    "EVENTS": int(EVENTS),
    "NONFINITE": int(NONFINITE),
    "CLIPPED": int(CLIPPED),
    "DROPPED": int(DROPPED),
}
"""What the headers have of the model."""


def ideal(call: str) -> str:
    """Returns the code of a function of ideal_simd.h, with this call of it."""
    return native_code([LOGARITHM, IDEAL], call, CONSTANTS)


@wp.func_native(ideal("return list_active(luminance, at, ahead, state, index, size, work);"))
def list_active(
    luminance: wp.array(dtype=wp.float32), at: wp.int64, ahead: wp.int64, state: IdealState, index: wp.int32,
    size: wp.int32, work: Listed,
) -> wp.int32:  # fmt: skip
    """Lists the pixels of a block whose sample is not in the inactive range; returns how many there are.

    at, index: of the block's first pixel, in the frame and in the state. ahead: how far from here the samples lie that
    will be looked at next. size: of the block.
    """
    ...


@wp.func_native(ideal("take_samples(sensor, luminance, at, stride, k, state, index, n, work);"))
def take_samples(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, k: wp.int32,
    state: IdealState, index: wp.int32, n: wp.int32, work: Listed,
):  # fmt: skip
    """Takes the samples at both ends of step k of the n listed pixels; the last good one stands for one that is not.

    stride: from frame to frame.
    """
    ...


@wp.func_native(ideal("return cross_levels(sensor, span, state, index, first, n, work);"))
def cross_levels(
    sensor: Sensor, span: wp.int64, state: IdealState, index: wp.int32, first: wp.int32, n: wp.int32, work: Listed
) -> wp.int64:
    """Finds what a step of `span` ns does to the n pixels that are listed; returns the number of events.

    first: the block's first pixel in its environment.
    """
    ...


@wp.func_native(ideal("commit(index, n, work, state, counters);"))
def commit(index: wp.int32, n: wp.int32, work: Listed, state: IdealState, counters: wp.array(dtype=wp.int64)):
    """Writes the state after the step."""
    ...


@wp.func_native(ideal("emit_listed(sensor, span, stamped, n, work, keys, at);"))
def emit_listed(
    sensor: Sensor, span: wp.int64, stamped: wp.bool, n: wp.int32, work: Listed, keys: wp.uint64, at: wp.int64
):
    """Writes the keys of the events, with their time from the step's start, to the address `keys`, from place `at` on.

    Up to SPARE - 1 places beyond them are overwritten. stamped: events are at the step's end.
    """
    ...


@wp.func_native(ideal("keep_last(sensor, luminance, at, stride, count, index, size, state);"))
def keep_last(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, count: wp.int32,
    index: wp.int32, size: wp.int32, state: IdealState,
):  # fmt: skip
    """Keeps the last good samples of a block, whose first pixel is at `at` in the last of `count` frames."""
    ...


@wp.func_native(ideal("return leave_further(first, shared, index, n, work);"))
def leave_further(
    first: wp.array(dtype=wp.int32), shared: wp.int32, index: wp.int32, n: wp.int32, work: Listed
) -> wp.int32:
    """Takes those with further samples out of the n listed pixels; returns how many are left.

    first, shared: see batch.SampleLists. index: of the block's first pixel.
    """
    ...


@wp.func_native(
    ideal("keep_last_of_others(sensor, luminance, at, stride, count, index, size, first, shared, state, work);")
)
def keep_last_of_others(
    sensor: Sensor, luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, count: wp.int32,
    index: wp.int32, size: wp.int32, first: wp.array(dtype=wp.int32), shared: wp.int32, state: IdealState, work: Listed,
):  # fmt: skip
    """Keeps the last good samples as keep_last does, of the pixels of a block that have no further samples."""
    ...
