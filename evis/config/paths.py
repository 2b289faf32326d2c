"""Finds where launch files and scenes lie: at the top of a checkout, inside the package when installed from a wheel."""

from __future__ import annotations

import os
from pathlib import Path

from evis.config.suggestions import closest, did_you_mean, nearest
from evis.files.regular import other_than_file

_PACKAGE = Path(__file__).resolve().parents[1]
LAUNCHED = (".yaml", ".yml", ".xml", ".urdf")
"""Endings of the files that may stand after `evis launch`."""
LIKE = 0.75
"""Likeness from which on a file with such an ending is suggested, which all of them share, 0 ... 1."""
MOST_LOOKED_AT = 1 << 20
"""Of a file to tell a scene from a launch file [characters]; longer ones are neither."""


def data_folder(kind: str) -> Path:
    """Returns the folder `launch` or `scenes`. Raises FileNotFoundError when the installation lacks it."""
    for folder in (_PACKAGE / "data" / kind, _PACKAGE.parent / kind):
        if any(folder.glob("*.yaml")):
            return folder
    raise FileNotFoundError(f"this installation has no {kind}/ folder; install evis again")


def names(kind: str) -> list[str]:
    """Lists the names of the launch files or scenes that come with evis, without .yaml."""
    try:
        return sorted(path.stem for path in data_folder(kind).glob("*.yaml"))
    except FileNotFoundError:
        return []


def find(kind: str, name: str) -> Path | None:
    """Finds the file of a launch file or scene by path or by name; None when there is none.

    A name that is too long for the system is one that is not there, as by all of `os.path`.
    """
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or "/" in name:
        if os.path.isfile(path):
            return path
    try:
        path = data_folder(kind) / f"{name.removesuffix('.yaml')}.yaml"
    except FileNotFoundError:
        return None
    return path if "/" not in name and os.path.isfile(path) else None


def _is_scene(path: Path) -> bool:
    """Whether a YAML file has a scene's keys and none that only a launch file has."""
    try:
        with path.open(encoding="utf-8") as file:
            keys = {line.partition(":")[0] for line in file.read(MOST_LOOKED_AT).splitlines()}
    except (OSError, UnicodeDecodeError):
        return False
    return bool(keys & {"cameras", "bodies", "world", "mjcf"}) and "nodes" not in keys


def _beside(path: Path) -> Path | None:
    """Finds the file that may be meant by one that is not there: the same without its ending, or a like name."""
    try:
        files = sorted(other.name for other in path.parent.iterdir() if other.suffix in LAUNCHED and other.is_file())
    except (OSError, ValueError):
        return None
    near = next((file for file in files if Path(file).stem == path.name), None)
    if near is None and path.suffix in LAUNCHED:
        near = closest(path.name, files, LIKE)
    return path.with_name(near) if near else None


_SCENE_NAMES_IT = "; a scene file names it: `world: [{shape: mesh, file: FILE}]`"
_OTHERS = {
    "a mesh" + _SCENE_NAMES_IT: (".obj", ".ply", ".stl", ".gltf", ".glb"),
    "of a kind that is not read; export it as glTF" + _SCENE_NAMES_IT: (".dae", ".fbx", ".blend"),
    "USD, which is not read; export it as MJCF or URDF, or its meshes as glTF": (".usd", ".usda", ".usdc", ".usdz"),
    "SDF, which is not read; convert it to URDF or MJCF": (".sdf",),
    "a compiled MuJoCo model; give the MJCF that it was compiled from": (".mjb",),
    "a packed MuJoCo model; unpack it and give the MJCF in it": (".mjz",),
}
"""Files of worlds and things that are no scene, by their endings: what they are, and what helps."""


def other_than_model(path: str | Path) -> str:
    """Tells what a file is by its ending, and what helps, where it holds a world or thing and is no scene or model;
    "" of all others."""
    ending = Path(path).suffix.lower()
    if ending == ".mjcf" or (ending == ".xml" and Path(path).suffix != ending):
        return "a MuJoCo model by another ending; rename it so that it ends in .xml, by which MuJoCo knows it"
    return next((what for what, endings in _OTHERS.items() if ending in endings), "")


class UnknownLaunch(FileNotFoundError):
    """Says that what was named is neither a launch file nor a scene."""


def find_launch(name: str) -> tuple[Path, dict[str, str]]:
    """Finds the launch file for what stands after `evis launch`, and the arguments that go with it.

    name: a path or name of a launch file or of a scene, or an MJCF or URDF file (a scene goes with simulator.yaml and
    scene:=NAME). Raises UnknownLaunch naming the nearest one.
    """
    if name.endswith(".xacro") and os.path.isfile(name):
        raise UnknownLaunch(f"{name} has to be expanded first: `xacro {name} > robot.urdf`, and launch that")
    if os.path.isfile(name) and (kind := other_than_model(name)):
        raise UnknownLaunch(f"{name} is {kind}")
    is_model = name.lower().endswith((".xml", ".urdf")) and os.path.isfile(name)
    path = None if is_model else find("launch", name)
    if path is not None and not _is_scene(path):
        return path, {}
    simulator = find("launch", "simulator")
    if simulator is not None and (is_model or path is not None or find("scenes", name) is not None):
        return simulator, {"scene": name}
    if os.path.isfile(name):
        play = f"replay bag:={name}" if name.endswith(".mcap") else f"camera file:={name}"
        raise UnknownLaunch(f"{name} is no launch file and no scene; `evis launch {play}` plays a recording")
    what = other_than_file(name)
    if what and not os.path.isdir(name):
        raise UnknownLaunch(f"{name}: it is {what}, and must be a file")
    if beside := _beside(Path(name)):
        raise UnknownLaunch(f"{name}: no such file; did you mean '{beside}'?")
    known = sorted({*names("launch"), *names("scenes")})
    if "/" in name or Path(name).suffix not in ("", ".yaml", ".yml") or os.path.isdir(name):
        hint = "no such file" + did_you_mean(Path(name).stem, known)
        raise UnknownLaunch(f"{name}: {'is a folder; name a file in it' if os.path.isdir(name) else hint}")
    raise UnknownLaunch(f"no launch file or scene '{name}'; {nearest(Path(name).stem, known)}")
