"""URDF robots through MuJoCo's own reader, with their visual geometry."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

VISUAL_GROUP = 1
"""Group in which MuJoCo puts the visual geometry of a URDF; its collision geometry is in group 0."""


def compile_urdf(path: Path) -> tuple[Any, Any, str | None]:
    """The MjModel of a URDF by itself, the same with its visual geometry, and a note where that was not possible.

    MuJoCo leaves visual geometry out unless the file asks for it in <mujoco><compiler discardvisual="false"/></mujoco>;
    here that is the default. Bodies and joints are the same either way. Raises ValueError as MuJoCo does.
    """
    model = mujoco_model(path)
    try:
        return model, mujoco.MjModel.from_xml_string(_text(path, visuals=True)), None
    except (ValueError, ET.ParseError, OSError) as error:
        reason = " ".join(str(error).split())[:200]
        note = f"the collision geometry of {path.name} is drawn, its visual geometry cannot be read: {reason}"
        return model, model, note


def mujoco_model(path: Path) -> Any:
    """The MjModel of a URDF without its visual geometry. Raises ValueError as MuJoCo does."""
    try:
        text = _text(path, visuals=False)
    except (ET.ParseError, OSError):
        return mujoco.MjModel.from_xml_path(str(path))  # which says what is wrong
    return mujoco.MjModel.from_xml_string(text)


def drawn(model: Any) -> np.ndarray:
    """Which geoms are seen, bool [ngeom]: the visual ones of bodies that have any, else the collision ones."""
    visual = model.geom_group == VISUAL_GROUP
    return visual | ~np.isin(model.geom_bodyid, model.geom_bodyid[visual])


def _text(path: Path, visuals: bool) -> str:
    """The file with every mesh by its whole path: a model that is given as text has no folder of its own."""
    root = ET.parse(path).getroot()
    extension = root.find("mujoco")
    if extension is None:
        extension = ET.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ET.SubElement(extension, "compiler")
    if visuals and compiler.get("discardvisual") is None:
        compiler.set("discardvisual", "false")
    folder = path.parent / compiler.get("meshdir", ".")
    compiler.attrib.pop("meshdir", None)
    compiler.set("strippath", "false")
    keeps = compiler.get("discardvisual") == "false"
    for part in ("visual", "collision") if keeps else ("collision",):
        for mesh in root.iterfind(f".//{part}//mesh"):
            mesh.set("filename", str(mesh_file(mesh.get("filename", ""), path, folder)))
    return ET.tostring(root, encoding="unicode")


def mesh_file(name: str, urdf: Path, folder: Path) -> Path:
    """The file that a URDF calls by a path from `folder`, a `file://` or a `package://`. Raises ValueError.

    A ROS package is looked for among the folders above the URDF and beside them, then in ROS_PACKAGE_PATH and
    AMENT_PREFIX_PATH.
    """
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        found = next((place / rest for place in _packages(package, urdf) if (place / rest).is_file()), None)
        if found is None:
            raise ValueError(
                f"{urdf.name}: no file {name}; package '{package}' is looked for above {urdf.parent.resolve()} and in "
                "ROS_PACKAGE_PATH and AMENT_PREFIX_PATH"
            )
        return found.resolve()
    whole = folder / name.removeprefix("file://")
    bare = folder / Path(name).name  # where MuJoCo looks by itself
    return (bare if bare.is_file() and not whole.is_file() else whole).resolve()


def _packages(name: str, urdf: Path) -> Iterator[Path]:
    for above in urdf.resolve().parents:
        if above.name == name or _name_in(above / "package.xml") == name:
            yield above
        yield above / name
    for entry in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(entry) / name
        if Path(entry).name == name:
            yield Path(entry)
    for entry in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(entry) / "share" / name


def _name_in(manifest: Path) -> str:
    try:
        return (ET.parse(manifest).getroot().findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return ""
