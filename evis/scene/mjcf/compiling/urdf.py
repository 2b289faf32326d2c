"""Reads URDF robots through MuJoCo's own reader, with their visual geometry."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import mujoco
import numpy as np

from evis.files.regular import other_than_file
from evis.scene.errors import SceneError
from evis.scene.folders import Folders
from evis.scene.mjcf.compiling.asset_cache import refresh_cache
from evis.scene.mjcf.compiling.check import check_model
from evis.scene.mjcf.compiling.compile import Edit, compiled, edited, in_one_line
from evis.scene.sources import note

XACRO = re.compile(r"\$[{(]")
MASSLESS = (
    "Links that move need an <inertial> with mass and inertia, or "
    '<mujoco><compiler boundmass="0.001" boundinertia="1e-6"/></mujoco> in the <robot>, the least that each has'
)
VISUAL_GROUP = 1
"""Group in which MuJoCo puts the visual geometry of a URDF; its collision geometry is in group 0."""


def compile_urdf(path: Path, folders: Folders) -> tuple[Any, Any, str | None]:
    """Compiles a URDF: its MjModel by itself, the same with its visual geometry, and a note where that was not
    possible.

    MuJoCo leaves visual geometry out unless the file asks for it in <mujoco><compiler discardvisual="false"/></mujoco>;
    here that is the default. Bodies and joints are the same either way. folders: where its meshes may lie. Raises
    SceneError, also for a visual mesh outside of the folders.
    """
    model = mujoco_model(path, folders)
    try:
        return model, mujoco.MjModel.from_xml_string(_text(path, folders, visuals=True)), None
    except SceneError:
        raise
    except (ValueError, RuntimeError, ET.ParseError, OSError) as error:
        reason = in_one_line(error)
        note = f"the collision geometry of {path.name} is drawn, its visual geometry cannot be read: {reason}"
        return model, model, note


def unused_textures(path: Path) -> str | None:
    """Tells which pictures a URDF names for its materials, which MuJoCo does not read; None where there are none."""
    try:
        found = [texture.get("filename", "") for texture in _root(path).iterfind(".//material/texture")]
    except (ET.ParseError, OSError):
        return None
    named = ", ".join(dict.fromkeys(found))
    return f"textures of URDF materials are not drawn: {named}" if found else None


def mujoco_model(path: Path, folders: Folders, edits: Sequence[Edit] = ()) -> Any:
    """Compiles the MjModel of a URDF without its visual geometry, with some edits. Raises SceneError in one line that
    names the file.
    """
    check_model(path, folders.also(*_own_package(path)))
    try:
        text = _text(path, folders, visuals=False)
    except (ET.ParseError, OSError):
        return compiled(path, lambda: mujoco.MjModel.from_xml_path(str(path)))  # which says what is wrong
    except SceneError:
        raise
    except ValueError as error:
        raise SceneError(str(error)) from None
    try:
        if edits:
            return compiled(path, lambda: edited(mujoco.MjSpec.from_string(text), edits))
        return compiled(path, lambda: mujoco.MjModel.from_xml_string(text))
    except SceneError as error:
        if "mjMINVAL" not in str(error):
            raise
        raise SceneError(f"{error}. {MASSLESS}") from None


def drawn(model: Any) -> np.ndarray:
    """Tells which geoms are seen, bool [ngeom]: the visual ones of bodies that have any, else the collision ones."""
    visual = model.geom_group == VISUAL_GROUP
    return visual | ~np.isin(model.geom_bodyid, model.geom_bodyid[visual])


def _root(path: Path) -> ET.Element:
    """Parses a file of XML as UTF-8, whatever encoding it says: `check_model` has read it so, and MuJoCo does. Raises
    ET.ParseError, OSError.
    """
    return ET.fromstring(path.read_text(encoding="utf-8-sig", errors="replace"))


def _text(path: Path, folders: Folders, visuals: bool) -> str:
    """The file with every mesh by its whole path: a model that is given as text has no folder of its own."""
    folders = folders.also(*_own_package(path))
    root = _root(path)
    _refuse_xacro(root, path)
    extension = root.find("mujoco")
    if extension is None:
        extension = ET.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ET.SubElement(extension, "compiler")
    if visuals and compiler.get("discardvisual") is None:
        compiler.set("discardvisual", "false")
    folder = path.parent / compiler.get("meshdir", compiler.get("assetdir", "."))
    for key in ("meshdir", "assetdir"):
        compiler.attrib.pop(key, None)
    compiler.set("strippath", "false")
    keeps = compiler.get("discardvisual") == "false"
    for part in ("visual", "collision") if keeps else ("collision",):
        for mesh in root.iterfind(f".//{part}//mesh"):
            mesh.set("filename", str(refresh_cache(note(mesh_file(mesh.get("filename", ""), path, folder, folders)))))
    return ET.tostring(root, encoding="unicode")


def _refuse_xacro(root: ET.Element, path: Path) -> None:
    """Raises SceneError for what ROS's xacro has yet to make a URDF of: to MuJoCo its elements are nothing, and robots
    lack parts.
    """
    for element in root.iter():
        macro = "xacro}" in str(element.tag)
        value = next((value for value in element.attrib.values() if XACRO.search(value)), None)
        if macro or value:
            what = f"<xacro:{element.tag.partition('}')[2]}>" if macro else f"{value} in <{element.tag}>"
            raise SceneError(
                f"{path.name}: {what} is xacro, which has to be expanded first: "
                f"`xacro {path.name} > robot.urdf`, and launch that"
            )


def mesh_file(name: str, urdf: Path, folder: Path, folders: Folders) -> Path:
    """Finds the file that a URDF calls by a path from `folder`, a `file://` or a `package://`. Raises ValueError.

    A ROS package is looked for among the folders above the URDF and beside them, then in ROS_PACKAGE_PATH and
    AMENT_PREFIX_PATH. Above and beside, it counts as a folder of the scene only with a package.xml that names it; of
    packages in the environment links are followed wherever they lead. Raises SceneError for a file outside.
    """
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        if package in ("", ".", ".."):
            raise ValueError(f"{urdf.name}: {name} names no package")
        found = next((found for found in _packages(package, urdf) if (found[0] / rest).is_file()), None)
        if found is None:
            raise ValueError(
                f"{urdf.name}: no file {name}; package '{package}' is looked for above {urdf.parent.resolve()} and in "
                "ROS_PACKAGE_PATH and AMENT_PREFIX_PATH"
            )
        place, says_so = found
        path = Path(os.path.normpath(place / rest))
        if not (says_so == "environment" and path.is_relative_to(os.path.normpath(place))):
            (folders.also(place) if says_so else folders).check(path, f"{urdf.name}: '{name}'")
        return path.resolve()
    whole = folder / unquote(name.removeprefix("file://")) if name.startswith("file://") else folder / name
    bare = folder / Path(name).name  # where MuJoCo looks by itself
    path = bare if bare.is_file() and not whole.is_file() else whole
    if not path.is_dir() and (what := other_than_file(path)):
        raise SceneError(f"{urdf.name}: '{name}' is {what}, and must be a file")
    if path.is_file():
        folders.check(path, f"{urdf.name}: '{name}'")
    return path.resolve()


def _packages(name: str, urdf: Path) -> Iterator[tuple[Path, str]]:
    """Folders that may be a ROS package of this name, and what says so: `manifest`, `environment`, or only its name."""
    for above in urdf.resolve().parents:
        named = _name_in(above / "package.xml")
        if above.name == name or named == name:
            yield above, "manifest" if named == name else ""
        beside = above / name
        yield beside, "manifest" if _name_in(beside / "package.xml") == name else ""
    for entry in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(entry) / name, "environment"
        if Path(entry).name == name:
            yield Path(entry), "environment"
    for entry in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(entry) / "share" / name, "environment"


def _own_package(urdf: Path) -> tuple[Path, ...]:
    """The ROS package that the URDF is a part of: what lies in it is its own."""
    return next(((above,) for above in urdf.resolve().parents if (above / "package.xml").is_file()), ())


def _name_in(manifest: Path) -> str:
    try:
        return (_root(manifest).findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return ""
