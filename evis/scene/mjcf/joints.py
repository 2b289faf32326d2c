"""Sets where joints of a MuJoCo model start, as a scene file says it. Imported only for scenes with dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco

from evis.config.suggestions import nearest
from evis.scene.mjcf.frames import name_of
from evis.scene.model import JointStart
from evis.scene.yaml.reader import Fields


def read_starts(model: Any, joints: Mapping[str, Fields]) -> dict[str, JointStart]:
    """Reads the bounds between which joints start, by name.

    Raises SceneError for a joint that the model lacks or that has not one degree of freedom, and for bounds that are
    none.
    """
    kinds = {name_of(model, mujoco.mjtObj.mjOBJ_JOINT, i, ""): int(model.jnt_type[i]) for i in range(model.njnt)}
    movable = [n for n, kind in kinds.items() if kind in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    result = {}
    for name, fields in joints.items():
        if name not in movable:
            known = nearest(name, movable) if movable else "the model has none"
            raise fields.error(None, f"'{name}' is no hinge or slide of the model; {known}")
        result[name] = JointStart(_bounds(fields, "position"), _bounds(fields, "velocity"))
        fields.done()
    return result


def _bounds(fields: Fields, key: str) -> tuple[float, float] | None:
    """A number stands for itself alone."""
    if not fields.has(key):
        return None
    value = fields.plain(key)
    pair = value if isinstance(value, list) else [value, value]
    if len(pair) != 2:
        raise fields.error(key, f"is {value!r}; it must be a number or [least, most]")
    least, most = (fields.angle_of(key, v) for v in pair)
    if least > most:
        raise fields.error(key, f"is [{least:g}, {most:g}]; the least comes first")
    return least, most
