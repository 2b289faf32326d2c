"""Loads a Scene by the name or file of a scene, and tells of one what its file says without loading it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evis.config.document import Table
from evis.config.params import Param
from evis.config.paths import find, names, other_than_model
from evis.config.suggestions import nearest
from evis.files.regular import other_than_file
from evis.scene.draws import Draws
from evis.scene.errors import SceneError
from evis.scene.model import MODELS, Scene
from evis.scene.yaml.arguments import declared_in, folders_in, stands_for, values_of
from evis.scene.yaml.document import read_document
from evis.scene.yaml.drawing import drawn_within


def load_scene(
    name_or_path: str,
    overrides: Mapping[str, Any] | None = None,
    *,
    textures: bool = True,
    visuals: bool = True,
    seed: int = 0,
    made: dict[Any, Any] | None = None,
) -> Scene:
    """Loads a scene with its arguments at their defaults or as in `overrides` (width, height, and the scene's own).

    name_or_path: a scene that comes with evis, a YAML file, or an MJCF (.xml) or URDF (.urdf) file by itself.
    seed: decides what the file leaves to chance; environment k of a run has the world of the run's seed + k.
    made: meshes and textures of other worlds, which this one shares where it has the same.
    textures=False: no texture is made. visuals=False: for those who need only bodies and cameras, nothing that is
    seen is made: no instances, materials, lights or sky. Raises SceneError or ParamError (both ValueError), or
    FileNotFoundError, each with one line that names the file, the key and the nearest valid one.
    """
    from evis.scene.yaml.build import build

    path = find_scene(name_or_path)
    table, draws = read_document(path), Draws(seed)
    values = values_of(path, table, overrides or {}, draws)
    return build(table, path, values, textures and visuals, visuals, draws, made)


def scene_values(name_or_path: str, overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Returns every argument of a scene with its value, given ones over defaults, None for one that is drawn. Raises
    ParamError, SceneError, FileNotFoundError as `load_scene`.
    """
    path, draws = find_scene(name_or_path), Draws(0)
    values = values_of(path, read_document(path), overrides, draws)
    return {key: None if any(stands_for(key, place) for place in draws.made) else v for key, v in values.items()}


def scene_args(name_or_path: str) -> dict[str, Param]:
    """Returns the arguments of a scene, name -> typed parameter; width and height are always among them."""
    path = find_scene(name_or_path)
    return declared_in(path, read_document(path))[0]


def folder_args(name_or_path: str) -> list[str]:
    """Names the arguments of a scene that are folders, of pictures or meshes. Reads the YAML only."""
    return folders_in(read_document(find_scene(name_or_path)))


def is_dynamic(name_or_path: str) -> bool:
    """Returns True when the scene needs a physics engine. Reads the YAML only, not the model it names."""
    path = find_scene(name_or_path)
    return "mjcf" in read_document(path)


def may_be_driven(name_or_path: str) -> bool:
    """Returns False when the scene has no actuators, as far as its YAML and the text of the model it names tell."""
    from evis.scene.mjcf.actuated import may_be_driven as driven

    path = find_scene(name_or_path)
    document = read_document(path)
    model = document.get("mjcf")
    return model is not None and ("actuators" in document or driven(path.parent / str(model)))


def sets_sensor(name_or_path: str) -> bool:
    """Returns True when the scene has parameters of the event sensor. Reads the YAML only, as `is_dynamic` does."""
    return "sensor" in read_document(find_scene(name_or_path))


def starts_at_random(name_or_path: str) -> tuple[str, ...]:
    """Names those of which the seed decides the start: free bodies, joints by name. Reads the YAML only."""
    document = read_document(find_scene(name_or_path))
    spread, joints = document.get("initial_spread"), document.get("initial_joints")
    starts = joints.items() if isinstance(joints, Table) else ()
    drawn = [name for name, start in starts if any(isinstance(value, list) for value in _entries(start))]
    free = any(str(value).split()[:1] not in (["0"], ["0.0"]) for value in _entries(spread))
    return (*(("free bodies",) if free else ()), *(f"joint {name}" for name in drawn))


def _entries(value: Any) -> list[Any]:
    """Lists the values of a map; of what is no map, which only loading refuses, there are none."""
    return list(value.values()) if isinstance(value, Table) else []


def drawn_places(name_or_path: str, overrides: Mapping[str, Any]) -> list[str]:
    """Lists the places of a scene file whose values the seed decides, with these arguments. Reads the YAML only.

    An argument that is given is not drawn. Raises as `scene_values` does.
    """
    document, values = read_document(find_scene(name_or_path)), scene_values(name_or_path, overrides)
    found = drawn_within(document, values)
    given = [f"args.{name}.default" for name in overrides]
    return [place.removesuffix(".default") for place in found if place.partition("[")[0] not in given]


def camera_rates(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Returns the keyframes per second [Hz] of the cameras that have a rate of their own. Raises as load_scene does.

    A scene where no camera has one is not loaded for it.
    """
    cameras = read_document(find_scene(name_or_path)).get("cameras")
    if not any(isinstance(entry, Table) and "rate" in entry for entry in _entries(cameras)):
        return {}
    found = load_scene(name_or_path, overrides, visuals=False).cameras
    return {camera.name: camera.rate for camera in found if camera.rate is not None}


def camera_names(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> list[str] | None:
    """Names the cameras that a scene file declares, as they are found, in its order; None where it declares none and
    has those of its model.

    The scene is loaded for it only where an entry stands for several. Raises as load_scene does.
    """
    path = find_scene(name_or_path)
    cameras = None if path.suffix.lower() in MODELS else read_document(path).get("cameras")
    if not isinstance(cameras, Table) or not cameras:
        return None
    if any(isinstance(entry, Table) and "copies" in entry for entry in cameras.values()):
        return [camera.name for camera in load_scene(name_or_path, overrides, visuals=False).cameras]
    return list(cameras) if len(cameras) > 1 else ["cam0"]


def find_scene(name_or_path: str) -> Path:
    """Finds the file of a scene by name or path. Raises FileNotFoundError naming the nearest one."""
    direct = Path(name_or_path)
    if (kind := other_than_model(direct)) and direct.is_file():
        raise FileNotFoundError(f"{name_or_path} is {kind}")
    if direct.suffix.lower() in MODELS and direct.is_file():
        return direct
    path = find("scenes", name_or_path)
    if path is None:
        if what := other_than_file(name_or_path):
            raise FileNotFoundError(f"{name_or_path}: it is {what}, and a scene must be a file")
        known = names("scenes")
        raise FileNotFoundError(f"no scene '{name_or_path}'; {nearest(direct.stem, known)}")
    return path


def parse_args(text: str | Mapping[str, Any] | None) -> dict[str, Any]:
    """Parses arguments written as text: `omega=50,centre=0.1,-0.2` gives {"omega": "50", "centre": "0.1,-0.2"}; a map
    is returned as it is.

    A piece without `=` goes on with the value before it. Raises SceneError.
    """
    if not isinstance(text, str):
        return {k: v for k, v in (text or {}).items() if v is not None}
    result: dict[str, Any] = {}
    key = ""
    for piece in filter(None, (p.strip() for p in text.split(","))):
        if "=" in piece:
            key, value = (part.strip() for part in piece.split("=", 1))
            result[key] = value
        elif key:
            result[key] += f",{piece}"
        else:
            raise SceneError(f"scene_args '{text}' is not key=value,key=value: '{piece}' has no '='")
    return result
