"""Makes round shapes as fine as they are seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from evis.geometry import se3
from evis.scene.model import WORLD, Camera, Mesh, Scene
from evis.scene.motion import Prescribed, may_turn
from evis.scene.view.field_of_view import least_angle, widest_angle

TURNING, STEADY = 0.1, 0.5
"""How far within its true place a side of an outline may be [px], of what turns and of what does not. A ball that spins
makes events by the corners of an outline that is off by more; what stands or shifts is only seen so much too small,
and with 0.1 tunnel_exit at 640x480 has four times as many triangles, and half the real-time factor on a GPU."""
FINER = (1, 2, 4, 8)
"""By how much the sides of a shape are multiplied; a mesh of 8 has 64 times as many triangles."""
LOOKED_AT_NS = np.arange(0, 2_000_000_001, 250_000_000)
"""Times at which prescribed motion is looked at [ns]."""


def make_finer(
    scene: Scene, rest: np.ndarray | None, take: Callable[[int], None], made: dict[tuple[int, int], tuple[Mesh, Mesh]]
) -> None:
    """Replaces round meshes of a scene by finer ones where a camera sees their outlines off by more than they may be.

    rest: poses float64 [M, 7] of the first M bodies, those of a model, in its reference pose. What moves in closed form
    is looked at LOOKED_AT_NS. take: is told the bytes of each new mesh. made: by the mesh and how much finer, with the
    mesh itself, shared with other worlds.
    """
    shapes = [instance.mesh.round for instance in scene.instances]
    carried: dict[int, list[int]] = {}
    for number, shape in enumerate(shapes):
        if shape is not None:
            carried.setdefault(scene.instances[number].body, []).append(number)
    if not carried:
        return
    poses = _poses(scene, rest)
    eyes = [
        (camera, eye, widest_angle(camera))
        for camera in scene.cameras
        if (eye := poses[scene.body_index(camera.name)]) is not None
    ]
    for body, numbers in carried.items():
        at = np.broadcast_to(se3.IDENTITY, (len(LOOKED_AT_NS), 7)) if body == WORLD else poses[body]
        if at is None:
            continue
        middle = se3.transform(at[:, None], np.stack([scene.instances[k].pose[:3] for k in numbers]))
        radius, error = (np.array([getattr(shapes[k], name) for k in numbers]) for name in ("radius", "error"))
        worst = np.zeros(len(numbers))
        for camera, eye, widest in eyes:
            point = se3.transform(se3.inverse(eye)[:, None], middle)
            worst = np.maximum(worst, _seen(camera, widest, point, radius) * error)
        turning = body != WORLD and may_turn(scene.bodies[body].trajectory)
        tolerance = TURNING if turning else STEADY
        for k, pixels in zip(numbers, worst.tolist()):
            finer = next((n for n in FINER if pixels <= tolerance * n * n), FINER[-1])
            shape, mesh = shapes[k], scene.instances[k].mesh
            if finer > 1 and shape is not None:
                key = id(mesh), finer
                if key not in made:
                    made[key] = mesh, shape.finer(finer)
                    take(made[key][1].nbytes)
                scene.instances[k] = replace(scene.instances[k], mesh=made[key][1])


def _seen(camera: Camera, widest: float, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Pixels per metre [I] at the outlines of balls, the most of all times; 0 where they are never in the picture.

    middle: float64 [T, I, 3] in the camera's frame. radius: [I] m. A camera within a ball sees no outline.
    """
    distance = np.linalg.norm(middle, axis=-1)
    off = least_angle(middle.reshape(-1, 3), np.broadcast_to(radius, distance.shape).reshape(-1))
    seen = (distance > radius) & (off.reshape(distance.shape) <= widest)
    # Along the ray that touches the ball.
    squared = np.where(seen, distance**2 - radius**2, np.inf).min(axis=0)
    return np.asarray(camera.k[1, 1] / np.maximum(np.sqrt(squared), camera.near))


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
