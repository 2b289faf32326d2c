"""Makes MuJoCo's model of a scene, of the MJCF or URDF that the scene names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import mujoco

from evis.scene.folders import Folders
from evis.scene.mjcf.compiling.compile import Edit, compile_mjcf
from evis.scene.mjcf.compiling.delays import keep_delays
from evis.scene.mjcf.compiling.urdf import mujoco_model
from evis.scene.model import Scene


def folders_of(scene: Scene) -> Folders:
    """Returns the folders in which the files of the scene's model may lie: its own folder unless the scene says
    more.
    """
    assert scene.mjcf is not None
    return scene.folders or Folders(scene.mjcf.parent)


def compile_model(scene: Scene, deepest: bool = False, step_of: Callable[[float], float] | None = None) -> Any:
    """Compiles the MjModel that moves a scene's bodies, with the scene's changes: no visual geometry of a URDF. Raises
    SceneError.

    deepest: with a sensor of the least distance of its contacts [m], 0 while there are none, as its last.
    step_of: gives the step [s] that will be taken for a timestep; controls are delayed in it as in the model's own.
    """
    assert scene.mjcf is not None
    urdf = scene.mjcf.suffix.lower() == ".urdf"
    compile_it = partial(mujoco_model if urdf else compile_mjcf, scene.mjcf, folders_of(scene))
    edits: list[Edit] = [add_deepest] if deepest else []
    if scene.actuators:
        from evis.scene.mjcf.added_actuators import add_actuators

        edits.append(partial(add_actuators, actuators=scene.actuators))
    model = compile_it(edits)
    if step_of is not None and model.actuator_delay.any():
        model = compile_it([*edits, partial(keep_delays, file=scene.mjcf.name, step=step_of(model.opt.timestep))])
    if scene.changes:
        from evis.scene.mjcf.changes import apply_changes

        apply_changes(model, scene.changes)
    return model


def add_deepest(spec: Any) -> None:
    """Adds a sensor of the least distance of all contacts [m], 0 while there are none."""
    distance = 1 << int(mujoco.mjtConDataField.mjCONDATA_DIST)
    # the last two: reduced to the least distance, of one contact
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_CONTACT, intprm=[distance, 1, 1])
