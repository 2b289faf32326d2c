"""URDF robots through MuJoCo's own reader, with their visual geometry."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

VISUAL_GROUP = 1
"""Group in which MuJoCo puts the visual geometry of a URDF; its collision geometry is in group 0."""


def compile_urdf(path: Path) -> tuple[Any, str | None]:
    """The MjModel of a URDF with its visual geometry kept, and a note where that was not possible.

    MuJoCo leaves visual geometry out unless the file asks for it in <mujoco><compiler discardvisual="false"/></mujoco>;
    here that is the default. Bodies and joints are the same either way. Raises ValueError as MuJoCo does.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    try:
        return mujoco.MjModel.from_xml_string(_with_visuals(path)), None
    except (ValueError, ET.ParseError, OSError) as error:
        reason = " ".join(str(error).split())[:150]
        return model, f"the collision geometry of {path.name} is drawn, its visual geometry cannot be read: {reason}"


def drawn(model: Any) -> np.ndarray:
    """Which geoms are seen, bool [ngeom]: the visual ones of bodies that have any, else the collision ones."""
    visual = model.geom_group == VISUAL_GROUP
    return visual | ~np.isin(model.geom_bodyid, model.geom_bodyid[visual])


def _with_visuals(path: Path) -> str:
    root = ET.parse(path).getroot()
    extension = root.find("mujoco")
    if extension is None:
        extension = ET.SubElement(root, "mujoco")
    compiler = extension.find("compiler")
    if compiler is None:
        compiler = ET.SubElement(extension, "compiler")
    if compiler.get("discardvisual") is None:
        compiler.set("discardvisual", "false")
    # A model given as text has no folder of its own.
    compiler.set("meshdir", str((path.parent / compiler.get("meshdir", ".")).resolve()))
    return ET.tostring(root, encoding="unicode")
