"""Reads what a user names after `evis launch`: a launch file or a scene, with arguments for either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evis.config import paths
from evis.config.params import Param
from evis.config.removed import instead
from evis.launch.arguments import ArgumentError, option_for
from evis.launch.files import LaunchFile, load
from evis.scene.load import parse_args, scene_args, scene_values


@dataclass
class Target:
    """Holds a launch file and the arguments given to it. preset: those of them that its name stands for, as
    scene=drone.
    """

    launch: LaunchFile
    given: dict[str, Any]
    preset: dict[str, str]

    @property
    def name(self) -> str:
        """Tells what the graph is called: the scene that was named, or the file."""
        return self.preset.get("scene", self.launch.path.stem)


def read_target(name: str, given: Mapping[str, Any] | None = None) -> Target:
    """Reads a FILE|NAME with its arguments, those of its scene among its scene_args. Raises LaunchError,
    UnknownLaunch.
    """
    given = dict(given or {})
    path, preset = paths.find_launch(name)
    launch = load(path)
    for key, value in preset.items():
        if key in given:
            raise ArgumentError(f"the {key} is given twice, as {value} and {key}:={given[key]}")
    return Target(launch, with_scene_arguments(launch, {**preset, **given}), preset)


def scene_arguments(launch: LaunchFile, given: Mapping[str, Any]) -> dict[str, Param]:
    """Returns the arguments of the scene that a launch file would run, without those that the file has itself.

    Raises FileNotFoundError for a scene that there is not, SceneError for one that is wrong.
    """
    scene = _scene(launch, given)
    found = scene_args(scene) if scene else {}
    return {key: param for key, param in found.items() if key not in launch.arguments}


def with_scene_arguments(launch: LaunchFile, given: Mapping[str, Any]) -> dict[str, Any]:
    """Returns `given`, where what the launch file does not know is in the scene's `scene_args`. Raises
    ArgumentError.
    """
    known = launch.arguments
    scene = _scene(launch, given)
    if not scene or (scene == known["scene"].param.default and all(key in known for key in given)):
        return dict(given)
    try:
        scenes = scene_args(scene)
    except FileNotFoundError as error:
        raise ArgumentError(f"{launch.path.name}: {error}") from None
    for key in given:
        if key not in known and key not in scenes:
            hint = option_for(key, given[key]) or instead(key, [*(k for k in scenes if k not in known), *known])
            raise ArgumentError(f"neither scene {Path(scene).stem} nor {launch.path.name} has '{key}'; {hint}")
    own = {k: v for k, v in given.items() if k not in known}
    if not own:
        return dict(given)
    text = ",".join([str(given.get("scene_args", "")), *(f"{k}={_text(v)}" for k, v in own.items())]).strip(",")
    return {k: v for k, v in given.items() if k not in own} | {"scene_args": text}


def values_of_scene(launch: LaunchFile, values: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the scene's own arguments with their values, for a launch file's arguments in full; none where they are
    wrong, which whoever loads the scene says.
    """
    scene = _scene(launch, values)
    try:
        found = scene_values(scene, parse_args(values["scene_args"])) if scene else {}
    except (ValueError, OSError):
        return {}
    return {key: value for key, value in found.items() if key not in values}


def _scene(launch: LaunchFile, given: Mapping[str, Any]) -> str:
    """Finds the scene that is given, or that the file names; "" where it takes none with arguments."""
    if not {"scene", "scene_args"} <= launch.arguments.keys():
        return ""
    scene = given.get("scene", launch.arguments["scene"].param.default)
    return scene if isinstance(scene, str) and "${" not in scene else ""


def _text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
