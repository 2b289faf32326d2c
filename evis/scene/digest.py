"""Computes the keys by which worlds are shared: what of a scene decides what is seen, and what decides how bodies
move."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.scene.model import Mesh, Scene


def appearance(scene: Scene) -> bytes:
    """Computes the key of what a renderer makes of a scene beside the poses that it is given.

    Of bodies that move it does not depend on how, unless they carry a light; of those that do not, on where they are.
    """
    lit = {light.body for light in scene.lights}
    bodies = [
        (b.name, b.mount, b.follows, b.trajectory if n in lit or b.trajectory is None or _still(b) else "moves")
        for n, b in enumerate(scene.bodies)
    ]
    return _digest([*bodies, scene.instances, scene.materials, scene.lights, *_camera_and_sky(scene)])


def motion(scene: Scene) -> bytes:
    """Computes the key of how the bodies of a scene move."""
    bodies = [(b.name, b.trajectory, b.mount, b.follows) for b in scene.bodies]
    start = [scene.keyframe, scene.initial_spread, scene.initial_joints]
    return _digest([bodies, scene.mjcf, scene.changes, scene.actuators, scene.timestep_ns, *start])


def shown(scene: Scene) -> bytes:
    """Computes the key of what is made between keyframes: of the looks, and of the motion in closed form."""
    return appearance(scene) + _digest([body.trajectory for body in scene.bodies])


def whole(scene: Scene) -> bytes:
    """Computes the key of both, and of the sensor."""
    return appearance(scene) + motion(scene) + _digest(scene.sensor)


def _still(body: Any) -> bool:
    return body.trajectory is not None and body.trajectory.is_static()


def _camera_and_sky(scene: Scene) -> list[Any]:
    return [scene.cameras, scene.environment, scene.environment_map, scene.sky_lights]


def _digest(value: Any) -> bytes:
    made = hashlib.blake2b(digest_size=16)
    _feed(made, value, {})
    return made.digest()


def _feed(made: Any, value: Any, meshes: dict[int, bytes]) -> None:
    """Adds a value to a hash, with its type and, of what has a length, that."""
    made.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        made.update(f"{value.dtype}{value.shape}".encode())
        made.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mesh):  # many instances share one
        if id(value) not in meshes:
            meshes[id(value)] = _digest([value.vertices, value.faces, value.uv, value.normals, value.colours])
        made.update(meshes[id(value)])
    elif dataclasses.is_dataclass(value):
        for item in dataclasses.fields(value):
            _feed(made, getattr(value, item.name), meshes)
    elif isinstance(value, Mapping):
        _feed(made, sorted(value.items()), meshes)
    elif isinstance(value, (list, tuple)):
        made.update(str(len(value)).encode())
        for item in value:
            _feed(made, item, meshes)
    elif isinstance(value, (str, bytes, int, float, bool, np.generic, Path, type(None))):
        made.update(f"{value!r};".encode())
    else:  # a trajectory, or a spline of one, by what it was made of and not by what it has worked out since
        _feed(made, {name: item for name, item in vars(value).items() if not name.startswith("_")}, meshes)
