"""Adds actuators to joints of a model, as `actuators:` of a scene file says it: a URDF cannot have any.

    actuators: {JOINT: {kind: position (gain, damping) | velocity (gain) | motor (gain), range: [least, most]}}

JOINT may hold `*` and `?`, and then stands for all hinges and slides that match. A position servo's force is
gain (control - position) - damping velocity, a velocity servo's gain (control - velocity), a motor's gain control; in
N m of a hinge [rad], N of a slide [m]. They are limited to the effort of a URDF's joint, as all of MuJoCo's are.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.mjcf.changes import matched
from evis.scene.mjcf.frames import name_of
from evis.scene.model import AddedActuator
from evis.scene.yaml.reader import Fields

KINDS = ("position", "velocity", "motor")
_MOVABLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def read_actuators(fields: Fields, model: Any) -> list[AddedActuator]:
    """Reads the actuators that a scene file adds to a compiled model, in the order of its joints. Raises SceneError."""
    joints = [name_of(model, mujoco.mjtObj.mjOBJ_JOINT, i, "") for i in range(model.njnt)]
    numbers = {joints[i]: i for i in range(model.njnt) if int(model.jnt_type[i]) in _MOVABLE}
    names = list(numbers)
    found: dict[int, AddedActuator] = {}
    for number, entry in matched(fields, "actuators", names, "hinges and slides"):
        joint = numbers[names[number]]
        if joint in found:
            raise entry.error(None, f"gives joint '{names[number]}' a second actuator; leave one of them out")
        found[joint] = _read(entry, names[number], model, joint)
        entry.done()
    return [found[joint] for joint in sorted(found)]


def _read(fields: Fields, name: str, model: Any, joint: int) -> AddedActuator:
    kind = fields.text("kind", choices=KINDS)
    gain = fields.number("gain", 1.0, above=0.0) if kind == "motor" else fields.number("gain", above=0.0)
    damping = fields.number("damping", 0.0, minimum=0.0) if kind == "position" else 0.0
    limits = None
    if fields.has("range"):
        value = fields.raw("range")
        if not isinstance(value, list) or len(value) != 2:
            raise fields.error("range", f"is {value!r}; it must be [least, most] of the control")
        low, high = (fields.angle_of("range", v) for v in value)
        if not low < high:
            raise fields.error("range", f"is [{low:g}, {high:g}]; the least comes first")
        limits = low, high
    elif kind == "position" and model.jnt_limited[joint]:
        limits = _pair(model.jnt_range[joint])
    elif kind == "motor" and model.jnt_actfrclimited[joint]:
        limits = _pair(model.jnt_actfrcrange[joint] / gain)
    return AddedActuator(name, kind, gain, damping, limits)


def _pair(values: np.ndarray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def add_actuators(spec: Any, actuators: list[AddedActuator]) -> None:
    """Adds actuators to an MjSpec, behind its own. A keyframe of it begins with control 0 for them, or their bound
    nearest to it."""
    taken = {actuator.name for actuator in spec.actuators}
    for one in actuators:
        made = spec.add_actuator(target=one.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        if one.joint not in taken:
            made.name = one.joint
        if one.kind == "position":
            made.set_to_position(kp=one.gain, kv=one.damping)
        elif one.kind == "velocity":
            made.set_to_velocity(kv=one.gain)
        else:
            made.set_to_motor()
            made.gainprm[0] = one.gain
        if one.range is not None:
            made.ctrllimited, made.ctrlrange = True, one.range
    start = [float(np.clip(0.0, *one.range)) if one.range else 0.0 for one in actuators]
    for key in spec.keys:
        if len(key.ctrl):
            key.ctrl = [*key.ctrl, *start]
