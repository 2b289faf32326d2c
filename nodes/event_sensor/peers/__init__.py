"""Implements other published event models behind one interface, so that results can be compared in one run.

Each is written from its paper and has the limits of its paper; they are listed in its file: `esim.py`
(`esim_kernels.py`), `v2e.py` (`v2e_kernels.py`), `dvs_voltmeter.py` (`dvs_voltmeter_kernels.py`). What they share is in
`model.py` and `kernels.py`. The sensor of this project is nodes.event_sensor.sensor.EventSensor.
"""

from __future__ import annotations

import importlib
from typing import Any

from evis.config.params import Param
from nodes.event_sensor.peers.model import Model

MODELS = {"esim": "Esim", "v2e": "V2e", "dvs_voltmeter": "DvsVoltmeter"}
"""Name of the model, which is also its file here -> class."""

__all__ = ["MODELS", "Model", "make_model"]


def make_model(name: str, height: int, width: int, envs: int = 1, *, seed: int = 0, **params: Any) -> Model:
    """Makes an event model with `process(luminance [E, K, H, W], t [K], episodes [E]) -> Events`.

    Args:
        name: one of MODELS.
        height, width: pixels.
        envs: cameras, E.
        seed: of the random numbers.
        params: those of nodes.event_sensor.parameters.SENSOR that the model has, and its own (`Model.OWN`). A parameter
            of the sensor that the model lacks is accepted at its default only.

    Raises ValueError naming what is wrong.
    """
    Param(str, "esim", "", choices=tuple(MODELS)).convert("event sensor", "model", name)
    module = importlib.import_module(f"nodes.event_sensor.peers.{name}")
    return getattr(module, MODELS[name])(height, width, envs, seed=seed, **params)
