"""Small scenes put together by hand, and float64 ray casting to judge them by."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.geometry import se3
from evis.scene.model import Body, Camera, Instance, Light, Material, Mesh, Scene

ALL = ("radiance", "depth", "motion", "ids", "normal")
GEOMETRIC = ("depth", "motion", "ids", "normal")


class Still:
    """A body that never moves."""

    def pose(self, t_ns: np.ndarray) -> np.ndarray:
        return np.tile(se3.IDENTITY, (len(t_ns), 1))

    def twist(self, t_ns: np.ndarray) -> np.ndarray:
        return np.zeros((len(t_ns), 6))

    def is_static(self) -> bool:
        return True


def camera(width: int = 64, height: int = 48, focal: float = 60.0, near: float = 1e-3) -> Camera:
    k = np.array([[focal, 0, (width - 1) / 2 + 0.3], [0, focal * 1.1, (height - 1) / 2 - 0.2], [0, 0, 1]])
    return Camera("cam0", width, height, k, near)


def quad(half_width: float, half_height: float) -> Mesh:
    """Rectangle in z = 0 seen from +z, uv 0..1."""
    w, h = half_width, half_height
    vertices = np.array([(-w, -h, 0), (w, -h, 0), (w, h, 0), (-w, h, 0)], np.float32)
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)[faces]
    return Mesh(vertices, faces, uv)


def sphere(radius: float, rings: int) -> Mesh:
    """Latitude and longitude sphere with exact vertex normals."""
    around = 2 * rings
    theta = np.linspace(0, np.pi, rings + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, around, endpoint=False)[None]
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1)
    unit = unit.reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    faces = np.concatenate([np.stack([a, a + around, b], -1)[1:], np.stack([b, a + around, b + around], -1)[:-1]])
    faces = faces.reshape(-1, 3).astype(np.int32)
    return Mesh((radius * unit).astype(np.float32), faces, None, unit[faces].astype(np.float32))


def scene(
    meshes: list[tuple[Mesh, int, int]],
    bodies: int = 0,
    materials: list[Material] | None = None,
    lights: list[Light] | None = None,
    view: Camera | None = None,
    environment: Any = (0.0, 0.0, 0.0),
    still_camera: bool = True,
) -> Scene:
    """meshes: (mesh, body, material). Bodies `body0`... move; the camera is the last body."""
    view = view or camera()
    names = [Body(f"body{i}", None) for i in range(bodies)]
    instances = [Instance(f"thing{i}", body, mesh, material) for i, (mesh, body, material) in enumerate(meshes)]
    return Scene(
        "test",
        [*names, Body("cam0", Still() if still_camera else None)],
        instances,
        materials or [Material("grey", np.full(3, 0.5), two_sided=True)],
        lights or [],
        [view],
        np.array(environment, np.float32),
    )


def poses(*each: Any) -> np.ndarray:
    """float64 [1, N, 7] of single poses."""
    return np.array([np.asarray(p, np.float64) for p in each])[None]


def at(x: float, y: float, z: float, turn: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Pose at a position, turned by a rotation vector."""
    return se3.make_pose(np.array([x, y, z], np.float64), se3.exp(np.array(turn, np.float64)))


def rays(view: Camera) -> np.ndarray:
    """float64 [H, W, 3] directions with z = 1."""
    y, x = np.mgrid[: view.height, : view.width]
    return np.stack([(x - view.k[0, 2]) / view.k[0, 0], (y - view.k[1, 2]) / view.k[1, 1], np.ones(x.shape)], -1)


def cast(view: Camera, triangles: np.ndarray, two_sided: bool) -> tuple[np.ndarray, np.ndarray]:
    """Every ray against every triangle float64 [T, 3, 3] of the camera frame (Moeller and Trumbore).

    depth [T, H, W] (inf = behind the near plane, parallel, or facing away) and the least barycentric coordinate.
    """
    d = rays(view)
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(d[None], v[:, None, None])
    det = (u[:, None, None] * p).sum(-1)
    good = np.abs(det) > 0 if two_sided else det > 0
    with np.errstate(all="ignore"):
        s = (-a[:, None, None] * p).sum(-1) / det
        q = np.cross(-a, u)[:, None, None]
        t = (d[None] * q).sum(-1) / det
        z = (v[:, None, None] * q).sum(-1) / det
    least = np.minimum(np.minimum(s, t), 1 - s - t)
    return np.where(good & (z >= view.near), z, np.inf), np.where(good, least, -np.inf)
