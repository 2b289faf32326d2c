"""Parameters of a node that loads the scene: which one, with which arguments, and how large its images are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.params import Param
from evis.scene.load import parse_args
from evis.scene.model import Camera, Scene
from evis.scene.shared import shared_scene

SCENE: dict[str, Param] = {
    "scene": Param(str, None, "world to simulate: a name in scenes/, a YAML, MJCF or URDF file", optional=True),
    "scene_args": Param(str, "", "arguments of the scene, as omega=50,tilt=40"),
    "width": Param(int, 0, "image width, 0 = the scene's", "px", 0, 8192),
    "height": Param(int, 0, "image height, 0 = the scene's", "px", 0, 8192),
}


def scene_of(owner: str, params: Mapping[str, Any], *, visuals: bool = True) -> Scene:
    """Returns the scene that parameters of `owner`, all of SCENE or a part, ask for; it is shared within the process,
    and nobody may write to it. Raises ValueError, FileNotFoundError.
    """
    if not params.get("scene"):
        raise ValueError(f"{owner} needs scene:=NAME, a world to simulate")
    size = {key: int(params[key]) for key in ("width", "height") if params.get(key)}
    return shared_scene(params["scene"], {**parse_args(params.get("scene_args")), **size}, visuals=visuals)


def camera_of(scene: Scene, name: str) -> Camera:
    """Returns a camera of the scene by its name. Raises ValueError naming those there are."""
    try:
        return scene.camera(name)
    except KeyError as error:
        raise ValueError(error.args[0]) from None
