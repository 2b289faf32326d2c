"""Implements DVS-Voltmeter: the pixel's voltage is Brownian motion with drift, and events are its first passages.

Lin, Ma, Guo, Wen, "DVS-Voltmeter: Stochastic Process-based Event Simulator for Dynamic Vision Sensors", ECCV 2022.
Between two frames the voltage has, eqs. (10) and (11), the drift
    mu = k1 dL / (dt (L_mean + k2)) + k4 + k5 L_mean    and    sigma = k3 sqrt(L_mean) / (L_mean + k2) + k6,
L in 8-bit numbers (DN), dt in us, threshold 1. Algorithm 1: draw which threshold is reached first, then when (inverse
Gaussian, or Levy without drift; sampled as Michael, Schucany, Haas, "Generating random variates using transformations
with multiple roots", 1976), until the frame ends; what was reached of the last passage by then stays as a residual.

Limits that are the model's: the drift is the midpoint rule of d ln L, so that a jump gives 2 k1 events at most; the
time is drawn as if the other threshold did not exist; the residual is the straight line to a passage that never was;
its numbers were fitted to video of 0 to 255 DN, and light beyond shot_white goes on to leak in proportion (k5).
Departures: stamps are whole ns; a passage against the drift takes the law of one along it (which is its law given that
it happens at all) where the public program draws from a truncated normal; without drift the threshold is drawn by the
two distances where the program takes 1/2; sigma = 0 is allowed and gives straight lines.
"""

from __future__ import annotations

from typing import Any, ClassVar

from nodes.event_sensor.parameters import OF_MODEL
from nodes.event_sensor.peers.dvs_voltmeter_kernels import VoltPixel, VoltSensor, voltmeter_events
from nodes.event_sensor.peers.kernels import each_pixel
from nodes.event_sensor.peers.model import Model, filled


class DvsVoltmeter(Model):
    """Simulates DVS-Voltmeter. k1 not given is 1 / threshold_on; shot_white is the luminance of 255 DN.

    k2 to k6 default to the paper's DAVIS346.

    The paper's k1 of the DAVIS346 is 5.265, which is a threshold of 0.19.
    """

    NAME: ClassVar[str] = "dvs_voltmeter"
    USES: ClassVar[tuple[str, ...]] = ("shot_white",)
    OWN = OF_MODEL["dvs_voltmeter"]

    def __init__(self, height: int, width: int, envs: int = 1, *, seed: int = 0, **params: Any) -> None:
        super().__init__(height, width, envs, seed=seed, **params)
        p = self.params
        sensor = filled(
            VoltSensor(), **{name: p[name] for name in ("k2", "k3", "k4", "k5", "k6")},
            k1=1.0 / p["threshold_on"] if p["k1"] is None else p["k1"],
            off=p["threshold_off"] / p["threshold_on"], dn=255.0 / p["shot_white"],
        )  # fmt: skip
        self._keep(sensor, VoltPixel, each_pixel(voltmeter_events, VoltSensor, VoltPixel))
