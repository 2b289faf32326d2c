"""Resolves parameters of the sensor that the scene gives or draws, environment by environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.params import EACH
from evis.scene.load import sets_sensor
from evis.scene.parameters import of_environment, scene_of, worlds_of
from nodes.event_sensor.parameters import SENSOR, resolve_sensor

SHARED = ("model", "crossing")
"""Parameters that decide when events are told, and so are the same in all environments."""


def resolve_with_scene(owner: str, params: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the parameters of environment 0: given ones over the scene's, those over the preset's.

    params: of a node, with `scene` and what it takes to load it. Raises ValueError, for a parameter that the sensor
    does not have too, and FileNotFoundError.
    """
    of_scene = scene_of(owner, params, visuals=False).sensor if has_parameters(params) else {}
    return _resolved(owner, of_environment(params, 0), of_scene)


def resolve_each(owner: str, params: Mapping[str, Any], envs: int) -> list[dict[str, Any]]:
    """Returns the parameters of every environment; one for all where they are the same. Raises as
    `resolve_with_scene` does, and ValueError where environments differ in what they cannot."""
    own = [of_environment(params, env) for env in range(envs if EACH in params else 1)]
    if has_parameters(params):
        scenes = worlds_of(owner, {**params, "envs": envs}, visuals=False).scenes
        found = [_resolved(owner, own[env % len(own)], scene.sensor) for env, scene in enumerate(scenes)]
    else:
        found = [_resolved(owner, one, {}) for one in own]
    for env, one in enumerate(found):
        check_shared(owner, one, f"in environment {env}", found[0], "in environment 0")
    return found[:1] if all(one == found[0] for one in found) else found


def check_shared(owner: str, one: Mapping[str, Any], where: str, other: Mapping[str, Any], elsewhere: str) -> None:
    """Raises ValueError where two environments differ in a parameter of SHARED.

    one, other: all of SENSOR, resolved. where, elsewhere: which environments have them, in words.
    """
    for name in SHARED:
        if one[name] != other[name]:
            raise ValueError(
                f"{owner}: {name} is {one[name]} {where} and {other[name]} {elsewhere}; environments side by side need "
                "the same"
            )


def has_parameters(params: Mapping[str, Any]) -> bool:
    """Tells whether the scene of a node has any; a scene that is not here, as one that a bag tells of, has none."""
    try:
        return bool(params.get("scene")) and sets_sensor(params["scene"])
    except FileNotFoundError:
        return False


def _resolved(owner: str, params: Mapping[str, Any], of_scene: Mapping[str, Any]) -> dict[str, Any]:
    given = {name: params[name] for name in SENSOR if params.get(name) is not None}
    return resolve_sensor(owner, params["preset"], {**of_scene, **given})
