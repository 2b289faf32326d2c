"""Applies `model:` of a scene file: what of an MJCF or URDF model is other than its file says, all of which may be
drawn.

    model:
      gravity:   [x, y, z]
      bodies:    {NAME: {mass | mass_scale, friction | friction_scale, shift, turn: {axis, angle}}}
      geoms:     {NAME: {friction | friction_scale}}
      joints:    {NAME: {position | shift, velocity, damping, stiffness, friction, armature; the last four also as
                 X_scale}}
      actuators: {NAME: {gain | gain_scale}}
      materials: {NAME: {albedo | albedo_scale, emission, roughness, metallic}}
      lights:    {NAME: {strength}}

NAME may hold `*` and `?`, and then stands for all that match; each of them draws for itself. mass [kg] scales the
inertia too; friction of a body is that of all its geoms (the sliding one, or three numbers), friction of a joint its
dry friction. position and velocity of a hinge or slide joint are those of the start; shift, there and of a body with
a free joint [m], and the turn of such a body (in the world), are added to the model's start. gain is that of an
actuator, and of a position or velocity servo its feedback too; of a damper its kv, of a muscle its force. strength is
a factor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from typing import Any

import mujoco
import numpy as np

from evis.config.suggestions import nearest
from evis.geometry import se3
from evis.scene.mjcf.frames import name_of
from evis.scene.model import ModelChange, Scene
from evis.scene.yaml.reader import Fields

_OBJ, _JOINT, _GAIN = mujoco.mjtObj, mujoco.mjtJoint, mujoco.mjtGain
PHYSICS = {
    "bodies": (_OBJ.mjOBJ_BODY, "body"),
    "geoms": (_OBJ.mjOBJ_GEOM, "geom"),
    "joints": (_OBJ.mjOBJ_JOINT, "joint"),
    "actuators": (_OBJ.mjOBJ_ACTUATOR, "actuator"),
}
"""Sections -> what MuJoCo calls their elements, and what one without a name is called here."""
_DOFS = {"damping": "dof_damping", "friction": "dof_frictionloss", "armature": "dof_armature"}
_PLAIN = ("damping", "stiffness", "friction", "armature")


def read_changes(fields: Fields, model: Any) -> list[ModelChange]:
    """Reads the sections about dynamics. Raises SceneError."""
    found: list[ModelChange] = []
    if fields.has("gravity"):
        found.append(ModelChange("option", 0, "gravity", tuple(fields.vector("gravity"))))
    counts = {"bodies": model.nbody, "geoms": model.ngeom, "joints": model.njnt, "actuators": model.nactuator}
    for section, (kind, default) in PHYSICS.items():
        names = [name_of(model, kind, i, default) for i in range(counts[section])]
        for number, entry in matched(fields, section, names):
            found += [ModelChange(section, number, *change) for change in _READERS[section](entry, model, number)]
            entry.done()
    return found


def matched(fields: Fields, section: str, names: Sequence[str], what: str = "") -> list[tuple[int, Fields]]:
    """Finds the elements that the entries of a section stand for, with the values of each. what: they are, where the
    section is not called so. Raises SceneError.
    """
    found = []
    for pattern, entry in fields.sections(section, section).items():
        fits = [i for i, name in enumerate(names) if fnmatchcase(name, pattern)]
        numbers = [names.index(pattern)] if pattern in names else [i for i in fits if names[i] != "world"]
        if not numbers:
            raise entry.error(None, f"fits none of the model's {what or section}; {nearest(pattern, names)}")
        within = f"{fields.within(section)}."
        found += [(i, entry.with_arguments(entry.arguments, within + names[i])) for i in numbers]
    return found


def change_looks(fields: Fields, scene: Scene) -> None:
    """Changes materials and lights of a scene that the model has given it. Raises SceneError."""
    for i, entry in matched(fields, "materials", [material.name for material in scene.materials]):
        material = scene.materials[i]
        if entry.has("albedo"):
            material.albedo = entry.colour("albedo", maximum=1.0)
        if entry.has("albedo_scale"):
            material.albedo = np.minimum(material.albedo * entry.colour("albedo_scale"), np.float32(1.0))
        if entry.has("emission"):
            material.emission = entry.colour("emission")
        material.roughness = entry.fraction("roughness", material.roughness)
        material.metallic = entry.fraction("metallic", material.metallic)
        entry.done()
    for i, entry in matched(fields, "lights", [light.name for light in scene.lights]):
        scene.lights[i].colour = scene.lights[i].colour * np.float32(entry.number("strength", minimum=0.0))
        entry.done()


Change = tuple[str, tuple[float, ...]]


def _number(fields: Fields, key: str, present: float, above: float | None = None) -> list[Change]:
    """A number that is given itself or as a factor of the present one."""
    if fields.has(key) and fields.has(f"{key}_scale"):
        raise fields.error(f"{key}_scale", f"and {key} are given; leave one out")
    limits: dict[str, Any] = {"minimum": 0.0} if above is None else {"above": above}
    number = present
    if fields.has(key):
        number = fields.number(key, **limits)
    if fields.has(f"{key}_scale"):
        number = present * fields.number(f"{key}_scale", **limits)
    return [] if number == present else [(key, (number,))]


def _friction(fields: Fields, present: np.ndarray) -> list[Change]:
    """Sliding, torsional and rolling friction of a geom."""
    if fields.has("friction") and isinstance(fields.raw("friction"), list):
        return [("friction", tuple(fields.vector("friction", 3)))]
    changes = _number(fields, "friction", float(present[0]))
    scaled = fields.has("friction_scale")
    return [
        (k, tuple(present * (v[0] / present[0])) if scaled and present[0] else (*v, *present[1:])) for k, v in changes
    ]


def _body(fields: Fields, model: Any, number: int) -> list[Change]:
    changes = _number(fields, "mass", float(model.body_mass[number]), above=0.0)
    if changes and not model.body_mass[number]:
        raise fields.error(None, "has a mass, but the model gives its body none, and no inertia")
    first = int(model.body_geomadr[number])
    if fields.has("friction") or fields.has("friction_scale"):
        for geom in range(first, first + int(model.body_geomnum[number])):
            changes += [(f"friction {geom}", v) for _, v in _friction(fields, model.geom_friction[geom])]
    if fields.has("shift") or fields.has("turn"):
        joint = int(model.body_jntadr[number])
        if joint < 0 or _JOINT(int(model.jnt_type[joint])) != _JOINT.mjJNT_FREE:
            raise fields.error("shift" if fields.has("shift") else "turn", "is for bodies with a free joint")
        turn = fields.section("turn", "turn")
        q = se3.exp(turn.direction("axis") * turn.angle("angle")) if turn else se3.IDENTITY[3:]
        if turn:
            turn.done()
        pose = *fields.place("shift"), *q
        if pose != tuple(se3.IDENTITY):
            changes.append(("start", (float(joint), *pose)))
    return changes


def _geom(fields: Fields, model: Any, number: int) -> list[Change]:
    return _friction(fields, model.geom_friction[number])


def _joint(fields: Fields, model: Any, number: int) -> list[Change]:
    dof = int(model.jnt_dofadr[number])
    present = {key: float(getattr(model, name)[dof]) for key, name in _DOFS.items()}
    present["stiffness"] = float(model.jnt_stiffness[number])
    changes = [change for key in _PLAIN for change in _number(fields, key, present[key])]
    simple = _JOINT(int(model.jnt_type[number])) in (_JOINT.mjJNT_HINGE, _JOINT.mjJNT_SLIDE)
    if fields.has("position") and fields.has("shift"):
        raise fields.error("shift", "and position are given; leave one out")
    for key in ("position", "shift", "velocity"):
        if fields.has(key):
            if not simple:
                raise fields.error(key, "is for hinge and slide joints; of a free body take shift and turn")
            changes.append((key, (fields.angle(key),)))
    return [change for change in changes if change != ("shift", (0.0,))]


def _actuator(fields: Fields, model: Any, number: int) -> list[Change]:
    if not (fields.has("gain") or fields.has("gain_scale")):
        return []
    place = _gain_place(model, number)
    if place is None:
        kind = _GAIN(int(model.actuator_gaintype[number])).name.removeprefix("mjGAIN_").lower()
        key = "gain" if fields.has("gain") else "gain_scale"
        raise fields.error(
            key, f"is for actuators whose force is a gain times their control; that of this is of {kind}"
        )
    return _number(fields, "gain", _gain_sign(model, number) * float(model.actuator_gainprm[number, place]))


def _gain_place(model: Any, number: int) -> int | None:
    """Which of an actuator's parameters is its gain: of a damper its `kv`, of a muscle its `force`, or its `scale`
    where it has no force. None for one that has several, or none.
    """
    kind, values = _GAIN(int(model.actuator_gaintype[number])), model.actuator_gainprm[number]
    if kind == _GAIN.mjGAIN_FIXED:
        return 0
    if kind == _GAIN.mjGAIN_MUSCLE:
        return 2 if values[2] >= 0 else 3
    return 2 if kind == _GAIN.mjGAIN_AFFINE and not values[:2].any() else None


def _gain_sign(model: Any, number: int) -> float:
    """-1 for a damper, whose `kv` stands in the model with the other sign."""
    return -1.0 if _GAIN(int(model.actuator_gaintype[number])) == _GAIN.mjGAIN_AFFINE else 1.0


_READERS: dict[str, Callable[[Fields, Any, int], list[Change]]] = {
    "bodies": _body,
    "geoms": _geom,
    "joints": _joint,
    "actuators": _actuator,
}


def apply_changes(model: Any, changes: Sequence[ModelChange]) -> None:
    """Changes a compiled model as a scene says; what of it is about the start is left to `apply_start`."""
    for change in changes:
        _apply(model, change)
    if any(change.key not in ("position", "shift", "velocity", "start") for change in changes):
        # Masses and armature decide other constants of the model.
        mujoco.mj_setConst(model, mujoco.MjData(model))


def _apply(model: Any, change: ModelChange) -> None:
    key, n, values = change.key, change.number, np.array(change.values)
    if change.kind == "option":
        model.opt.gravity[:] = values
    elif key == "mass":
        model.body_inertia[n] *= values[0] / model.body_mass[n]
        model.body_mass[n] = values[0]
    elif key.startswith("friction") and change.kind in ("bodies", "geoms"):
        model.geom_friction[int(key.split()[1]) if change.kind == "bodies" else n] = values
    elif key == "stiffness":
        model.jnt_stiffness[n] = values[0]
    elif key in _DOFS and change.kind == "joints":
        first = int(model.jnt_dofadr[n])
        count = {_JOINT.mjJNT_FREE: 6, _JOINT.mjJNT_BALL: 3}.get(_JOINT(int(model.jnt_type[n])), 1)
        getattr(model, _DOFS[key])[first : first + count] = values[0]
    elif key == "gain":
        place = _gain_place(model, n)
        assert place is not None  # `_actuator` refuses the others
        old, feedback = model.actuator_gainprm[n, place], model.actuator_biasprm[n, 1:3]
        if _GAIN(int(model.actuator_gaintype[n])) == _GAIN.mjGAIN_MUSCLE:
            model.actuator_biasprm[n, place] = values[0]  # its passive force has the same peak
        elif place == 0:
            # That of position where there is any: what is of velocity then is damping, whose number is its own.
            which = 0 if feedback[0] else 1
            if old and feedback[which] == -old:
                feedback[which] = -values[0]
        model.actuator_gainprm[n, place] = _gain_sign(model, n) * values[0]


def apply_start(model: Any, data: Any, changes: Sequence[ModelChange]) -> None:
    """Brings the state of `data` from the model's start to that of the scene."""
    for change in changes:
        if change.kind == "joints" and change.key == "position":
            data.qpos[model.jnt_qposadr[change.number]] = change.values[0]
        elif change.kind == "joints" and change.key == "shift":
            data.qpos[model.jnt_qposadr[change.number]] += change.values[0]
        elif change.kind == "joints" and change.key == "velocity":
            data.qvel[model.jnt_dofadr[change.number]] = change.values[0]
        elif change.key == "start":
            at, pose = int(model.jnt_qposadr[int(change.values[0])]), np.array(change.values[1:])
            data.qpos[at : at + 3] += pose[:3]
            q = se3.from_mujoco(data.qpos[at + 3 : at + 7])
            data.qpos[at + 3 : at + 7] = se3.to_mujoco(se3.multiply(pose[3:], q))
