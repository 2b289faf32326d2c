"""The sensor that the parameters ask for: this project's, or another published model behind the same interface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nodes.event_sensor.peers import make_model
from nodes.event_sensor.sensor import EventSensor


def make_sensor(
    parameters: Mapping[str, Any], shape: tuple[int, int], envs: int = 1, *, colour: bool, device: str, seed: int
) -> Any:
    """Makes the sensor of resolved `parameters`; shape: (height, width). Raises ValueError."""
    model = parameters["model"]
    if model.startswith("evis"):
        channels = 3 if colour else 1
        return EventSensor(*shape, envs, channels=channels, device=device, seed=seed, **parameters)
    if colour or device != "cpu":
        raise ValueError(f"event model {model} takes luminance on the cpu only; evis does colour and cuda")
    return make_model(model, *shape, envs, seed=seed, **parameters)
