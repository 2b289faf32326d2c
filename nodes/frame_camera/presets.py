"""Describes the frame part of real sensors: what differs from the ideal frame camera's, each value with its source.

As with the event sensor's presets, a starting point and no calibration; `guess` is nobody's figure. Sensors that give
no frames have none here: beside them an ideal frame camera looks through the same lens, as behind a beam splitter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from nodes.event_sensor.presets import BRANDLI, TAVERNI
from nodes.event_sensor.presets import PRESETS as SENSORS

EMVA = "EMVA 1288, release 4.0"
PHOTON_J = 3.58e-19
"""Energy of a photon of 555 nm [J], where luminance has its peak: h c / lambda."""


def sensitivity_of(pitch_um: float, fill_factor: float, efficiency: float, f_number: float) -> float:
    """Computes the electrons per second that a pixel collects per radiance [1/s per W/(sr m^2)].

    A lens of f-number N gives the irradiance pi L / (4 N^2) of a distant surface (EMVA 1288, eq. 4, without its loss
    at close range); times pixel area, fill factor and quantum efficiency, by the energy of a photon.
    """
    irradiance = math.pi / (4.0 * f_number**2)
    return irradiance * (pitch_um * 1e-6) ** 2 * fill_factor * efficiency / PHOTON_J


@dataclass(frozen=True)
class FramePreset:
    """Holds one sensor. values: parameters as in nodes.frame_camera.parameters. sources: where each comes from."""

    values: Mapping[str, float | int | bool] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)


PRESETS: dict[str, FramePreset] = {
    **{name: FramePreset() for name in SENSORS},
    "davis346": FramePreset(
        {
            "image_bits": 10,
            "image_sensitivity": sensitivity_of(18.5, 0.22, 0.24, 2.0),
            "full_well": 19500.0,
            "photon_noise": True,
            "read_noise": 55.0,
            "dark_current": 18000.0,
        },
        {
            "image_bits": "the 10-bit samples of its USB protocol (libcaer; nodes/camera/inivation)",
            "image_sensitivity": f"{TAVERNI}: pixels of 18.5 um; fill factor 22 %, quantum efficiency 24 % and a lens "
            f"of f/2: guess; the formula: {EMVA}, section 2",
            "full_well": f"{BRANDLI}: 51 dB dynamic range, full_well / read_noise = 355; each by itself: guess",
            "photon_noise": f"{EMVA}, section 2: electrons are Poisson distributed",
            "read_noise": f"{BRANDLI}: 51 dB dynamic range, as full_well; each by itself: guess",
            "dark_current": "guess: a tenth of the full well in 0.1 s",
        },
    ),
}
