"""Finds parameters of a sensor that change nothing beside its others, so that a user can be told."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

from nodes.event_sensor.parameters import SENSOR, is_own_model

NEEDS: dict[str, tuple[str, ...]] = {
    "threshold_floor": ("threshold_mismatch",),
    "leak_jitter": ("leak_rate",),
    "leak_model": ("leak_rate",),
    "shot_white": ("shot_rate",),
    "hot_pixel_fraction": ("hot_pixel_rate",),
    "hot_pixel_rate": ("hot_pixel_fraction",),
    "shot_on_share": ("shot_rate",),
    "hot_pixel_spread": ("hot_pixel_fraction", "hot_pixel_rate"),
    "bandwidth_level": ("bandwidth_hz", "bandwidth_exponent"),
    "bandwidth_exponent": ("bandwidth_hz", "bandwidth_level"),
    "bandwidth_poles": ("bandwidth_hz",),
    "photoreceptor_noise_level": ("photoreceptor_noise",),
}
"""Parameter -> parameters that must not be 0 for it to have an effect."""
PAPER = {
    "crossing": ("frame", "its events carry the stamps of frames"),
    "leak_model": ("bernoulli", "its leak is the paper's coin"),
    "shot_on_share": (0.5, "its shot noise is ON and OFF alike"),
}
"""Parameter -> (value that model evis-paper always has, why)."""


RANDOM: dict[str, tuple[str, ...]] = {
    "threshold mismatch": ("threshold_mismatch",),
    "leak": ("leak_rate",),
    "shot noise": ("shot_rate",),
    "hot pixels": ("hot_pixel_fraction", "hot_pixel_rate"),
    "photoreceptor noise": ("photoreceptor_noise",),
    "timestamp jitter": ("timestamp_jitter_us",),
}
"""What is random in a sensor -> the parameters that turn it on, all of them together."""


def random(resolved: Mapping[str, Any]) -> tuple[str, ...]:
    """Names what in a sensor depends on its seed; () where all seeds give the same events. resolved: all of SENSOR."""
    model = resolved["model"]
    if model == "dvs_voltmeter":
        return ("its model of every crossing",)
    idle = without_effect(resolved)
    found = (what for what, names in RANDOM.items() if all(resolved[n] and n not in idle for n in names))
    # v2e's leak is even and begins at the first frame unless it has a jitter or a spread.
    spread = resolved["leak_jitter"] or resolved.get("rate_spread_decades")
    return tuple(w for w in found if w != "leak" or is_own_model(model) or spread)


def without_effect(resolved: Mapping[str, Any]) -> dict[str, str]:
    """Gives parameter -> why the sensor would be the same with any other value of it; of all of SENSOR, resolved.

    What model evis-paper is bound to anyway is left out: it is what happens.
    """
    model = resolved["model"]
    if not is_own_model(model):
        return _of_model(model, resolved)
    found = {
        name: f"{' and '.join(needed)} is 0" for name, needed in NEEDS.items() if not all(resolved[n] for n in needed)
    }
    found |= _of_thresholds(resolved)
    if model == "evis-paper":
        found |= {
            name: f"event model evis-paper has none: {why}"
            for name, (bound, why) in PAPER.items()
            if resolved[name] != bound
        }
    return found


def check_given(
    given: Mapping[str, Any], resolved: Mapping[str, Any], spelled: Callable[[str, Any], str] = "{}={!r}".format
) -> None:
    """Raises ValueError for a parameter that a user gave and that changes nothing.

    One that is off anyway (0, None) is never held against the user, nor is what a preset has.

    Args:
        given: parameters of SENSOR and of the model by name, None = not given.
        resolved: all of SENSOR, resolved.
        spelled: name and value as the user wrote them.
    """
    idle = without_effect(resolved)
    for name, value in given.items():
        if value is not None and resolved[name] and name in idle:
            raise ValueError(f"{spelled(name, value)} has no effect: {idle[name]}; leave it out")


def _of_thresholds(resolved: Mapping[str, Any]) -> dict[str, str]:
    both = all(resolved[side] is not None for side in ("threshold_on", "threshold_off"))
    return {"threshold": "threshold_on and threshold_off are both given"} if both else {}


def _of_model(model: str, resolved: Mapping[str, Any]) -> dict[str, str]:
    """Tells what another published event model does not have."""
    from nodes.event_sensor.peers import MODELS
    from nodes.event_sensor.peers.model import THRESHOLDS

    uses = getattr(importlib.import_module(f"nodes.event_sensor.peers.{model}"), MODELS[model]).USES
    has = ", ".join(sorted((*THRESHOLDS, *uses)))
    missing = {name for name in SENSOR if name not in (*THRESHOLDS, *uses, "model")}
    found = dict.fromkeys(sorted(missing), f"event model {model} has none; it has {has}")
    found |= {
        name: f"{' and '.join(needed)} is 0"
        for name, needed in NEEDS.items()
        if name in uses and all(n in uses for n in needed) and not all(resolved[n] for n in needed)
    }
    return found | _of_thresholds(resolved)
