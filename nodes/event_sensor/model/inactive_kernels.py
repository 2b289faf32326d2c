# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""What every step looks at: the last sample and the quiet band, tested for RUN pixels at a time.

On a CPU the state is changed in place: a pixel that finds no room for its events leaves its state as it was and its
number in counters[LEFT], every later one does nothing, and the next launch goes on from there. On a GPU the state
before and after a message are two, and the launch is made again.
"""

from typing import Any

import warp as wp

from nodes.event_sensor.model.pixel_kernels import EVENTS, LEFT, Sensor

wp.set_module_options({"enable_backward": False})

RUN = 16
LOOK_BACK = ("early", "earlier")
Run = wp.types.vector(length=RUN, dtype=wp.float32)
Stamps = wp.types.vector(length=RUN, dtype=wp.int64)


@wp.struct
class Quiet:
    """Per pixel and channel. Intensities in [low, high] cannot fire before `wake` [ns]; low infinite: no reference yet.

    early, earlier: what a curve looks back at, see Hot. Element i of the arrays of runs is the RUN values from i on.
    wake is empty where nothing is timed, early and earlier where there is no curve.
    """

    last: wp.array(dtype=wp.float32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    early: wp.array(dtype=wp.float32)
    earlier: wp.array(dtype=wp.float32)
    wake: wp.array(dtype=wp.int64)
    last_runs: wp.array(dtype=Run)
    low_runs: wp.array(dtype=Run)
    high_runs: wp.array(dtype=Run)
    early_runs: wp.array(dtype=Run)
    earlier_runs: wp.array(dtype=Run)
    wake_runs: wp.array(dtype=Stamps)


@wp.func
def quiet_margins(
    quiet: Quiet, luminance_runs: wp.array(dtype=Run), index: wp.int32, at: wp.int64, stride: wp.int64, count: wp.int32
):
    """By how much the `count` samples of RUN pixels stay in their bands; below 0 where one does not."""
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
    margins = wp.min(least - quiet.low_runs[index], quiet.high_runs[index] - most) + finite
    return wp.max(margins, Run(-1.0))  # -1 for NaN


@wp.func
def saved(counters: wp.array(dtype=wp.int64)):
    """The counters before a pixel."""
    return wp.vector(counters[0], counters[1], counters[2], counters[3], counters[4])


@wp.func
def left_over(
    sensor: Sensor, before: wp.types.vector(length=5, dtype=wp.int64), index: wp.int32,
    counters: wp.array(dtype=wp.int64),
):  # fmt: skip
    """True, and the counters as before this pixel, when its events did not fit."""
    if counters[EVENTS] <= sensor.capacity:
        return False
    for i in range(5):
        counters[i] = before[i]
    counters[LEFT] = wp.int64(index + 1)
    return True


def runs_of(values: wp.array, run: Any = Run) -> wp.array:
    """A view of flat values in which element i is the RUN values from i on."""
    length = max(values.size - RUN + 1, 0)
    return wp.array(ptr=values.ptr, dtype=run, shape=length, strides=values.strides, device=values.device)


def quiet_state(total: int, timed: bool, curved: bool, device: Any) -> Quiet:
    """State of `total` pixels that have no reference yet."""
    quiet = Quiet()
    for name in ("last", "low", "high", "early", "earlier"):
        values = wp.full(
            0 if name in LOOK_BACK and not curved else total,
            float("inf") if name == "low" else 0.0,
            dtype=wp.float32,
            device=device,
        )
        setattr(quiet, name, values)
        setattr(quiet, f"{name}_runs", runs_of(values))
    quiet.wake = wp.zeros(total if timed else 0, dtype=wp.int64, device=device)
    quiet.wake_runs = runs_of(quiet.wake, Stamps)
    return quiet


def arrays_of(quiet: Quiet) -> tuple[wp.array, ...]:
    """Its arrays, without the views."""
    return quiet.last, quiet.low, quiet.high, quiet.early, quiet.earlier, quiet.wake
