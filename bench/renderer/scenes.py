"""Makes the scenes that the renderer is measured on."""

from __future__ import annotations

import numpy as np

from evis.geometry import pinhole, se3
from evis.scene.model import Body, Camera, Instance, Light, Material, Mesh, Scene


class Still:
    """Keeps a body at one pose: a trajectory without motion."""

    def __init__(self, pose: np.ndarray) -> None:
        self._pose = pose

    def pose(self, t_ns: np.ndarray) -> np.ndarray:
        return np.tile(self._pose, (len(t_ns), 1))

    def twist(self, t_ns: np.ndarray) -> np.ndarray:
        return np.zeros((len(t_ns), 6))

    def is_static(self) -> bool:
        return True


def prescribed_poses(scene: Scene, t_ns: np.ndarray) -> np.ndarray:
    """Computes poses float64 [T, 1, N, 7] at stamps [T] of a scene whose bodies all have a trajectory."""
    return np.stack([b.trajectory.pose(t_ns) for b in scene.bodies if b.trajectory is not None], axis=1)[:, None]


def ball(radius: float, rings: int) -> Mesh:
    """Makes a sphere of 4 rings (rings - 1) triangles."""
    theta = np.linspace(0, np.pi, rings + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)[None]
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1)
    i, j = np.meshgrid(np.arange(rings), np.arange(2 * rings), indexing="ij")
    a, b = i * 2 * rings + j, i * 2 * rings + (j + 1) % (2 * rings)
    c, d = a + 2 * rings, b + 2 * rings
    faces = np.concatenate([np.stack([a, c, b], -1)[1:], np.stack([b, c, d], -1)[:-1]])
    return Mesh((radius * unit).reshape(-1, 3).astype(np.float32), faces.reshape(-1, 3).astype(np.int32))


def balls(count: int, rings: int, size: tuple[int, int]) -> tuple[Scene, np.ndarray]:
    """Makes `count` spheres before a wall of two triangles; returns the scene and its poses float64 [1, N, 7]."""
    # The diagonal must not run through pixel centres, where both of its triangles are right.
    corners = np.array([(-9, -8, 4), (9, -9, 4), (8, 9.1, 4), (-9, 9, 4)], np.float32)
    wall = Mesh(corners, np.array([(0, 2, 1), (0, 3, 2)], np.int32))
    mesh = ball(0.3, rings)
    bodies = [Body(f"ball{k}", None) for k in range(count)] + [Body("cam0", None)]
    instances = [Instance("wall", -1, wall, 0)] + [Instance(f"ball{k}", k, mesh, 0) for k in range(count)]
    camera = Camera("cam0", *size, pinhole.intrinsics(*size, 0.9 * size[0]))
    scene = Scene("balls", bodies, instances, [Material("grey", np.ones(3))], [], [camera], np.zeros(3))
    rng = np.random.default_rng(0)
    place = np.stack([*rng.uniform(-0.9, 0.9, (2, count)), rng.uniform(2, 3, count)], -1)
    poses = se3.make_pose(np.concatenate([place, np.zeros((1, 3))]), np.array([0, 0, 0, 1.0]))
    return scene, poses[None]


def hall(size: tuple[int, int], movers: int = 20, still_camera: bool = True) -> tuple[Scene, np.ndarray]:
    """Makes a hall with 520 things of 220,000 triangles in rows, `movers` of which move, and one shadowed light.

    Poses of two instants, float64 [2, 1, N, 7]; the camera of the second is turned by 1 degree unless still.
    """
    rng = np.random.default_rng(1)
    count = 520
    things = [ball(0.35, rings) for rings in (6, 8, 12, 16)]
    column, row = np.arange(count) % 26, np.arange(count) // 26
    place = np.stack([0.9 * (column - 12.5), 0.9 * row + 3.0, 0.35 + 0.1 * rng.random(count)], -1)
    moving = rng.choice(count, movers, replace=False)
    floor = Mesh(
        np.array([(-15, -5, 0), (15, -5, 0), (15, 25, 0), (-15, 25, 0)], np.float32),
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
    )
    turn = se3.exp(np.array([-1.9, 0.0, 0.0]))
    eye = se3.make_pose(np.array([0.0, -1.0, 2.5]), turn)
    bodies = [Body(f"mover{k}", None) for k in range(movers)]
    bodies.append(Body("cam0", Still(eye) if still_camera else None))
    still_things = np.setdiff1d(np.arange(count), moving)
    upright = np.array([0, 0, 0, 1.0])
    instances = [Instance("floor", -1, floor, 0)]
    instances += [Instance(f"mover{k}", k, things[n % 4], 0) for k, n in enumerate(moving)]
    instances += [Instance(f"thing{n}", -1, things[n % 4], 0, se3.make_pose(place[n], upright)) for n in still_things]
    lamp = Light("lamp", "point", np.full(3, 200.0), np.array([2.0, 5.0, 8.0]))
    camera = Camera("cam0", *size, pinhole.intrinsics(*size, 0.8 * size[0]))
    scene = Scene("hall", bodies, instances, [Material("grey", np.full(3, 0.5))], [lamp], [camera], np.full(3, 0.1))
    first = np.concatenate([se3.make_pose(place[moving], upright), eye[None]])
    second = first.copy()
    second[:-1, 2] += 0.05
    if not still_camera:
        second[-1] = se3.compose(eye, se3.make_pose(np.zeros(3), se3.exp(np.array([0, np.pi / 180, 0]))))
    return scene, np.stack([first, second])[:, None]
