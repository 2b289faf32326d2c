"""Finds all crossings of a monotone piece of a step at once, eight by eight: in C++, on a CPU.

The same as model.emission_kernels event by event, in the same arithmetic; only the roots of a cubic are found
inside one bracket for all and not from root to root, which may move an event by a nanosecond.
"""

from pathlib import Path
from typing import Any

import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.cpu.simd_kernels import CONSTANTS
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})

CROSSINGS = Path(__file__).with_name("crossings_simd.h")
CALL = """
return emit_crossings(ROOTS, sensor, s, reference, threshold, n, u, piece, start, until, h, t_base, place, here, fired,
                      cap, keys, counters);"""


@wp.func_native(native_code([CROSSINGS], CALL.replace("ROOTS", "line_roots"), CONSTANTS))
def fire_on_line(
    sensor: Sensor, s: wp.vec4d, reference: wp.float64, threshold: wp.float64, n: wp.int32, u: wp.float64,
    piece: wp.float64, start: wp.int64, until: wp.int64, h: wp.float64, t_base: wp.int64, place: wp.int64,
    here: wp.int64, fired: wp.int32, cap: wp.bool, keys: wp.array(dtype=wp.int64), counters: wp.array(dtype=wp.int64),
) -> wp.int64:  # fmt: skip
    """Writes the events of n crossings of a straight line; returns the last's time.

    keys: with SPARE places beyond its capacity. Parameters as of `emit_crossings` in emission_kernels; threshold with
    its sign; cap: no more than sensor.event_cap a step.
    """
    ...


@wp.func_native(native_code([CROSSINGS], CALL.replace("ROOTS", "cubic_roots"), CONSTANTS))
def fire_on_curve(
    sensor: Sensor, s: wp.vec4d, reference: wp.float64, threshold: wp.float64, n: wp.int32, u: wp.float64,
    piece: wp.float64, start: wp.int64, until: wp.int64, h: wp.float64, t_base: wp.int64, place: wp.int64,
    here: wp.int64, fired: wp.int32, cap: wp.bool, keys: wp.array(dtype=wp.int64), counters: wp.array(dtype=wp.int64),
) -> wp.int64:  # fmt: skip
    """Writes the events of n crossings of a cubic."""
    ...


def crossings_at_once(curved: bool) -> Any:
    """Returns the function for a step's curve."""
    return fire_on_curve if curved else fire_on_line
