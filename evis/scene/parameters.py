"""Declares parameters of a node that loads the scene: which one, with which arguments, and how large its images are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.params import EACH, Param
from evis.scene.load import is_dynamic, parse_args
from evis.scene.model import Camera, Scene
from evis.scene.worlds import Worlds, family

SCENE: dict[str, Param] = {
    "scene": Param(str, None, "world to simulate: a name in scenes/, a YAML, MJCF or URDF file", optional=True),
    "scene_args": Param(str, "", "arguments of the scene, as omega=50,tilt=40"),
    "width": Param(int, 0, "image width, 0 = the scene's", "px", 0, 8192),
    "height": Param(int, 0, "image height, 0 = the scene's", "px", 0, 8192),
}


FORESEEN = 16
"""Environments that are looked at before a run starts: to load the worlds of thousands takes as long as to run them."""

SEED = Param(int, 0, "seed of what the scene draws; environment k has seed + k", "", 0, 2**63 - 1)
"""For nodes that see its values in /state or CameraInfo and load the same worlds."""


def scene_of(owner: str, params: Mapping[str, Any], *, visuals: bool = True, textures: bool = True) -> Scene:
    """Returns the scene that parameters of `owner`, all of SCENE or a part, ask for: the world of environment 0, which
    is shared within the process, and nobody may write to it. visuals and textures as of `load_scene`. Raises
    ValueError, FileNotFoundError.
    """
    own = of_environment(params, 0)
    return family(*_asked(owner, own), visuals=visuals, textures=textures).world(int(own.get("seed") or 0))


def worlds_of(owner: str, params: Mapping[str, Any], *, visuals: bool = True, textures: bool = True) -> Worlds:
    """Returns the worlds of all environments, `envs` from `seed` on, or with the seeds and the scene's arguments that
    each has in EACH. Raises as scene_of does, and ValueError where they do not go together."""
    seeds = seeds_of(params)
    alike = EACH not in params or len({own.get("scene_args") for own in params[EACH]}) == 1
    asked = [_asked(owner, of_environment(params, env)) for env in range(1 if alike else len(seeds))]
    families = [family(*one, visuals=visuals, textures=textures) for one in asked]
    return Worlds(lambda env, seed: families[0 if alike else env].world(seed), seeds)


def foreseen_worlds(owner: str, params: Mapping[str, Any]) -> list[Scene]:
    """Returns the worlds, without textures, of the first FORESEEN environments, for what is told before a run starts.
    Raises as worlds_of does."""
    few = {**params, "envs": min(int(params.get("envs") or 1), FORESEEN)}
    return worlds_of(owner, few, textures=False).scenes


def of_environment(params: Mapping[str, Any], env: int) -> Mapping[str, Any]:
    """Returns the parameters of one environment: its own in EACH, the others as all have them."""
    each = params.get(EACH)
    return {**params, **each[env]} if each else params


def seeds_of(params: Mapping[str, Any]) -> list[int]:
    """Returns the seed of each environment: `seed` + k, or what it has in EACH."""
    first, envs = int(params.get("seed") or 0), int(params.get("envs") or 1)
    each = params.get(EACH) or [{}] * envs
    return [int(each[env].get("seed", first + env)) for env in range(envs)]


def _asked(owner: str, params: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Name and arguments of the scene."""
    if not params.get("scene"):
        raise ValueError(f"{owner} needs scene:=NAME, a world to simulate")
    size = {key: int(params[key]) for key in ("width", "height") if params.get(key)}
    return params["scene"], {**parse_args(params.get("scene_args")), **size}


def camera_of(scene: Scene, name: str) -> Camera:
    """Returns a camera of the scene by its name. Raises ValueError naming those there are."""
    try:
        return scene.camera(name)
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def ends_alone(scene: str | None) -> frozenset[str] | None:
    """Names the arrays of /state that a node reads which knows what moves in closed form between keyframes.

    None where something else moves, so that all are read.
    """
    try:
        return frozenset({"end_pose"}) if scene and not is_dynamic(scene) else None
    except (OSError, ValueError):
        # Whoever loads the scene says what is wrong with it.
        return None
