"""Finds what a camera does not see, or sees falsely, at the first look at a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.geometry import pinhole, se3
from evis.geometry.distortion import Lens, unproject
from evis.scene.mesh.inside_out import is_inside_out
from evis.scene.model import Camera, Mesh, Scene

NAMED = 3
"""Things that a line names, of those that it is about."""


def first_look(scene: Scene, camera: Camera, poses: np.ndarray) -> list[str]:
    """Returns a line for each thing that a camera is shown falsely or not at all, as a scene is at its first keyframe.

    poses: float64 [N, 7], of the scene's bodies. Told are closed meshes that are turned inside out, unless the camera
    is in them or their material has two sides, textures too fine for their coordinates, and pictures of nothing: all
    that is before the camera is nearer than its `near`, or nothing is there.
    """
    if not scene.instances:
        return []
    eye = poses[scene.body_index(camera.name)]
    meshes = {id(instance.mesh): instance.mesh for instance in scene.instances}
    box_of = {key: _box(mesh) for key, mesh in meshes.items()}
    boxes = np.stack([box_of[id(instance.mesh)] for instance in scene.instances])
    bodies = np.concatenate((poses, se3.IDENTITY[None]))[[instance.body for instance in scene.instances]]
    places = se3.compose(bodies, np.stack([instance.pose for instance in scene.instances]))
    lines = []
    if turned := _turned(scene, boxes, se3.transform(se3.inverse(places), eye[:3])):
        lines.append(
            f"the faces of {_named(turned)} are turned inwards, so that from outside its far inner side is seen; turn "
            "them round in the file (Blender: Recalculate Outside), or give it a material with two_sided: true"
        )
    lines += _too_fine(scene)
    if scene.environment_map is None:
        to_camera = se3.compose(se3.inverse(eye), places)
        lines += _nothing(scene, camera, se3.transform(to_camera[:, None], boxes))
    return lines


def _turned(scene: Scene, boxes: np.ndarray, eyes: np.ndarray) -> list[str]:
    """Names the meshes that are inside out. A room of which only the inner side is there has the camera within.

    boxes: about the instances, in their frames, where the camera is at `eyes` float64 [I, 3].
    """
    known: dict[int, bool] = {}
    found = []
    for instance, box, eye in zip(scene.instances, boxes, eyes):
        key = id(instance.mesh)
        if key not in known:
            known[key] = is_inside_out(instance.mesh)
        within = ((eye >= box[0]) & (eye <= box[-1])).all()
        if known[key] and not within and not scene.materials[instance.material].two_sided:
            found.append(instance.name)
    return found


def _too_fine(scene: Scene) -> list[str]:
    """A line for textures that are repeated so often that their coordinates, of single precision, miss texels."""
    most: dict[int, float] = {}
    lines = {}
    for instance in scene.instances:
        texture, uv = scene.materials[instance.material].texture, instance.mesh.uv
        if texture is None or uv is None:
            continue
        key = id(instance.mesh)
        if key not in most:
            most[key] = float(np.abs(uv).max())
        texels = max(texture.shape[:2])
        if np.spacing(np.float32(most[key])) * texels > 1.0:
            lines[key] = (
                f"the texture of '{instance.name}' is repeated up to {most[key]:.3g} times, where single precision "
                f"does not tell its {texels} texels apart, so that it looks grey; {2**24 // texels} times are the most"
            )
    return list(lines.values())


def _nothing(scene: Scene, camera: Camera, boxes: np.ndarray) -> list[str]:
    """A line where the picture is empty. boxes: corners about the things in the camera's frame, float64 [I, 8, 3]."""
    off = _off(boxes)
    ahead = np.flatnonzero(off <= _widest(camera))
    if not len(ahead):
        k = int(off.argmin())
        right, down, forward = boxes[k].mean(axis=0)
        return [
            f"camera '{camera.name}' sees nothing at the start: '{scene.instances[k].name}', the nearest to its "
            f"picture, is {_side(right, 'right', 'left')}, {_side(down, 'below', 'above')} and "
            f"{_side(forward, 'ahead', 'behind')}; look_at turns a camera to a point"
        ]
    # As the raster has it: along the optical axis, and through a lens along the ray.
    reach = boxes[ahead][..., 2] if camera.distortion_model == "none" else np.linalg.norm(boxes[ahead], axis=-1)
    if reach.max() >= camera.near:
        return []
    names = _named([scene.instances[k].name for k in ahead])
    return [
        f"camera '{camera.name}' sees nothing at the start: {names} is within {reach.max():.3g} m of it, and near is "
        f"{camera.near:g} m; a smaller near shows it"
    ]


def _box(mesh: Mesh) -> np.ndarray:
    """Corners of the box about a mesh in its frame, float64 [8, 3], from the least to the greatest."""
    sides = np.stack((mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)), axis=-1).astype(np.float64)
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)


def _widest(camera: Camera) -> float:
    """Angle [rad] about the optical axis within which the whole picture is."""
    x, y = np.arange(-0.5, camera.width), np.arange(-0.5, camera.height)
    sides = [np.stack(np.broadcast_arrays(x, v), axis=-1) for v in (y[0], y[-1])]
    sides += [np.stack(np.broadcast_arrays(u, y), axis=-1) for u in (x[0], x[-1])]
    border = np.concatenate(sides)
    if camera.distortion_model == "none":
        rays = pinhole.unproject(camera.k, border, np.ones(len(border)))
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    else:
        rays = unproject(camera.k, Lens.of(camera.distortion_model, camera.distortion), border)
    # Where a lens sees nothing there is no ray: what it sees then is not known here.
    least = rays[:, 2].min()
    return float(np.arccos(np.clip(least, -1.0, 1.0))) if np.isfinite(least) else np.pi


def _off(boxes: np.ndarray) -> np.ndarray:
    """The least angles [rad] between the optical axis and a point of the balls about boxes; 0 for a camera in one."""
    middle = boxes.mean(axis=1)
    radius = np.linalg.norm(boxes - middle[:, None], axis=-1).max(axis=1)
    distance = np.maximum(np.linalg.norm(middle, axis=-1), np.finfo(np.float64).tiny)
    angle = np.arccos(np.clip(middle[:, 2] / distance, -1.0, 1.0)) - np.arcsin(np.minimum(radius / distance, 1.0))
    return np.where(distance <= radius, 0.0, angle)


def _side(length: float, positive: str, negative: str) -> str:
    return f"{abs(round(length, 6)):.3g} m {positive if length >= 0 else negative}"


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(f"'{name}'" for name in names[:NAMED]) + more
