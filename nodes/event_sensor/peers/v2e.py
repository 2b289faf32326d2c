"""Implements v2e: crossings are counted per frame, stamps lie on a grid set by the busiest pixel, noise is drawn per
frame.

Hu, Liu, Delbruck, "v2e: From Video Frames to Realistic DVS Events", CVPR Workshops 2021, section 4, with the rules of
its public program (v2e, emulator.py and emulator_utils.py): log or lin-log input; a first-order low pass stepped by
Euler, eps = min(1, (DN + 20) / 275 * dt / tau); leak that lowers the remembered value; n = floor(difference / C);
the i-th event of every pixel at t_before + i / n_max * dt, n_max being the crossings of the busiest pixel; a dead time
that is looked at only when it is longer than dt / n_max, and whose suppressed event comes back with the next frame;
shot noise of at most one event per pixel and frame, stamped at the frame, after which the pixel remembers the present.

Limits that are the model's: stamps depend on other pixels; leak and shot noise depend on the frame rate once
rate x dt is not small; the Euler step is wrong once dt is not small against tau.
Departures: stamps are whole ns, not float32 s; with log input the low pass and the noise follow the intensity, not its
logarithm; a pixel's level is float32 as in v2e.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
import warp as wp

from nodes.event_sensor.parameters import OF_MODEL
from nodes.event_sensor.peers import v2e_kernels as kernels
from nodes.event_sensor.peers.model import Model, filled

NOISY = {
    "threshold": 0.2,
    "threshold_mismatch": 0.05,
    "bandwidth_hz": 30.0,
    "leak_rate": 0.1,
    "leak_jitter": 0.1,
    "shot_rate": 5.0,
    "rate_spread_decades": 0.1,
}
"""v2e's own preset "noisy" (emulator.py, set_dvs_params), in the names used here."""


class V2e(Model):
    """Simulates v2e. shot_white is the luminance of 255 DN; lin-log input takes DN = min(255, 255 I / shot_white)."""

    NAME: ClassVar[str] = "v2e"
    USES: ClassVar[tuple[str, ...]] = (
        "threshold_mismatch", "threshold_floor", "dark_level", "refractory_us", "leak_rate", "leak_jitter", "shot_rate",
        "shot_white", "bandwidth_hz",
    )  # fmt: skip
    OWN = OF_MODEL["v2e"]

    def __init__(self, height: int, width: int, envs: int = 1, *, seed: int = 0, **params: Any) -> None:
        super().__init__(height, width, envs, seed=seed, **params)
        p = self.params
        same = ("threshold_on", "threshold_off", "leak_rate", "leak_jitter", "shot_rate")
        sensor = filled(
            kernels.V2eSensor(), **{name: p[name] for name in same}, dark=p["dark_level"], linlog=int(p["linlog"]),
            dn=255.0 / p["shot_white"], refractory=round(p["refractory_us"] * 1e3),
            tau=1.0 / (2.0 * math.pi * p["bandwidth_hz"]) if p["bandwidth_hz"] > 0 else 0.0,
        )  # fmt: skip
        self._on, self._off, self._spread = self._fixed_pattern()
        size = envs * self._pixels
        self._keep(sensor, kernels.V2ePixel)
        self._crossings, self._shots = (wp.zeros(size, dtype=wp.int32, device="cpu") for _ in range(2))
        self._busiest = wp.zeros(envs, dtype=wp.int32, device="cpu")

    def _fixed_pattern(self) -> list[wp.array]:
        """Draws per pixel: ON threshold, OFF threshold, factor of the leak rate; each environment has its own."""
        p = self.params
        draws = np.stack([np.random.default_rng(self.seed + e).standard_normal((3, self._pixels))
                          for e in range(self.envs)], 1)  # fmt: skip
        on, off = (
            np.maximum(p[name] + p["threshold_mismatch"] * draw, p["threshold_floor"] * (p["threshold_mismatch"] > 0))
            for name, draw in zip(("threshold_on", "threshold_off"), draws)
        )
        spread = 10.0 ** (p["rate_spread_decades"] * draws[2])
        return [wp.array(a.astype(np.float32).reshape(-1), device="cpu") for a in (on, off, spread)]

    def prepare(self, frame: Any, images: wp.array, fresh: wp.array) -> None:
        self._busiest.zero_()
        inputs = [frame, self._sensor, images, fresh, self._on, self._off, self._spread]
        outputs = [self._before, self._crossings, self._shots, self._busiest, self._counters]
        wp.launch(kernels.v2e_levels, len(self._before), inputs, outputs, device="cpu")

    def emit(self, frame: Any, images: wp.array, fresh: wp.array, keys: wp.array, counters: wp.array) -> None:
        inputs = [frame, self._sensor, self._on, self._off, self._crossings, self._shots, self._busiest, self._before]
        wp.launch(kernels.v2e_emit, len(self._before), inputs, [self._after, keys, counters], device="cpu")
