"""Describes real sensors: their size and the parameters that differ from the ideal sensor's, each value with its
source.

Published figures hold for one bias setting, and makers give limits ("< 100 us") rather than distributions. Where there
are recordings, values are fitted to them (`evis events fit` and `evis events measure`): they are those of one camera at
its settings, in a light that is not known, and its thresholds stand and fall with the contrast that is assumed of the
scene. What stands as `guess` is nobody's figure. Contrast is taken to natural log
units: an increase of 15 % is ln 1.15; Prophesee's Weber contrast is relative to the brighter side, so 25 % is
-ln(1 - 0.25). Light levels given in lux are the radiance of white paper in that light, see `radiance_of`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

LUMINOUS_EFFICACY = 179.0
"""Of white light [lm/W], the convention of the Radiance lighting simulator (Ward, SIGGRAPH 1994)."""


def radiance_of(lux: float) -> float:
    """Computes the radiance [W/(sr m^2)] of a white diffuse surface in an illuminance [lux]: E / (pi 179 lm/W)."""
    return lux / (math.pi * LUMINOUS_EFFICACY)


def corner_of(latency_us: float) -> float:
    """Computes the corner [Hz] of a first-order low pass whose time constant is this latency."""
    return 1e6 / (2.0 * math.pi * latency_us)


@dataclass(frozen=True)
class Preset:
    """Holds the parameters of one sensor.

    values: parameters as in nodes.event_sensor.parameters. sources: where each value comes from.
    """

    name: str
    width: int
    height: int
    values: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)


LICHTSTEINER = "Lichtsteiner, Posch, Delbruck, IEEE JSSC 43(2), 2008"
BRANDLI = "Brandli et al., IEEE JSSC 49(10), 2014 (DAVIS240, the same pixel)"
TAVERNI = "Taverni et al., IEEE TCAS-II 65(5), 2018"
FINATEU = "Finateu et al., ISSCC 2020"
SURVEY = "Gallego et al., Event-based Vision: A Survey, IEEE TPAMI 2022, table 1"
LEAK = "; Nozaki and Delbruck, IEEE TED 64(8), 2017, on why it leaks"
V2E = "Hu, Liu, Delbruck, v2e, CVPRW 2021"
IMX636_BRIEF = "Prophesee and Sony, IMX636 product brief"
GENX320_BRIEF = "Prophesee, GenX320 product brief"
WEBER = "Weber contrast relative to the brighter side (Prophesee, Event-Based Vision sensor characteristics)"
ONE_KLUX = "taken to hold for white paper in 1 klux"
WHEEL = "six DAVIS346 recordings wheel_2024_11_26_11_* (piratax007/Detect_wheel_position_DVS_Camera 1e8c881)"
SILKY = "event_camera_py_test_events_1.bag, Gen3.1 VGA (ros-event-camera/event_camera_py ba6df53)"
DVS128_CLIP = "DVS128-2017-03-21-short.aedat (colleenpamchen/jAER 4395a0c)"
HD_CLIP = "60,000 events of an EVT3 sample of the maker's, 1280 x 720"
CONTRAST = "of an assumed contrast of 2.1 +- 0.4 ln I"
STILL = "where nothing moves"
AS_GEN31 = "guess: as the Gen3.1"

PRESETS: dict[str, Preset] = {
    "ideal": Preset("no non-ideality", 0, 0),
    "dvs128": Preset(
        "iniVation DVS128",
        128,
        128,
        {
            "threshold": math.log(1.15),
            "threshold_mismatch": 0.021,
            "dark_level": radiance_of(0.1),
            "bandwidth_hz": 3000.0,
            "bandwidth_level": radiance_of(1000),
            "refractory_us": 500.0,
            "leak_rate": 0.016,
            "leak_jitter": 0.1,
            "shot_rate": 0.05,
            "shot_white": radiance_of(1000),
            "hot_pixel_fraction": 0.0027,
            "hot_pixel_rate": 3.2,
            "hot_pixel_spread": 0.44,
            "readout_rate": 1e6,
            "timestamp_jitter_us": 5.0,
        },
        {
            "size": f"{LICHTSTEINER}: 128 x 128 pixels of 40 um",
            "threshold": f"{LICHTSTEINER}: least contrast 15 %; the survey's table 1 has 17 %",
            "threshold_mismatch": f"{LICHTSTEINER}: array mismatch 2.1 % in relative intensity event threshold",
            "dark_level": f"{LICHTSTEINER}: dynamic range > 120 dB, down to 0.1 lux; as dark current: guess",
            "bandwidth_hz": f"{LICHTSTEINER}: pixel bandwidth 3 kHz under 1 klux scene illumination",
            "bandwidth_level": f"{LICHTSTEINER}: 3 kHz under 1 klux, {ONE_KLUX}",
            "refractory_us": f"{V2E}: default of its code, 0.5 ms; a bias of the chip",
            "leak_rate": f"{DVS128_CLIP}: ON 0.041 Hz less OFF 0.025 Hz, {STILL}{LEAK}",
            "leak_jitter": f"{V2E}: default of its code",
            "shot_rate": f"{DVS128_CLIP}: OFF 0.025 Hz, {STILL}, and as much ON, in a light that is not known",
            "shot_white": "guess: no shot noise from 1 klux on",
            "hot_pixel_fraction": f"{DVS128_CLIP}: 44 of 16384 pixels",
            "hot_pixel_rate": f"{DVS128_CLIP}: their mean, {STILL}",
            "hot_pixel_spread": f"{DVS128_CLIP}: of the 44 rates",
            "readout_rate": f"{SURVEY}: largest bandwidth 1 Meps",
            "timestamp_jitter_us": f"guess: a third of the least latency, 15 us ({LICHTSTEINER})",
        },
    ),
    "davis346": Preset(
        "iniVation DAVIS346",
        346,
        260,
        {
            "threshold": 0.244,
            "threshold_off": 0.306,
            "threshold_mismatch": 0.029,
            "dark_level": radiance_of(0.1),
            "bandwidth_hz": 42.0,
            "bandwidth_level": radiance_of(1000 * 42 / 3000),
            "refractory_us": 459.0,
            "leak_rate": 0.002,
            "leak_jitter": 0.1,
            "shot_rate": 0.27,
            "shot_white": 0.91,
            "shot_on_share": 0.53,
            "hot_pixel_fraction": 0.00023,
            "hot_pixel_rate": 21.0,
            "hot_pixel_spread": 0.55,
            "readout_rate": 12e6,
            "timestamp_jitter_us": 7.0,
        },
        {
            "size": f"{TAVERNI}: 346 x 260 pixels of 18.5 um",
            "threshold": f"{WHEEL}: 0.116 +- 0.002 {CONTRAST}; with it +- 0.05",
            "threshold_off": f"{WHEEL}: 0.146 +- 0.002 {CONTRAST}; with it +- 0.06",
            "threshold_mismatch": f"{WHEEL}: 0.029 +- 0.003, by the spread of events in a burst",
            "dark_level": f"guess: 0.1 lux, as the DVS128, whose dynamic range of 120 dB it shares ({SURVEY})",
            "bandwidth_hz": f"{WHEEL}: 42 +- 1 Hz, the same in the white and in the black",
            "bandwidth_level": f"guess: 14 lux, where the photoreceptor alone would be as slow ({LICHTSTEINER}: 3 kHz "
            "under 1 klux); the recordings' black is brighter, and does not show it",
            "refractory_us": f"{WHEEL}: least interval between two events of a pixel, 0.46 to 0.56 ms; set by a bias",
            "leak_rate": f"{WHEEL}: median of what the white has more of ON than of OFF, {STILL}: 0 to 0.004 Hz{LEAK}",
            "leak_jitter": f"{V2E}: default of its code",
            "shot_rate": f"{WHEEL}: 0.22 Hz a pixel in the black, {STILL}; 0.15 to 0.38 in single recordings",
            "shot_white": f"{WHEEL}: 0.006 Hz a pixel in the white, {STILL}; white paper in 500 lux is assumed",
            "shot_on_share": f"{WHEEL}: 53.5 % of the events in the black, {STILL}",
            "hot_pixel_fraction": f"{WHEEL}: 11 of 47,000 pixels, all of them in the black",
            "hot_pixel_rate": f"{WHEEL}: their mean, {STILL}",
            "hot_pixel_spread": f"{WHEEL}: of the 11 rates",
            "readout_rate": f"{SURVEY}: largest bandwidth 12 Meps",
            "timestamp_jitter_us": f"guess: a third of the latency, 20 us ({SURVEY})",
        },
    ),
    "gen31_vga": Preset(
        "Prophesee Gen3.1 VGA (SilkyEvCam EvC3A)",
        640,
        480,
        {
            "threshold": math.log(1.12),
            "threshold_mismatch": 0.02,
            "dark_level": radiance_of(0.08),
            "bandwidth_hz": corner_of(200),
            "bandwidth_level": radiance_of(1000),
            "refractory_us": 480.0,
            "shot_rate": 0.18,
            "shot_white": radiance_of(1000),
            "shot_on_share": 0.35,
            "hot_pixel_fraction": 0.016,
            "hot_pixel_rate": 7.9,
            "hot_pixel_spread": 0.38,
            "readout_rate": 50e6,
            "timestamp_jitter_us": 40.0,
        },
        {
            "size": f"{SURVEY}: Gen3 CD, 640 x 480 pixels of 15 um",
            "threshold": f"{SURVEY}: Gen3 CD, least contrast 12 %",
            "threshold_mismatch": "guess: as the DVS128's 2.1 %",
            "dark_level": "guess: the low-light limit of the maker's next generation (0.08 lux, IMX636)",
            "bandwidth_hz": f"{SURVEY}: Gen3 CD, latency 40 to 200 us; the upper end as the time constant: guess",
            "bandwidth_level": f"guess: {ONE_KLUX}",
            "refractory_us": f"{SILKY}: least interval between two events of a pixel; set by bias_refr",
            "shot_rate": f"{SILKY}: ON 0.062 Hz, OFF 0.115 Hz, {STILL}, in a light that is not known",
            "shot_white": "guess: no shot noise from 1 klux on",
            "shot_on_share": f"{SILKY}: 37,564 ON and 70,082 OFF, {STILL}; what leak there is is in it",
            "hot_pixel_fraction": f"{SILKY}: 4937 of 307,200 pixels",
            "hot_pixel_rate": f"{SILKY}: their mean, {STILL}",
            "hot_pixel_spread": f"{SILKY}: of their rates",
            "readout_rate": f"metavision_driver's README: 48 to 50 Mev/s at saturation; {SURVEY}: the chip has 66 Meps",
            "timestamp_jitter_us": f"guess: the least latency, 40 us ({SURVEY})",
        },
    ),
    "imx636": Preset(
        "Sony and Prophesee IMX636 (Gen4, EVK4)",
        1280,
        720,
        {
            "threshold": -math.log(1 - 0.25),
            "threshold_mismatch": 0.03,
            "dark_level": radiance_of(0.08),
            "bandwidth_hz": corner_of(100),
            "bandwidth_level": radiance_of(1000),
            "refractory_us": 300.0,
            "leak_rate": 0.1,
            "leak_jitter": 0.1,
            "shot_rate": 0.18,
            "shot_white": radiance_of(1000),
            "readout_rate": 1.066e9,
            "timestamp_jitter_us": 20.0,
        },
        {
            "size": f"{FINATEU}: 1280 x 720 pixels of 4.86 um",
            "threshold": f"{IMX636_BRIEF}: nominal contrast threshold 25 %, {WEBER}",
            "threshold_mismatch": "guess: between the DVS128's 2.1 % and the DAVIS240's 3.5 %",
            "dark_level": f"{IMX636_BRIEF}: low-light cutoff 0.08 lux; that it is dark current: guess",
            "bandwidth_hz": f"{IMX636_BRIEF}: latency below 100 us at 1 klux; as the time constant: guess",
            "bandwidth_level": f"{IMX636_BRIEF}: latency at 1 klux, {ONE_KLUX}",
            "refractory_us": f"{HD_CLIP}: least interval between two events of a pixel; set by bias_refr",
            "leak_rate": f"{SURVEY}: Gen4 CD, stationary noise 0.1 events/pixel/s at 25 C{LEAK}",
            "leak_jitter": f"{V2E}: default of its code",
            "shot_rate": AS_GEN31,
            "shot_white": "guess: no shot noise from 1 klux on",
            "readout_rate": f"{FINATEU}: 1.066 Geps",
            "timestamp_jitter_us": f"guess: the least latency, 20 us ({SURVEY}, Gen4 CD: 20 to 150 us)",
        },
    ),
    "genx320": Preset(
        "Prophesee GenX320",
        320,
        320,
        {
            "threshold": -math.log(1 - 0.25),
            "threshold_mismatch": 0.03,
            "dark_level": radiance_of(0.05),
            "bandwidth_hz": corner_of(150),
            "bandwidth_level": radiance_of(1000),
            "refractory_us": 100.0,
            "leak_rate": 0.1,
            "leak_jitter": 0.1,
            "shot_rate": 0.18,
            "shot_white": radiance_of(1000),
            "readout_rate": 10e6,
            "timestamp_jitter_us": 30.0,
        },
        {
            "size": f"{GENX320_BRIEF}: 320 x 320 pixels of 6.3 um",
            "threshold": f"{GENX320_BRIEF}: nominal contrast threshold 25 %, {WEBER}",
            "threshold_mismatch": "guess: between the DVS128's 2.1 % and the DAVIS240's 3.5 %",
            "dark_level": f"{GENX320_BRIEF}: low-light cutoff 0.05 lux; that it is dark current: guess",
            "bandwidth_hz": f"{GENX320_BRIEF}: latency below 150 us at 1 klux; as the time constant: guess",
            "bandwidth_level": f"{GENX320_BRIEF}: latency at 1 klux, {ONE_KLUX}",
            "refractory_us": "guess; set by bias_refr",
            "leak_rate": "guess: as the maker's Gen4 CD",
            "leak_jitter": f"{V2E}: default of its code",
            "shot_rate": AS_GEN31,
            "shot_white": "guess: no shot noise from 1 klux on",
            "readout_rate": "guess: a low-power interface",
            "timestamp_jitter_us": "guess: a fifth of the latency",
        },
    ),
}
