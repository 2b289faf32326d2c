"""Declares every parameter of the frame camera: type, default, unit and range.

A value of the sensor that is not given comes from the preset, and from the ideal frame camera where the preset says
nothing. What the parameters mean is in docs/frame_camera.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from evis.config.params import Param, ParamError, describe_value, resolve
from evis.runtime.clock import rate
from nodes.frame_camera.presets import PRESETS

TIMING: dict[str, Param] = {
    "image_rate": Param(float, 30.0, "images per second, at times of their own", "Hz", 1e-3, 1e5),
    "image_phase_ms": Param(float, 0.0, "when the first exposure begins, after the start", "ms", 0, 1e6),
    "exposure_ms": Param(
        float, None, "exposure time of an image; not given = by auto-exposure", "ms", 1e-3, 1e6, optional=True
    ),
    "exposure_target": Param(float, 0.25, "for auto-exposure: mean of an image, as share of full scale", "", 0.001, 1),
    "exposure_min_ms": Param(float, 0.01, "for auto-exposure: the least", "ms", 1e-3, 1e6),
    "exposure_max_ms": Param(
        float, None, "for auto-exposure: the most; not given = the time between two images", "ms", 1e-3, 1e6,
        optional=True,
    ),
    "rolling_shutter_us": Param(
        float, 0.0, "delay of each image row's exposure after the row above; 0 = global shutter", "us", 0, 1e6
    ),
}  # fmt: skip
SENSOR: dict[str, Param] = {
    "image_bits": Param(
        int, 8, "bits of a pixel; more than 8 are the upper ones of 16", choices=(8, 10, 12, 14, 16)
    ),
    "image_gain": Param(float, 1.0, "of the amplifier; 1 = full well is full scale", "", 1e-3, 1e4),
    "image_gamma": Param(float, 1.0, "a pixel's value is its level to the power 1/gamma; 1 = linear", "", 0.1, 10),
    "image_sensitivity": Param(
        float, 1e7, "electrons of a pixel per second and radiance", "1/s per W/(sr m^2)", 1e-6, 1e15
    ),
    "full_well": Param(float, 20000.0, "electrons that a pixel can hold", "e-", 1, 1e9),
    "photon_noise": Param(bool, False, "photon shot noise: electrons are Poisson distributed"),
    "read_noise": Param(float, 0.0, "standard deviation of the readout's noise", "e-", 0, 1e6),
    "dark_current": Param(float, 0.0, "electrons of a pixel per second in the dark", "e-/s", 0, 1e9),
    "black_level": Param(float, 0.0, "added to every pixel, as share of full scale", "", 0, 0.9),
}  # fmt: skip
AUTO = ("exposure_target", "exposure_min_ms", "exposure_max_ms")


PRESET = Param(
    str,
    "ideal",
    "sensor whose frames to have; ideal has no noise, nor has a file of an event sensor's parameters",
    choices=tuple(PRESETS),
    files=(".yaml", ".yml"),
)


def _of_preset(param: Param) -> Param:
    """The parameter as a node has it: not given means the preset's value."""
    ideal = f"; ideal: {describe_value(param.default)}" if param.default else ""
    return replace(param, default=None, optional=True, help=param.help + ideal)


NODE: dict[str, Param] = {**TIMING, **{name: _of_preset(param) for name, param in SENSOR.items()}}
"""All of them for a node of the graph, where a value of the sensor that is not given is the preset's."""


@dataclass(frozen=True)
class Settings:
    """Holds the parameters in the units of the code: times in whole nanoseconds, the sensor's as in SENSOR.

    exposure_ns: 0 = by auto-exposure, within `shortest` and `longest`.
    """

    rate_hz: float
    phase_ns: int
    exposure_ns: int
    target: float
    shortest: int
    longest: int
    line_delay_ns: int
    sensor: Mapping[str, Any]


def settings_of(owner: str, preset: str, given: Mapping[str, Any]) -> Settings:
    """Resolves parameters; None counts as not given.

    Raises ParamError naming `owner`, and ValueError for an exposure that is longer than the time between two images.
    """
    preset = PRESET.convert(owner, "preset", preset)
    there = {name: value for name, value in given.items() if value is not None}
    timing = resolve(owner, TIMING, {name: value for name, value in there.items() if name in TIMING})
    own = {name: value for name, value in there.items() if name in SENSOR}
    sensor = resolve(owner, SENSOR, {**(PRESETS[preset].values if preset in PRESETS else {}), **own})
    period = int(1_000_000_000 / rate(timing["image_rate"]))
    most = timing["exposure_max_ms"]
    longest = period if most is None else nanoseconds(most)
    exposure = 0 if timing["exposure_ms"] is None else nanoseconds(timing["exposure_ms"])
    shortest = nanoseconds(timing["exposure_min_ms"])
    if "exposure_min_ms" not in there:
        shortest = min(shortest, period)
    limits = {"exposure_ms": exposure} if exposure else {"exposure_max_ms": longest, "exposure_min_ms": shortest}
    for name, asked in limits.items():
        if asked > period:
            raise ParamError(
                f"{owner}: {name} is {asked * 1e-6:.9g} ms, images at image_rate {timing['image_rate']:g} Hz are "
                f"{period * 1e-6:.9g} ms apart; a pixel cannot be exposed for longer than that"
            )
    if not exposure and shortest > longest:
        raise ParamError(
            f"{owner}: exposure_min_ms is {shortest * 1e-6:.9g} ms, above exposure_max_ms, {longest * 1e-6:.9g} ms; "
            "give a range"
        )
    return Settings(
        timing["image_rate"], nanoseconds(timing["image_phase_ms"]), exposure, timing["exposure_target"], shortest,
        longest, round(timing["rolling_shutter_us"] * 1e3), sensor,
    )  # fmt: skip


def nanoseconds(milliseconds: float) -> int:
    """Converts to whole nanoseconds."""
    return round(milliseconds * 1e6)
