"""Runs the ideal sensor over pixels whose samples lie at times of their own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.exchange import as_warp
from nodes.audit.events_kernels import PixelStates, sense_samples
from nodes.event_sensor.engines.engine import sensor_struct
from nodes.event_sensor.model.keys import KeyLayout


class SampledSensor:
    """Simulates N pixels without noise, with linear crossings; `sense` takes the samples since the last call."""

    def __init__(self, pixels: int, parameters: Mapping[str, Any]) -> None:
        """parameters: resolved ones of the event sensor, of which thresholds and dark level count."""
        self._sensor = sensor_struct(parameters, (1, pixels, 1), KeyLayout.of(1, pixels, 1), 0)
        states: Any = PixelStates()
        types = {"begun": np.int32, "net": np.int32, "n_off": np.int32, "t": np.int64}
        for name in ("begun", "base", "net", "n_off", "level", "t"):
            setattr(states, name, wp.array(np.zeros(pixels, types.get(name, np.float64)), device="cpu"))
        self._states = states
        self._pixels = pixels

    def begin(self, which: np.ndarray) -> None:
        """Begins an episode for pixels bool [N]: their next sample is their reference."""
        self._states.begun.numpy()[which] = 0

    def sense(
        self, pixel: np.ndarray, t: np.ndarray, luminance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gives events (pixel int64, t int64 ns, p uint8), by pixel and time, of samples.

        pixel: int64 [S], ascending; t: int64 [S] ns, ascending within a pixel; luminance: float32 [S].
        """
        first = np.searchsorted(pixel, np.arange(self._pixels + 1)).astype(np.int64)
        count = np.zeros(self._pixels, np.int64)
        none, room = np.zeros(0, np.int64), np.zeros(self._pixels, np.int64)
        samples = [self._sensor, first, np.ascontiguousarray(t, np.int64), np.ascontiguousarray(luminance, np.float32)]
        self._launch([*samples, room, 0], [count, none, none.astype(np.uint8)])
        room = np.cumsum(count) - count
        t_out, p_out = np.zeros(int(count.sum()), np.int64), np.zeros(int(count.sum()), np.uint8)
        self._launch([*samples, room, 1], [count, t_out, p_out])
        return np.repeat(np.arange(self._pixels), count), t_out, p_out

    def _launch(self, inputs: list[Any], outputs: list[np.ndarray]) -> None:
        given = [as_warp(a) if isinstance(a, np.ndarray) else a for a in (*inputs, self._states, *outputs)]
        wp.launch(sense_samples, self._pixels, given, device="cpu")
