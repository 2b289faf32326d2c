"""Holds the state of a pixel between messages: what every step reads, and what only a step with an event reads.

Intensities in a pixel's inactive range [low, high] cannot fire; low infinite: it has no reference yet. Its reference is
threshold_kernels.reference_level of base, net and n_off (which wraps after 2^31 OFF events; that matters where C_on and
C_off differ). These fields lie apart where that is faster: the ideal sensor on a CPU keeps Reference beside three float
arrays that its vector code reads (cpu.simd_kernels.IdealState), on a GPU each field is an array so that neighbouring
threads read neighbouring words (cuda.ideal_kernels.IdealState), and with faults the fields that few steps need share a
line of the cache (Rare). The paper's equations need no range (paper_kernels.PaperPixel).
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

NOT_REFRACTORY = wp.constant(wp.int64(-0x7FFFFFFFFFFFFFFF))
UNKNOWN_LEVEL = wp.constant(wp.float64(1.0e300))
"""L that is not known."""
RUN = 16
"""Pixels that a CPU looks at together."""
LOOK_BACK = ("early", "earlier")
Run = wp.types.vector(length=RUN, dtype=wp.float32)
Stamps = wp.types.vector(length=RUN, dtype=wp.int64)


@wp.struct
class Reference:
    """Holds the reference of a pixel, see threshold_kernels.reference_level."""

    base: wp.float64
    net: wp.int32
    n_off: wp.int32


@wp.struct
class Pixel:
    """Holds one pixel and channel of the ideal sensor: last sample, inactive range, events since `base` (which is
    apart)."""

    last: wp.float32
    low: wp.float32
    high: wp.float32
    net: wp.int32
    n_off: wp.int32


@wp.struct
class FrequentState:
    """Holds what every step reads, per pixel and channel. Intensities in [low, high] cannot fire before `wake` [ns].

    early, earlier: what a curve looks back at, see Frequent. Element i of the arrays of runs is the RUN values from i
    on. wake is empty where nothing is timed, early and earlier where there is no curve.
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


@wp.struct
class Frequent:
    """Holds what every step reads of one pixel, see FrequentState.

    early, earlier: the samples before the last one (cubic, monotone; negative: unknown), or the slopes dL/dt [1/s] at
    the last and before (hermite).
    """

    last: wp.float32
    low: wp.float32
    high: wp.float32
    early: wp.float32
    earlier: wp.float32
    wake: wp.int64


@wp.struct
class Rare:
    """Holds what only a step that may have an event reads of a pixel: 64 bytes, one cache line.

    origin: the last reset before the episode [ns], where the leak's drift is zero; with a Bernoulli leak the episode's
    start.
    """

    base: wp.float64
    net: wp.int32
    n_off: wp.int32
    origin: wp.int64
    refractory_until: wp.int64  # end of the refractory period, NOT_REFRACTORY where there is none
    next_noise: wp.int64  # next candidate of the noise process
    noise_draws: wp.int64  # its number
    c_on: wp.float32  # the pixel's own thresholds,
    c_off: wp.float32
    leak_rate: wp.float32  # [Hz]
    hot_rate: wp.float32  # as a hot pixel [Hz]


@wp.func
def read_frequent(state: FrequentState, index: wp.int32):
    """Reads the state of a pixel that every step needs."""
    frequent = Frequent()
    frequent.last = state.last[index]
    frequent.low = state.low[index]
    frequent.high = state.high[index]
    if index < state.early.shape[0]:
        frequent.early = state.early[index]
        frequent.earlier = state.earlier[index]
    if index < state.wake.shape[0]:
        frequent.wake = state.wake[index]
    return frequent


@wp.func
def write_frequent(state: FrequentState, index: wp.int32, frequent: Frequent):
    """Writes back the state of a pixel that every step needs; fields without an array are left out."""
    state.last[index] = frequent.last
    state.low[index] = frequent.low
    state.high[index] = frequent.high
    if index < state.early.shape[0]:
        state.early[index] = frequent.early
        state.earlier[index] = frequent.earlier
    if index < state.wake.shape[0]:
        state.wake[index] = frequent.wake


def runs_of(values: wp.array, run: Any = Run) -> wp.array:
    """Returns a view of flat values in which element i is the RUN values from i on."""
    length = max(values.size - RUN + 1, 0)
    return wp.array(ptr=values.ptr, dtype=run, shape=length, strides=values.strides, device=values.device)


def frequent_state(total: int, timed: bool, curved: bool, device: Any) -> FrequentState:
    """Makes the state of `total` pixels that have no reference yet."""
    state = FrequentState()
    for name in ("last", "low", "high", "early", "earlier"):
        values = wp.full(
            0 if name in LOOK_BACK and not curved else total,
            float("inf") if name == "low" else 0.0,
            dtype=wp.float32,
            device=device,
        )
        setattr(state, name, values)
        setattr(state, f"{name}_runs", runs_of(values))
    state.wake = wp.zeros(total if timed else 0, dtype=wp.int64, device=device)
    state.wake_runs = runs_of(state.wake, Stamps)
    return state


def arrays_of(state: FrequentState) -> tuple[wp.array, ...]:
    """Returns the arrays, without the views."""
    return state.last, state.low, state.high, state.early, state.earlier, state.wake
