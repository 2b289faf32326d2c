"""Chooses which curves and faults are compiled into a kernel: one kernel for each set of features."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nodes.event_sensor.parameters import LOOK_AHEAD


@dataclass(frozen=True)
class Features:
    """Names the curves and faults that a kernel has."""

    crossing: str
    leak: bool = False
    bernoulli_leak: bool = False
    noise: bool = False
    refractory: bool = False
    mismatch: bool = False
    cap: bool = False
    marked: bool = False
    further: bool = False
    """Pixels have further samples between the frames; of straight lines alone."""

    @property
    def ahead(self) -> bool:
        """Tells whether the curve needs the frame after the step."""
        return self.crossing in LOOK_AHEAD

    @property
    def curved(self) -> bool:
        """Tells whether it is not a straight line."""
        return self.ahead or self.crossing == "hermite"

    @property
    def timed(self) -> bool:
        """Tells whether something can happen without a change of the light."""
        return self.leak or self.noise or self.refractory

    @property
    def range_decides(self) -> bool:
        """Tells whether nothing can happen to a pixel whose samples stay in its inactive range."""
        return not self.curved and not self.bernoulli_leak


def features_of(p: Mapping[str, Any]) -> Features:
    """Returns what has to be compiled for these parameters, all of SENSOR, resolved."""
    return Features(
        crossing=p["crossing"],
        leak=p["leak_rate"] > 0 and p["leak_model"] == "drift",
        bernoulli_leak=p["leak_rate"] > 0 and p["leak_model"] == "bernoulli",
        noise=has_noise(p),
        refractory=round(1e3 * p["refractory_us"]) > 0,
        mismatch=p["threshold_mismatch"] > 0,
        cap=p["event_cap"] > 0,
        marked=marks(p),
    )


def has_noise(p: Mapping[str, Any]) -> bool:
    """Tells whether a sensor with these parameters has shot noise or hot pixels."""
    return bool(p["shot_rate"] > 0 or (p["hot_pixel_rate"] > 0 and p["hot_pixel_fraction"] > 0))


def spontaneous(p: Mapping[str, Any]) -> bool:
    """Tells whether a sensor with these parameters has events that light does not make."""
    return bool(p["leak_rate"] > 0 or has_noise(p))


def marks(p: Mapping[str, Any]) -> bool:
    """Tells whether keys have to say what noise made: where that is asked for and there is some."""
    return bool(p.get("marked")) and spontaneous(p)


def background_rate(p: Mapping[str, Any]) -> float:
    """Bounds the rate [Hz] of a pixel's background activity, the events that leak and noise make in constant light.

    An average; 0 of a model with few of them a frame.
    """
    if p["model"] != "evis":
        return 0.0
    rate = p["leak_rate"] + p["shot_rate"] + p["hot_pixel_fraction"] * p["hot_pixel_rate"]
    return float(min(rate, 1e6 / p["refractory_us"]) if p["refractory_us"] else rate)
