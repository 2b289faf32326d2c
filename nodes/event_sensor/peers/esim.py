"""Implements ESIM: log-luminance is linear between frames, with a running reference per pixel.

Rebecq, Gehrig, Scaramuzza, "ESIM: an Open Event Camera Simulator", CoRL 2018, section 3 (an event whenever
|L - L_ref| = C, L linear between two frames), with the rules of its public program (rpg_esim, event_simulator.cpp):
a change of less than 1e-6 between frames is passed over; a level counts when it lies in (L_before, L_now]; an event in
the dead time is dropped and the reference moves all the same; thresholds with noise are drawn anew per pixel and frame.

Limits that are the model's: a level passed during a frame that was passed over, or under a larger drawn threshold, can
never fire again in that direction; levels are float32 sums, so a signal that returns may lose its last event.
Departures: stamps are whole ns; ON and OFF thresholds may differ.
"""

from __future__ import annotations

from typing import Any, ClassVar

from nodes.event_sensor.peers.esim_kernels import EsimPixel, EsimSensor, esim_events
from nodes.event_sensor.peers.kernels import each_pixel
from nodes.event_sensor.peers.model import Model, filled


class Esim(Model):
    """Simulates ESIM. dark_level is ESIM's log_eps."""

    NAME: ClassVar[str] = "esim"
    USES: ClassVar[tuple[str, ...]] = ("threshold_mismatch", "threshold_floor", "dark_level", "refractory_us")

    def __init__(self, height: int, width: int, envs: int = 1, *, seed: int = 0, **params: Any) -> None:
        super().__init__(height, width, envs, seed=seed, **params)
        p = self.params
        sensor = filled(
            EsimSensor(), threshold_on=p["threshold_on"], threshold_off=p["threshold_off"],
            mismatch=p["threshold_mismatch"], floor=p["threshold_floor"], dark=p["dark_level"],
            refractory=round(p["refractory_us"] * 1e3),
        )  # fmt: skip
        self._keep(sensor, EsimPixel, each_pixel(esim_events, EsimSensor, EsimPixel))
