"""Makes round shapes as fine as they are seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from evis.geometry import se3
from evis.scene.field_of_view import outside, widest_angle
from evis.scene.model import Mesh, Scene
from evis.scene.motion import Prescribed

TOLERANCE = 0.1
"""How far within its true place an outline may be [px]. One that is off by more makes events where a ball spins."""
FINER = (1, 2, 4, 8)
"""By how much the sides of a shape are multiplied; a mesh of 8 has 64 times as many triangles."""
LOOKED_AT_NS = np.arange(0, 2_000_000_001, 250_000_000)
"""Times at which prescribed motion is looked at [ns]."""


def make_finer(
    scene: Scene, rest: np.ndarray | None, take: Callable[[int], None], made: dict[tuple[int, int], tuple[Mesh, Mesh]]
) -> None:
    """Replaces round meshes of a scene by finer ones, where a camera sees their outlines further off than TOLERANCE.

    rest: poses float64 [M, 7] of the first M bodies, those of a model, in its reference pose. What moves in closed form
    is looked at LOOKED_AT_NS. take: is told the bytes of each new mesh. made: by the mesh and how much finer, with the
    mesh itself, shared with other worlds.
    """
    if not any(instance.mesh.round for instance in scene.instances):
        return
    poses = _poses(scene, rest)
    eyes = [
        (camera, eye, widest_angle(camera))
        for camera in scene.cameras
        if (eye := poses[scene.body_index(camera.name)]) is not None
    ]
    for number, instance in enumerate(scene.instances):
        shape = instance.mesh.round
        if shape is None:
            continue
        body = np.broadcast_to(se3.IDENTITY, (len(LOOKED_AT_NS), 7)) if instance.body < 0 else poses[instance.body]
        if body is None:
            continue
        middle = se3.transform(body, instance.pose[:3])
        error = 0.0
        for camera, eye, widest in eyes:
            point = se3.transform(se3.inverse(eye), middle)
            distance = np.linalg.norm(point, axis=-1)
            seen = (distance > shape.radius) & ~outside(point, np.full(len(point), shape.radius), widest)
            if seen.any():
                # Along the ray that touches a ball.
                least = np.sqrt((distance[seen] ** 2 - shape.radius**2).min())
                error = max(error, float(camera.k[1, 1] * shape.error / max(least, camera.near)))
        finer = next((n for n in FINER if error <= TOLERANCE * n * n), FINER[-1])
        if finer > 1:
            key = id(instance.mesh), finer
            if key not in made:
                made[key] = instance.mesh, shape.finer(finer)
                take(made[key][1].nbytes)
            scene.instances[number] = replace(instance, mesh=made[key][1])


def _poses(scene: Scene, rest: np.ndarray | None) -> list[np.ndarray | None]:
    """Poses float64 [T, 7] of each body at LOOKED_AT_NS, None where they are not known."""
    found: list[np.ndarray | None] = []
    for number, body in enumerate(scene.bodies):
        if isinstance(body.trajectory, Prescribed):
            found.append(body.trajectory.pose(LOOKED_AT_NS))
        elif rest is not None and number < len(rest):
            found.append(np.broadcast_to(rest[number], (len(LOOKED_AT_NS), 7)))
        else:
            found.append(None)
    for number, body in enumerate(scene.bodies):
        if body.mount is not None and (root := found[body.mount[0]]) is not None:
            found[number] = se3.compose(root, body.mount[1])
    return found
