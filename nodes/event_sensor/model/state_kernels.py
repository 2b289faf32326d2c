"""What a pixel with a curve or a fault keeps, and what is compiled for it."""

from dataclasses import dataclass

import warp as wp

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
class Hot:
    """One pixel of Quiet.

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
class Cold:
    """What only a step with something in it looks at, 64 bytes together; the reference is as in Pixel."""

    base: wp.float64
    net: wp.int32
    n_off: wp.int32
    origin: wp.int64  # where the leak's drift is zero: the last reset before the episode
    dead: wp.int64  # end of the dead time
    next: wp.int64  # next candidate of the noise process
    draws: wp.int64  # its number
    c_on: wp.float32  # the pixel's own thresholds,
    c_off: wp.float32
    leak: wp.float32  # leak rate [Hz]
    hot: wp.float32  # and rate as a hot pixel [Hz]


@wp.func
def cold_of(
    base: wp.float64, net: wp.int32, n_off: wp.int32, origin: wp.int64, dead: wp.int64, following: wp.int64,
    draws: wp.int64, c_on: wp.float32, c_off: wp.float32, leak: wp.float32, hot: wp.float32,
):  # fmt: skip
    """A Cold of its fields."""
    cold = Cold()
    cold.base = base
    cold.net = net
    cold.n_off = n_off
    cold.origin = origin
    cold.dead = dead
    cold.next = following
    cold.draws = draws
    cold.c_on = c_on
    cold.c_off = c_off
    cold.leak = leak
    cold.hot = hot
    return cold
