"""Tells whether anything in a model can be driven, without MuJoCo."""

from __future__ import annotations

from pathlib import Path

from evis.scene.errors import SceneError
from evis.scene.mjcf.compiling.xml import read_xml

ELSEWHERE = frozenset({"include", "attach", "model", "plugin"})
"""Elements that bring what stands in other files, or is made by a program."""

ROOTS = ("mujoco", "robot")
"""Outermost elements of a model and of a URDF."""


def may_be_driven(path: Path) -> bool:
    """Tells whether a MuJoCo model or URDF may have actuators. False is certain; a model that has others in it is not
    looked into.
    """
    try:
        root = read_xml(path)
    except (SceneError, OSError):  # who loads it says so
        return True
    left = [element for element in root.children if element.tag in ROOTS]
    if not left:
        return True
    while left:
        element = left.pop()
        if element.tag in ELSEWHERE or "actuator" in element.tag:
            return True
        left += element.children
    return False
