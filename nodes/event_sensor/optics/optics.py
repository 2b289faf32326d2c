"""Applies what comes before the threshold: the lens's blur and the photoreceptor, each only where asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.input.batch import SampleLists
from nodes.event_sensor.optics import slope_kernels

CHORD = 1 / 50
"""Of the smaller threshold: how far a line between two of its samples may lie from the photoreceptor's output."""


class Optics:
    """Models lens and photoreceptor of E sensors of height x width pixels in `channels` channels."""

    def __init__(
        self, height: int, width: int, envs: int, channels: int, p: Mapping[str, Any], slopes: bool, device: Any
    ) -> None:
        self._shape = (-1, height, width, channels)
        self._device = device
        self._defocus = self._defocus_slopes = self._photoreceptor = None
        if p["defocus_px"] > 0:
            from nodes.event_sensor.optics.defocus import Defocus

            self._defocus = Defocus(p["defocus_px"], str(device))
            if slopes:
                self._defocus_slopes = Defocus(p["defocus_px"], str(device))
        if p["bandwidth_hz"] > 0:
            from nodes.event_sensor.optics.photoreceptor import Photoreceptor

            self._photoreceptor = Photoreceptor(
                height,
                width,
                envs,
                channels,
                bandwidth_hz=p["bandwidth_hz"],
                bandwidth_level=p["bandwidth_level"],
                exponent=p["bandwidth_exponent"],
                poles=p["bandwidth_poles"],
                dark_level=p["dark_level"],
                device=str(device),
                chord=CHORD * min(p["threshold_on"], p["threshold_off"]),
            )

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next frames go on from; none without a photoreceptor, as the lens keeps none."""
        return {} if self._photoreceptor is None else self._photoreceptor.present()

    @property
    def traces(self) -> bool:
        """Tells whether the output is a curve between the samples of the input."""
        return self._photoreceptor is not None

    def traced(
        self, images: wp.array, lists: SampleLists | None, t: np.ndarray, before: int, fresh: np.ndarray
    ) -> tuple[wp.array, SampleLists | None]:
        """Passes flat frames and further samples through the photoreceptor, as Photoreceptor.trace; see `seen`."""
        assert self._photoreceptor is not None
        return self._photoreceptor.trace(images, lists, t, before, fresh)

    @property
    def clear(self) -> bool:
        """Tells whether frames pass unchanged."""
        return self._defocus is None and self._photoreceptor is None

    def seen(self, images: wp.array, t: np.ndarray, before: int, fresh: np.ndarray) -> wp.array:
        """Takes flat frames through lens and photoreceptor.

        before: the stamp before t[0]; fresh: where an episode begins.
        """
        if self._defocus is not None:
            images = self._defocus(images.reshape(self._shape)).flatten()
        if self._photoreceptor is not None:
            blurred = self._defocus is not None  # the blur's own buffer, not the frames of whoever called
            images = self._photoreceptor.advance(images.flatten(), t, before, fresh, in_place=blurred).flatten()
        return images

    def slopes(self, slopes: wp.array, sharp: wp.array, seen: wp.array) -> wp.array:
        """Computes d ln I/dt of what is seen: the blur is linear in I, so it is (blur of I times slope) / (blur of
        I)."""
        if self._defocus_slopes is None:
            return slopes
        slopes, sharp = slopes.flatten(), sharp.flatten()
        change: wp.array = wp.empty_like(slopes)
        wp.launch(slope_kernels.product, len(slopes), [slopes, sharp], [change], device=self._device)
        blurred = self._defocus_slopes(change.reshape(self._shape)).flatten()
        wp.launch(slope_kernels.quotient, len(slopes), [blurred, seen], [change], device=self._device)
        return change
