"""Flattens a scene's triangles: one vertex and one triangle list for all instances."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

import numpy as np

from evis.geometry import se3
from evis.scene.model import WORLD, Instance, Mesh, Scene
from evis.scene.worlds import lock

Made = TypeVar("Made")

SHELL_OPEN, SHELL_CONVEX, SHELL_PLANAR = 0, 1, 2
"""Whether an instance can shade itself: it can; not on its outside; not at all."""

MAX_CONVEXITY_TESTS = 20_000_000
"""Vertex-face pairs up to which a mesh is tested for convexity; a larger one counts as open, which costs rays only."""


@dataclass
class Geometry:
    """Holds every instance's mesh, recentred on the middle of its bounding box so that float32 resolves it best.

    vertices float32 [V, 3] in the recentred instance frame; vertex_instance int32 [V]; triangles int32 [T, 3] into
    vertices; triangle_instance int32 [T]; first int64 [I + 1]: triangles of instance i are [first[i], first[i + 1]);
    normals float32 [T, 3] geometric unit normals (0 for a degenerate triangle, which is never seen);
    uv float32 [3 T, 2] or None; smooth float32 [3 T, 3] shading normals (0 = use the geometric one) or None;
    tint float32 [3 T, 3] colours of the corners (1 where an instance has none) or None;
    body int64 [I]; rotation float64 [I, 3, 3] and translation float64 [I, 3] take the recentred frame to the body's;
    radius float32 [I] of the bounding sphere; shell int32 [I]; meshes: what each instance's ray tests go to.
    """

    vertices: np.ndarray
    vertex_instance: np.ndarray
    triangles: np.ndarray
    triangle_instance: np.ndarray
    first: np.ndarray
    normals: np.ndarray
    uv: np.ndarray | None
    smooth: np.ndarray | None
    tint: np.ndarray | None
    body: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    radius: np.ndarray
    shell: np.ndarray
    meshes: list[Mesh]
    static: np.ndarray
    """bool [I]: fixed to the world, or to a body whose prescribed motion is none."""
    made: dict[Hashable, object] = field(default_factory=dict)
    """What `once` has made."""

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Returns what `make` gives, made at the first call with this key; nobody may write to it."""
        if key not in self.made:
            self.made[key] = make()
            lock(self.made[key])
        return self.made[key]  # type: ignore[return-value]


class _Shape(NamedTuple):
    """Holds what all instances of a mesh have in common, about the middle of its box; see Geometry."""

    centre: np.ndarray
    points: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    radius: float
    shell: int


_shared: dict[int, tuple[weakref.ref[Scene], Geometry]] = {}
"""Of scenes that nodes share, by their id."""


def geometry_of(scene: Scene) -> Geometry:
    """Gives the arrays of a scene: of one that nodes share, those that the first of them has made, read-only. Raises
    as `flatten`.
    """
    if not scene.shared:
        return flatten(scene)
    number = id(scene)
    if number not in _shared:
        geometry = flatten(scene)
        lock(geometry)
        _shared[number] = weakref.ref(scene, lambda _: _shared.pop(number)), geometry
    return _shared[number][1]


def flatten(scene: Scene) -> Geometry:
    """Makes the arrays of a scene. Raises ValueError naming the instance whose mesh, material or body is not usable."""
    vertices, triangles, owners, normals, uv, smooth, tint = [], [], [], [], [], [], []
    count = len(scene.instances)
    first = np.zeros(count + 1, np.int64)
    body = np.full(count, WORLD, np.int64)
    translation = np.zeros((count, 3))
    radius, shell = np.zeros(count, np.float32), np.zeros(count, np.int32)
    turns = np.array([i.pose[3:] for i in scene.instances], np.float64).reshape(count, 4)
    rotation = se3.to_matrix(se3.normalize(turns))
    shapes: dict[int, _Shape] = {}
    for instance in scene.instances:
        _check(scene, instance)
        if id(instance.mesh) not in shapes:
            _check_mesh(scene, instance)
            shapes[id(instance.mesh)] = _shape_of(instance.mesh)
    has_uv = any(scene.materials[i.material].texture is not None for i in scene.instances)
    has_smooth = any(i.mesh.normals is not None for i in scene.instances)
    has_tint = any(i.mesh.colours is not None for i in scene.instances)
    base = 0
    for index, instance in enumerate(scene.instances):
        mesh = instance.mesh
        centre, points, faces, normal, radius[index], shell[index] = shapes[id(mesh)]
        body[index] = instance.body
        translation[index] = np.asarray(instance.pose[:3], np.float64) + rotation[index] @ centre
        vertices.append(points)
        triangles.append(faces + np.int32(base))
        owners.append(np.full(len(faces), index, np.int32))
        normals.append(normal)
        if has_uv:
            uv.append(np.zeros((len(faces), 3, 2), np.float32) if mesh.uv is None else mesh.uv)
        if has_smooth:
            smooth.append(np.zeros((len(faces), 3, 3), np.float32) if mesh.normals is None else mesh.normals)
        if has_tint:
            tint.append(np.ones((len(faces), 3, 3), np.float32) if mesh.colours is None else mesh.colours)
        base += len(points)
        first[index + 1] = first[index] + len(faces)
    return Geometry(
        vertices=_stack(vertices, np.float32, 3),
        vertex_instance=np.repeat(np.arange(count, dtype=np.int32), [len(v) for v in vertices]),
        triangles=_stack(triangles, np.int32, 3),
        triangle_instance=np.concatenate(owners) if owners else np.zeros(0, np.int32),
        first=first,
        normals=_stack(normals, np.float32, 3),
        uv=_stack(uv, np.float32, 2) if has_uv else None,
        smooth=_stack(smooth, np.float32, 3) if has_smooth else None,
        tint=_stack(tint, np.float32, 3) if has_tint else None,
        body=body,
        rotation=rotation,
        translation=translation,
        radius=radius,
        shell=shell,
        meshes=[i.mesh for i in scene.instances],
        static=np.array([is_static(scene, i.body) for i in scene.instances], bool),
    )


def is_static(scene: Scene, body: int) -> bool:
    """Tells whether a body never moves: the world, or one whose prescribed motion is none."""
    if body == WORLD:
        return True
    trajectory = scene.bodies[body].trajectory
    return trajectory is not None and trajectory.is_static()


def face_normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Gives unit normals float64 [F, 3] of counter-clockwise triangles; 0 where the area is 0."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)


def shell_of(points: np.ndarray, faces: np.ndarray, normals: np.ndarray) -> int:
    """Tells whether no vertex lies in front of any face: such a surface cannot shade its own outside.

    The tolerance is the float32 rounding of the vertices, 1e-6 of the size.
    """
    if not len(faces) or len(points) * len(faces) > MAX_CONVEXITY_TESTS:
        return SHELL_OPEN
    used = points[np.unique(faces)]
    tolerance = 1e-6 * np.abs(points).max()
    highest = lowest = 0.0
    for start in range(0, len(faces), 4096):
        normal = normals[start : start + 4096]
        height = normal @ used.T - (normal * points[faces[start : start + 4096, 0]]).sum(1)[:, None]
        highest, lowest = max(highest, height.max()), min(lowest, height.min())
        if highest > tolerance:
            return SHELL_OPEN
    return SHELL_PLANAR if lowest >= -tolerance else SHELL_CONVEX


def _shape_of(mesh: Mesh) -> _Shape:
    points = np.asarray(mesh.vertices, np.float64).reshape(-1, 3)
    faces = np.asarray(mesh.faces, np.int64).reshape(-1, 3)
    centre = (points.min(0) + points.max(0)) / 2 if len(points) else np.zeros(3)
    points = points - centre
    normals = face_normals(points, faces)
    radius = np.sqrt((points**2).sum(1).max(initial=0.0)) * (1 + 1e-6)
    shell = shell_of(points, faces, normals)
    return _Shape(centre, points.astype(np.float32), faces.astype(np.int32), normals.astype(np.float32), radius, shell)


def _check(scene: Scene, instance: Instance) -> None:
    """Raises ValueError where the instance's material, body or pose is not usable."""
    where = f"scene {scene.name}: instance '{instance.name}'"
    if not 0 <= instance.material < len(scene.materials):
        raise ValueError(f"{where} has material {instance.material}; the scene has {len(scene.materials)}")
    if not WORLD <= instance.body < len(scene.bodies):
        raise ValueError(f"{where} is on body {instance.body}; the scene has {len(scene.bodies)}")
    if not np.isfinite(instance.pose).all():
        raise ValueError(f"{where} has a vertex or pose that is not finite")


def _check_mesh(scene: Scene, instance: Instance) -> None:
    """Raises ValueError where the instance's mesh is not usable."""
    mesh, where = instance.mesh, f"scene {scene.name}: instance '{instance.name}'"
    faces, points = np.asarray(mesh.faces), np.asarray(mesh.vertices)
    if not np.isfinite(points).all():
        raise ValueError(f"{where} has a vertex or pose that is not finite")
    if faces.size and not 0 <= faces.min() <= faces.max() < len(points):
        raise ValueError(f"{where} has a face that names vertex {faces.max()} of {len(points)}")
    for name, array in (("uv", mesh.uv), ("normals", mesh.normals), ("colours", mesh.colours)):
        if array is not None and len(array) != len(faces):
            raise ValueError(f"{where} has {len(array)} {name} for {len(faces)} faces")
        if array is not None and not np.isfinite(array).all():
            raise ValueError(f"{where} has {name} that are not finite")
    if mesh.colours is not None and mesh.colours.size and not 0 <= mesh.colours.min() <= mesh.colours.max() <= 1:
        worst = mesh.colours.min() if mesh.colours.min() < 0 else mesh.colours.max()
        raise ValueError(f"{where} has a colour of {worst:g}; colours of vertices must be 0 ... 1")


def _stack(parts: list[np.ndarray], dtype: type, width: int) -> np.ndarray:
    joined = np.concatenate([np.asarray(p, dtype).reshape(-1, width) for p in parts]) if parts else np.zeros((0, width))
    return np.ascontiguousarray(joined, dtype)
