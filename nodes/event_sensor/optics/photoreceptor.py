"""Filters log-intensity by the photoreceptor's finite bandwidth, a low pass whose corner falls with the light.

The pixel's front end turns photocurrent into a voltage in proportion to its logarithm, with a small-signal time
constant tau = C U_T / I_photo (Delbruck and Mead, ISCAS 1994; Lichtsteiner et al., JSSC 2008): it is the log-intensity
that is filtered, and the corner is proportional to the light up to where the bias current limits it. v2e (Hu et al.,
CVPRW 2021, section 3) has the same law with an Euler step. Here every step is the exact answer to an input whose L goes
linearly from one frame to the next,

    dy/dt = (L(t) - y) / tau,   1 / tau = 2 pi bandwidth_hz min(1, (I + I_dark) / bandwidth_level)^k,

k being bandwidth_exponent: 1 where the photocurrent sets the corner, 0 where a bias current does in any light. It is
stable at any dt / tau, and in constant light does not depend on the frame rate. Where tau changes within a
step, 1 / tau is the mean of its values at both ends, which is of second order in the step. Two poles are two equal low
passes one after the other.

On a CPU ln, exp and the step's response are polynomials good to 1e-9, on a GPU the library's functions: an event may
move by as much as 1e-9 ln I moves its crossing (a few ns), and a float32 result by its last bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.input.batch import SampleLists
from nodes.event_sensor.optics import photoreceptor_kernels as kernels
from nodes.event_sensor.optics import photoreceptor_simd_kernels as simd
from nodes.event_sensor.optics.photoreceptor_simd_kernels import Receptor
from nodes.event_sensor.parameters import FLOOR


def law_of(level: float, exponent: float) -> int:
    """Chooses the law of the corner: the same in any light, proportional to it below `level`, or a power of it."""
    if level <= 0 or exponent <= 0:
        return simd.CONSTANT
    return simd.PROPORTIONAL if exponent == 1 else simd.POWER


def receptor_struct(size: int, bandwidth_hz: float, level: float, exponent: float, dark: float) -> Receptor:
    """Fills in what kernels know of a photoreceptor; size: pixels and channels of an environment."""
    receptor: Any = Receptor()
    receptor.size, receptor.rate = size, 2.0 * math.pi * bandwidth_hz
    receptor.level, receptor.exponent, receptor.dark, receptor.floor = level, exponent, dark, FLOOR
    return receptor  # type: ignore[no-any-return]


class Photoreceptor:
    """Filters the light of E cameras of height x width pixels and 1 or 3 channels.

    bandwidth_hz: corner of each pole [Hz], above 0, at intensities from bandwidth_level on; below, it goes with I +
    dark_level to the power of `exponent`. bandwidth_level or exponent 0: the same for every intensity. poles: 1 or 2.
    dark_level: I_dark, in the unit of the luminance. chord: how far a line between two samples of `trace` may lie from
    the output [ln I]. State: 12 bytes per pixel and channel with one pole, 20 with two. Raises ValueError.
    """

    def __init__(
        self,
        height: int,
        width: int,
        envs: int = 1,
        channels: int = 1,
        bandwidth_hz: float = 300.0,
        bandwidth_level: float = 0.0,
        poles: int = 1,
        dark_level: float = 0.0,
        device: str = "cpu",
        chord: float = 0.004,
        exponent: float = 1.0,
    ) -> None:
        if not (math.isfinite(bandwidth_hz) and bandwidth_hz > 0):
            raise ValueError(f"bandwidth_hz {bandwidth_hz:g} must be above 0 and finite; without a limit leave it out")
        for level, text in ((bandwidth_level, "bandwidth_level"), (dark_level, "dark_level")):
            if not (math.isfinite(level) and level >= 0):
                raise ValueError(f"{text} {level:g} must be finite and not negative")
        if poles not in (1, 2):
            raise ValueError(f"bandwidth_poles {poles} must be 1 or 2")
        self._device = wp.get_device(device)
        law = law_of(bandwidth_level, exponent)
        gpu = self._device.is_cuda
        self._kernel = (
            kernels.make_filter_pixel(poles, law != simd.CONSTANT) if gpu else kernels.make_filter_blocks(poles, law)
        )
        self._kind, self._chord = (poles, law), chord
        self._tracer: Any = None
        self._envs, self._size = envs, height * width * channels
        self._receptor = receptor_struct(self._size, bandwidth_hz, bandwidth_level, exponent, dark_level)
        self._rate = 2.0 * math.pi * bandwidth_hz
        total = envs * self._size
        self._last: wp.array = wp.full(total, -1.0, dtype=wp.float32, device=self._device)
        self._first: wp.array = wp.zeros(total, dtype=wp.float64, device=self._device)
        self._second: wp.array = wp.zeros(total if poles == 2 else 0, dtype=wp.float64, device=self._device)
        self._place: wp.array = wp.empty(simd.BLOCK, dtype=wp.int32, device="cpu")
        self._filtered: wp.array | None = None
        self._unmarked: wp.array = wp.empty(0, dtype=wp.uint8, device="cpu")

    def advance(
        self, images: wp.array, t: np.ndarray, t_base: int, fresh: np.ndarray, in_place: bool = False
    ) -> wp.array:
        """Computes filtered luminance, float32 of the shape of `images`, in a buffer that the next call overwrites.

        images: float32, linear, on this device: the samples of [E, K, H, W, C] in this order, in any shape (Warp has
        four axes at most). t: int64 [K] ns, ascending. t_base: stamp [ns] of the frame before, where the first step
        starts. fresh: bool [E], environments whose first good sample here sets the state. ln(result + dark_level) is
        the filtered L. A sample that is NaN, infinite, negative, or 0 without dark current comes out as NaN; its input
        is held at the last good one. in_place: the result goes to `images`, which takes no further memory. Raises
        ValueError when the number of samples does not fit.
        """
        self._check(images, t)
        if in_place:
            filtered = images
        else:
            if self._filtered is None or self._filtered.shape != images.shape:
                self._filtered = wp.empty(images.shape, dtype=wp.float32, device=self._device)
            filtered = self._filtered
        self._filter(self._kernel, images.flatten(), t, t_base, fresh, filtered.flatten(), self._unmarked)
        return filtered

    def _check(self, images: wp.array, t: np.ndarray) -> None:
        count = len(t)
        if math.prod(images.shape) != self._envs * count * self._size:
            raise ValueError(
                f"photoreceptor got images {tuple(images.shape)} with {count} stamps, "
                f"expected {self._envs} x {count} x {self._size} samples"
            )

    def _filter(
        self, kernel: wp.Kernel, images: wp.array, t: np.ndarray, t_base: int, fresh: np.ndarray, filtered: wp.array,
        bent: wp.array,
    ) -> None:  # fmt: skip
        """Filters flat frames by a kernel; where that is one that marks pixels, in `bent`."""
        device, count = self._device, len(t)
        gaps = np.diff(np.asarray(t, np.int64), prepend=np.int64(t_base))
        seconds: wp.array = wp.array(np.maximum(gaps, 0) * 1e-9, dtype=wp.float64, device=device)
        steps: wp.array = wp.empty(count, dtype=wp.vec2d, device=device)
        wp.launch(kernels.responses, count, [self._rate, seconds], [steps], device=device)
        starts: wp.array = wp.array(np.asarray(fresh, np.int32), device=device)
        state = self._state()
        threads = (self._envs, self._size)
        if not device.is_cuda:
            threads = (self._envs, -(-self._size // simd.BLOCK))
            state.append(self._place)
        inputs, outputs = [self._receptor, starts, seconds, steps, images], [filtered]
        if not device.is_cuda:
            inputs.append(self._chord)
            outputs.append(bent)
        wp.launch(kernel, threads, [*inputs, *state], outputs, device=device)

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next frames go on from."""
        return dict(zip(("last", "first", "second"), self._state()))

    def _state(self) -> list[wp.array]:
        return [self._last, self._first, self._second]

    def trace(
        self, images: wp.array, lists: SampleLists | None, t: np.ndarray, t_base: int, fresh: np.ndarray
    ) -> tuple[wp.array, SampleLists | None]:
        """Filters frames and further samples as `advance` does, such that lines of ln(I + dark_level) between them are
        the output to within `chord`, whatever the samples of the input; None where lines from frame to frame will do.

        lists: further samples of the input, between which it is a line too. Returned arrays are overwritten by the next
        call. Steps longer than 2^31 ns get no samples but those that they have.
        """
        self._check(images, t)
        images = images.flatten()
        stamps: wp.array = wp.array(np.asarray(t, np.int64) - t_base, device=self._device)
        starts: wp.array = wp.array(np.asarray(fresh, np.int32), device=self._device)
        if self._tracer is None:
            from nodes.event_sensor.optics.trace import Tracer

            self._tracer = Tracer(*self._kind, self._receptor, self._chord, self._device)
        tracer, state = self._tracer, self._state()
        tracer.begin(images, state)
        if not self._device.is_cuda:
            kernel = kernels.make_filter_blocks(*self._kind, True)
            self._filter(kernel, images, t, t_base, fresh, tracer.filtered, tracer.bent)
        return tracer.filtered, tracer.trace(images, lists, stamps, starts, state)
