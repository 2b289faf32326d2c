"""Finds the user's own files that sequences are made of: scene files, what they name, folders of pictures and meshes.

They are hashed into the recipe's digest, so that a data set is never made of two versions of one.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evis.config import paths
from evis.config.document import LaunchError
from evis.dataset.making.finished import sha256_of
from evis.dataset.recipe import SceneDraws
from evis.launch.target import Target
from evis.scene.draws import Choice
from evis.scene.errors import SceneError
from evis.scene.load import find_scene, folder_args, load_scene, scene_args
from evis.scene.model import Scene
from evis.scene.own.folder import MESHES, PICTURES
from evis.scene.sources import noting


def folders_of(graph: Target) -> list[str]:
    """Names the arguments of a target that are folders."""
    scene = _scene_of(graph)
    return folder_args(scene) if scene else []


def files_of(scenes: Sequence[SceneDraws]) -> dict[str, str]:
    """Hashes the user's files of all scenes: name, as from the recipe's folder -> SHA-256; a folder counts as one.

    Every picture and mesh of a folder is looked at. Raises LaunchError with file:line of the scene in the recipe.
    """
    found: dict[str, str] = {}
    for scene in scenes:
        try:
            for name, place in scene.all_folders().items():
                found[name] = _folder(Path(place), name)
            for path in _of_scene(scene):
                found[Path(os.path.relpath(path, scene.home)).as_posix()] = sha256_of(path)
        except (SceneError, OSError) as error:
            raise LaunchError(f"{scene.where}: {error}") from None
    return dict(sorted(found.items()))


def _scene_of(graph: Target) -> str:
    """The scene that a target simulates; "" for a launch file that names none."""
    argument = graph.launch.arguments.get("scene")
    scene = graph.given.get("scene", argument.param.default if argument else None)
    return scene if isinstance(scene, str) and "${" not in scene else ""


def _of_scene(scene: SceneDraws) -> list[Path]:
    """Files that a scene of the user's is read from, itself among them; none of one that comes with evis."""
    try:
        path = find_scene(scene.target)
    except FileNotFoundError:
        return [Path(scene.target)] if Path(scene.target).is_file() else []  # a launch file
    if path.resolve().is_relative_to(paths.data_folder("scenes").resolve()):
        return []
    known, found = scene_args(scene.target), set()
    for arguments in scene.corners():
        with noting() as noted:
            made = load_scene(scene.target, _own(arguments, known))
        found |= {name for name in noted if name.is_file()} | set(_choices(made, path.parent))
    places = [Path(place) for place in scene.all_folders().values()]
    return sorted(file for file in found if not any(file.is_relative_to(place) for place in places))


def _own(arguments: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in arguments.items() if name in known}


def _choices(scene: Scene, folder: Path) -> list[Path]:
    """Files that other seeds would draw."""
    drawn = [one.law for one in scene.drawn if one.place.endswith(".file")]
    names = [str(name) for law in drawn if isinstance(law, Choice) for name in law.values]
    return [path.absolute() for name in names if (path := folder / name).is_file()]


def _folder(folder: Path, name: str) -> str:
    """The SHA-256 of the names and the content of all files below a folder. Raises SceneError for one that is wrong."""
    if not folder.is_dir():
        what = "is no folder" if folder.exists() else "is not there"
        raise SceneError(f"the folder {name} {what}; name one of pictures or meshes, from where the recipe lies")
    digest = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")):
        _check(file, name)
        digest.update(f"{file.relative_to(folder).as_posix()}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()


def _check(file: Path, folder: str) -> None:
    """Raises SceneError for a picture that is none, and a mesh without triangles."""
    ending = file.suffix.lower()
    try:
        if ending in PICTURES.endings:
            from evis.scene.own.picture import check_file

            check_file(file)
        elif ending in MESHES.endings:
            from evis.scene.own.mesh import read_mesh

            read_mesh(file, textures=False)
    except SceneError as error:
        raise SceneError(f"the folder {folder}: {error}; mend the file or take it away") from None
