"""What a pixel with a curve or a fault keeps, and how it makes an event."""

from dataclasses import dataclass

import warp as wp

from nodes.event_sensor.kernels import DROPPED, EVENTS, Sensor

wp.set_module_options({"enable_backward": False})

ALIVE = wp.constant(wp.int64(-0x7FFFFFFFFFFFFFFF))
NOWHERE = wp.constant(wp.float64(1.0e300))
"""An L that is not known."""


@dataclass(frozen=True)
class Features:
    """What is compiled: one kernel for each set."""

    crossing: str
    leak: bool = False
    coin: bool = False
    noise: bool = False
    refractory: bool = False
    mismatch: bool = False
    cap: bool = False

    @property
    def ahead(self) -> bool:
        """The curve needs the frame after the step."""
        return self.crossing in ("cubic", "monotone")

    @property
    def curved(self) -> bool:
        """Not a straight line."""
        return self.ahead or self.crossing == "hermite"

    @property
    def timed(self) -> bool:
        """Something can happen without a change of the light."""
        return self.leak or self.noise or self.refractory

    @property
    def hasty(self) -> bool:
        """A pixel within its band need not be looked at."""
        return not self.curved and not self.coin


@wp.struct
class Warm:
    """What a step looks at if something may happen in it, or if it has a curve.

    early, earlier: the samples before the last one (cubic, monotone; negative: unknown), or the slopes dL/dt [1/s] at
    the last and before (hermite). side: which of the cold states is this one's.
    """

    early: wp.float32
    earlier: wp.float32
    side: wp.int32


@wp.struct
class Hot:
    """One pixel of Quiet, and its Warm."""

    last: wp.float32
    low: wp.float32
    high: wp.float32
    early: wp.float32
    earlier: wp.float32
    wake: wp.int64


@wp.struct
class Cold:
    """What only a step with something in it looks at, 64 bytes together; the reference is as in Pixel."""

    base: wp.float64
    net: wp.int32
    n_off: wp.int32
    origin: wp.int64  # where the leak's drift is zero
    dead: wp.int64  # end of the dead time
    next: wp.int64  # next candidate of the noise process
    draws: wp.int64  # its number
    c_on: wp.float32  # the pixel's own thresholds,
    c_off: wp.float32
    leak: wp.float32  # leak rate [Hz]
    hot: wp.float32  # and rate as a hot pixel [Hz]


@wp.struct
class Levels:
    """L at the samples earlier, early, last and next; NOWHERE where not yet computed."""

    earlier: wp.float64
    early: wp.float64
    last: wp.float64
    next: wp.float64


@wp.func
def unknown_levels(last: wp.float64):
    """No L but the last."""
    levels = Levels()
    levels.earlier = NOWHERE
    levels.early = NOWHERE
    levels.last = last
    levels.next = NOWHERE
    return levels


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
