"""Chooses the engine that the parameters of a sensor ask for, and fills in the struct that its kernels read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from nodes.event_sensor.cpu.ideal import Ideal
from nodes.event_sensor.input.batch import Size
from nodes.event_sensor.model.features import Features, features_of
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.parameters import FLOOR


def background_rate(p: Mapping[str, Any]) -> float:
    """Bounds the rate [Hz] of a pixel's background activity, the events that leak and noise make in constant light.

    An average; 0 of a model with few of them a frame.
    """
    if p["model"] != "evis":
        return 0.0
    rate = p["leak_rate"] + p["shot_rate"] + p["hot_pixel_fraction"] * p["hot_pixel_rate"]
    return float(min(rate, 1e6 / p["refractory_us"]) if p["refractory_us"] else rate)


def make_engine(size: Size, seed: int, p: Mapping[str, Any], device: Any, layout: KeyLayout) -> Any:
    """Returns the engine for resolved parameters: the ideal one unless a curve or a fault is asked for.

    Only what is asked for is imported, for a module of kernels costs some ms.
    """
    if p["model"] == "evis-paper":
        from nodes.event_sensor.engines.paper import Paper

        return Paper(size, seed, p, device)
    if features_of(p) not in (Features("linear"), Features("frame")):
        from nodes.event_sensor.engines.nonideal import NonIdeal

        return NonIdeal(size, seed, p, device)
    frame = p["crossing"] == "frame"
    if device.is_cuda:
        from nodes.event_sensor.cuda.ideal import IdealPasses

        return IdealPasses(size.envs * size.pixels, size.pixels, frame, device)
    return Ideal(size.envs * size.pixels, frame, layout)


def sensor_struct(p: Mapping[str, Any], shape: tuple[int, int, int], layout: KeyLayout, seed: int) -> Sensor:
    """Fills in what kernels know of a sensor, from resolved parameters. shape: height, width, channels."""
    struct: Any = Sensor
    sensor: Any = Sensor()
    for name in struct.vars:
        if name in p:
            setattr(sensor, name, p[name])
    sensor.gain_on, sensor.gain_off = math.exp(p["threshold_on"]), math.exp(-p["threshold_off"])
    sensor.floor = FLOOR
    sensor.height, sensor.width, sensor.channels = shape
    sensor.shift_x, sensor.shift_y, sensor.shift_t, sensor.shift_env = layout.x, layout.y, layout.t, layout.env
    sensor.seed = seed
    sensor.dead_ns = round(1e3 * p["refractory_us"])
    return sensor
