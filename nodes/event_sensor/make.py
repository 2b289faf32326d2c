"""Makes the sensor that the parameters ask for: this project's, or another published model behind the same
interface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nodes.event_sensor.parameters import is_own_model
from nodes.event_sensor.sensor import EventSensor


def make_sensor(
    parameters: Mapping[str, Any],
    shape: tuple[int, int],
    envs: int = 1,
    *,
    colour: bool,
    device: str,
    seed: int,
    time_seed: int | None = None,
    marked: bool = False,
) -> Any:
    """Makes the sensor that resolved parameters ask for.

    Args:
        parameters: all of nodes.event_sensor.parameters.SENSOR, resolved.
        shape: (height, width) [px].
        envs: environments, E.
        colour: events of R, G and B rather than of luminance.
        device: where kernels run.
        seed: of environment 0.
        time_seed: of a model whose random numbers know no episode but only a time, for who lets time begin again; None
            = seed.
        marked: as of EventSensor.

    Raises ValueError.
    """
    model = parameters["model"]
    if is_own_model(model):
        channels = 3 if colour else 1
        return EventSensor(*shape, envs, channels=channels, device=device, seed=seed, marked=marked, **parameters)
    if colour or device != "cpu":
        raise ValueError(f"event model {model} takes luminance on the cpu; evis does colour and cuda")
    from nodes.event_sensor.peers import make_model

    return make_model(model, *shape, envs, seed=seed if time_seed is None else time_seed, **parameters)
