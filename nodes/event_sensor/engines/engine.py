"""Chooses the engine that the parameters of a sensor ask for, and fills in the struct that its kernels read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from nodes.event_sensor.cpu.ideal import IdealEngine
from nodes.event_sensor.engines.interface import Engine
from nodes.event_sensor.input.batch import Size
from nodes.event_sensor.model.features import Features, features_of
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.parameters import FLOOR

if TYPE_CHECKING:
    from nodes.event_sensor.cuda.ideal import IdealPasses


def make_engine(size: Size, seed: int, p: Mapping[str, Any], device: Any, layout: KeyLayout) -> Engine | IdealPasses:
    """Returns the engine for resolved parameters: the ideal one unless a curve or a fault is asked for.

    Only what is asked for is imported, for a module of kernels costs some ms.
    """
    if p["model"] == "evis-paper":
        from nodes.event_sensor.engines.paper import PaperEngine

        return PaperEngine(size, seed, p, device)
    if features_of(p) not in (Features("linear"), Features("frame")):
        from nodes.event_sensor.engines.nonideal import NonIdealEngine

        return NonIdealEngine(size, seed, p, device)
    frame = p["crossing"] == "frame"
    if device.is_cuda:
        from nodes.event_sensor.cuda.ideal import IdealPasses

        return IdealPasses(size.envs * size.pixels, size.pixels, frame, device)
    return IdealEngine(size.envs * size.pixels, frame, layout)


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
    sensor.refractory_ns = round(1e3 * p["refractory_us"])
    return sensor
