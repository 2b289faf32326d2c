"""Adds the noise of the photoreceptor to its output: a stationary Gaussian process with the photoreceptor's bandwidth.

The photocurrent's shot noise, white, goes through the poles that the light goes through. Its density relative to the
photocurrent is 2 q / I, and a low pass of corner f lets f / I of it through (times a constant): where the corner is in
proportion to the light the standard deviation is the same in any light (Delbruck and Mead, ISCAS 1994), and where a
bias current holds the corner it falls with the square root of the light. So Graca and Delbruck (2021) explain that real
pixels are noisier in the dark: at higher light the amplifier, and no longer the photocurrent, sets the bandwidth.

With sigma = photoreceptor_noise at I_n = photoreceptor_noise_level, and f the corner as in `photoreceptor.py`,

    sigma(I)^2 = sigma^2 f(I) / f(I_n) I_n / (I + I_dark),   at most 1,

or sigma in any light without a level. The process has its own instants, a given part of the shortest time constant
apart from the first frame of the episode on, and is a line between them: so it hangs on no frame, no message and no
further sample, and as each number is a hash of seed, pixel, episode and instant it is the same in any composition. The
sensor is told its instants as further samples of every pixel.

White noise of one pole is nowhere smooth: a line between instants leaves out what is faster, and the events that it
makes in constant light are three quarters of those of ever closer ones, of two poles 97 in a hundred (tests compare
with both).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.saved_arrays import joined, part_of, saved, write_back
from nodes.event_sensor.input.batch import Batch, SampleLists, Size
from nodes.event_sensor.input.between_kernels import between
from nodes.event_sensor.input.further import LONGEST
from nodes.event_sensor.input.limit import REMEDY
from nodes.event_sensor.optics import photoreceptor_noise_kernels as kernels
from nodes.event_sensor.optics.photoreceptor import law_of, receptor_struct

PARTS = {1: 8, 2: 4}
"""Instants of the noise within a time constant in full light, by the number of poles."""
AT_ONCE = 1 << 23
"""Samples of all pixels above which a message is sensed frame by frame: 64 MB of them."""
LONGEST_STEP = 2.0**61
"""Most time from one instant of the noise to the next [ns], 73 years, that an instant after the last stamp is int64."""
MOST_SAMPLES = 1 << 28
"""Most samples between two frames: 2 GB of them."""


class PhotoreceptorNoise:
    """Adds noise to the batches of a sensor; p: all of SENSOR, resolved. State: 20 bytes per pixel and channel with one
    pole, 28 with two."""

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        poles, level, exponent = p["bandwidth_poles"], p["bandwidth_level"], p["bandwidth_exponent"]
        law = law_of(level, exponent)
        self._size, self._device, self._hz = size, device, p["bandwidth_hz"]
        self._receptor = receptor_struct(size.pixels, self._hz, level, exponent, p["dark_level"])
        self._kernel = kernels.make_add_noise(poles, law)
        at = p["photoreceptor_noise_level"]
        self._step_ns = max(1, round(min(1e9 / (PARTS[poles] * self._receptor.rate), LONGEST_STEP)))
        """From one instant of the noise to the next."""
        noise: Any = kernels.Noise()
        noise.sigma, noise.level, noise.step, noise.seed = p["photoreceptor_noise"], at, self._step_ns, seed
        noise.share = min(1.0, at / level) ** exponent if at > 0 and law != kernels.CONSTANT else 1.0
        self._noise = noise
        self._begun = np.zeros(size.envs, np.int64)
        total = size.envs * size.pixels
        self._state: Any = kernels.NoiseState()
        self._state.last = wp.full(total, -1.0, dtype=wp.float32, device=device)
        self._state.first = wp.zeros(total if poles == 2 else 0, dtype=wp.float64, device=device)
        self._state.before = wp.zeros(total, dtype=wp.float64, device=device)
        self._state.after = wp.zeros(total, dtype=wp.float64, device=device)
        self._state.entry = wp.zeros(0, dtype=wp.int32, device=device)
        self._first: wp.array = wp.zeros(total + 1, dtype=wp.int32, device=device)
        self._frames: wp.array = wp.empty(0, dtype=wp.float32, device=device)
        self._offset: wp.array = wp.empty(0, dtype=wp.int32, device=device)
        self._value: wp.array = wp.empty(0, dtype=wp.float32, device=device)

    def state(self) -> dict[str, Any]:
        """Gives what the noise goes on from: its poles, and where episodes began [ns]."""
        return {"begun": self._begun.copy(), **joined({"poles": saved(self._present())})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` gave. Raises ValueError for other arrays."""
        write_back(self._present(), part_of(state, "poles"))
        self._begun = np.array(state["begun"], np.int64)

    def _present(self) -> dict[str, wp.array]:
        return {name: getattr(self._state, name) for name in ("last", "first", "before", "after")}

    def parts(self, batch: Batch) -> Iterator[Batch]:
        """Gives the batch in parts whose frames, and samples between them, have noise; each as long as its arrays are
        not overwritten by the next. Their light is exp(L), dark current and all.

        Raises ValueError for frames too far apart, before the first part.
        """
        stamps = np.asarray(batch.t, np.int64) - batch.t_base
        fresh = np.asarray(batch.begin) != 0
        given = 0 if batch.further is None else batch.further.offset.size
        ends = self._ends(stamps, batch.t_base, given)
        self._begun[fresh] = batch.t[0]
        there = {"dtype": wp.int64, "device": self._device}
        span: Any = kernels.Span()
        span.frames = len(stamps)
        span.stamps, span.origin = wp.array(stamps, **there), wp.array(self._begun - batch.t_base, **there)
        span.fresh = wp.array(fresh.astype(np.int32), dtype=wp.int32, device=self._device)
        span.episodes = wp.array(np.ascontiguousarray(batch.episodes[0], np.int32), dtype=wp.int32, device=self._device)
        if batch.further is not None and not self._state.entry.size:
            self._state.entry = wp.empty(self._first.size - 1, dtype=wp.int32, device=self._device)
        images = batch.images.flatten()
        for first, end in zip([0, *ends], ends):
            start = int(stamps[first - 1]) if first else 0
            span.first, span.count, span.start = first, end - first, start
            lists = self._add(images, batch.further, span)
            yield replace(
                batch, images=self._frames[: images.size // len(stamps) * (end - first)], t=batch.t[first:end],
                frames=end - first, count=end - first, t_base=batch.t_base + start,
                begin=batch.begin if first == 0 else np.zeros_like(batch.begin), further=lists,
            )  # fmt: skip

    def _ends(self, stamps: np.ndarray, t_base: int, given: int) -> list[int]:
        """Gives the numbers of the frames before which parts end. given: further samples of the message."""
        pixels = self._size.envs * self._size.pixels
        gaps = np.diff(stamps, prepend=0)
        counts = pixels * (gaps // self._step_ns + 1) + given
        worst = int(np.argmax(gaps))
        if counts[worst] > MOST_SAMPLES or gaps[worst] > LONGEST:
            start = t_base + int(stamps[worst] - gaps[worst])
            raise ValueError(
                f"photoreceptor_noise of bandwidth_hz {self._hz:g} has a sample of each pixel every {self._step_ns} "
                f"ns: {counts[worst]:.3g} of them from {start} ns to the frame at {t_base + stamps[worst]} ns, and at "
                f"most {MOST_SAMPLES} in {LONGEST * 1e-9:.3g} s between two frames; {REMEDY}, or lower bandwidth_hz"
            )
        ends, total = [], 0
        for k, count in enumerate(counts.tolist()):
            if k and total + count > AT_ONCE:
                ends.append(k)
                total = 0
            total += count
        return [*ends, len(counts)]

    def _add(self, images: wp.array, lists: SampleLists | None, span: Any) -> SampleLists | None:
        """Adds noise to a part of a message; gives the samples between its frames."""
        pixels, counts, given = self._first.size - 1, self._first[1:], between(lists)
        inputs = [self._receptor, self._noise, span, images, given]
        wp.launch(kernels.count_samples, pixels, [*inputs, self._state], [counts], device=self._device)
        wp.utils.array_scan(counts, counts, inclusive=True)
        count = int(self._first[-1:].numpy()[0])
        if count > self._offset.size:
            self._offset = wp.empty(count + count // 4, dtype=wp.int32, device=self._device)
            self._value = wp.empty(count + count // 4, dtype=wp.float32, device=self._device)
        if self._frames.size < pixels * span.count:
            self._frames = wp.empty(pixels * span.count, dtype=wp.float32, device=self._device)
        outputs = [self._frames, self._offset, self._value]
        wp.launch(self._kernel, pixels, [*inputs, self._first, self._state], outputs, device=self._device)
        return SampleLists(self._first, self._offset[:count], self._value[:count], 1) if count else None
