"""MuJoCo's model of a scene, of the MJCF or URDF that the scene names."""

from __future__ import annotations

from typing import Any

from evis.scene.folders import Folders
from evis.scene.mjcf.compile import compile_mjcf
from evis.scene.mjcf.urdf import mujoco_model
from evis.scene.model import Scene


def folders_of(scene: Scene) -> Folders:
    """Returns the folders in which the files of the scene's model may lie: its own folder unless the scene says
    more.
    """
    assert scene.mjcf is not None
    return scene.folders or Folders(scene.mjcf.parent)


def compile_model(scene: Scene, deepest: bool = False) -> Any:
    """Compiles the MjModel that moves a scene's bodies, with the scene's changes: no visual geometry of a URDF. Raises
    SceneError.

    deepest: with a sensor of the least distance of its contacts [m], 0 while there are none, as its last.
    """
    assert scene.mjcf is not None
    urdf = scene.mjcf.suffix.lower() == ".urdf"
    model = (mujoco_model if urdf else compile_mjcf)(scene.mjcf, folders_of(scene), deepest)
    if scene.changes:
        from evis.scene.mjcf.changes import apply_changes

        apply_changes(model, scene.changes)
    return model
