"""Finds what a camera does not see, or sees falsely, at the first look at a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.geometry import se3
from evis.geometry.triangles import area_vectors
from evis.scene.mesh.closed import is_inside_out, surrounds
from evis.scene.model import Camera, Mesh, Scene
from evis.scene.view.field_of_view import least_angle, widest_angle

NAMED = 3
"""Things that a line names, of those that it is about."""


class FirstLook:
    """Finds what a camera is shown falsely or not at all, of a scene as it is at its first keyframe.

    Told are closed meshes that are turned inside out, unless the camera is in them or their material has two sides,
    textures too fine for their coordinates, and pictures of nothing: all that is before the camera is nearer than its
    `near`, or turned away from it, or nothing is there.
    """

    def __init__(self, scene: Scene) -> None:
        """Works out what the meshes alone tell, before there is a keyframe that would wait for it."""
        self._scene = scene
        meshes = {id(instance.mesh): instance.mesh for instance in scene.instances}
        box_of = {key: _box(mesh) for key, mesh in meshes.items()}
        turned_in = {key: is_inside_out(mesh) for key, mesh in meshes.items()}
        keys = [id(instance.mesh) for instance in scene.instances]
        self._boxes = np.array([box_of[key] for key in keys]).reshape(-1, 8, 3)
        self._one_sided = np.array([not scene.materials[i.material].two_sided for i in scene.instances], bool)
        self._turned_in = np.array([turned_in[key] for key in keys], bool) & self._one_sided
        self._places = np.array([instance.pose for instance in scene.instances]).reshape(-1, 7)
        self._bodies = [instance.body for instance in scene.instances]
        self._too_fine = _too_fine(scene)

    def lines(self, camera: Camera, poses: np.ndarray) -> list[str]:
        """Returns a line for each such thing. poses: float64 [N, 7], of the scene's bodies."""
        scene, boxes = self._scene, self._boxes
        if not scene.instances:
            nothing = f"camera '{camera.name}' sees nothing at the start: nothing in the scene is drawn"
            return [nothing] if scene.environment_map is None else []
        eye = poses[scene.body_index(camera.name)]
        places = se3.compose(np.concatenate((poses, se3.IDENTITY[None]))[self._bodies], self._places)
        # Where the camera is in the frames of the instances.
        eyes = se3.transform(se3.inverse(places), eye[:3])
        within = ((eyes >= boxes[:, 0]) & (eyes <= boxes[:, -1])).all(axis=-1)
        lines = []
        # A room of which only the inner side is there has the camera within.
        if turned := [scene.instances[k].name for k in np.flatnonzero(self._turned_in & ~within)]:
            lines.append(
                f"the faces of {_named(turned)} are turned inwards, so that from outside its far inner side is seen; "
                "turn them round in the file (Blender: Recalculate Outside), or give it a material with "
                "two_sided: true"
            )
        lines += self._too_fine
        if scene.environment_map is None:
            around = [
                k
                for k in np.flatnonzero(within & self._one_sided).tolist()
                if surrounds(scene.instances[k].mesh, eyes[k])
            ]
            to_camera = se3.compose(se3.inverse(eye), places)
            if why := _nothing(scene, camera, se3.transform(to_camera[:, None], boxes), eyes, around):
                lines.append(f"camera '{camera.name}' sees nothing at the start: {why}")
        return lines


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


def _nothing(scene: Scene, camera: Camera, boxes: np.ndarray, eyes: np.ndarray, around: Sequence[int]) -> str:
    """Why the picture is empty; "" where it is not.

    boxes: corners about the things in the camera's frame, float64 [I, 8, 3]. eyes: where it is in theirs, [I, 3].
    around: numbers of those in whose solid it is, of which it sees nothing.
    """
    middle = boxes.mean(axis=1)
    off = least_angle(middle, np.linalg.norm(boxes - middle[:, None], axis=-1).max(axis=1))
    ahead = np.setdiff1d(np.flatnonzero(off <= widest_angle(camera)), around)
    if around and not len(ahead):
        size = max(float(np.linalg.norm(np.ptp(boxes[k], axis=0))) for k in around)
        return (
            f"it is inside of {_things(scene, around)}, up to {size:.3g} m large, whose faces look outwards; a file in "
            "millimetres needs scale: 0.001, a room faces that look inwards"
        )
    if not len(ahead):
        k = int(off.argmin())
        right, down, forward = middle[k]
        place = f"{_side(right, 'right', 'left')}, {_side(down, 'below', 'above')}, {_side(forward, 'ahead', 'behind')}"
        return f"{_things(scene, [k])}, the nearest to its picture, is {place}; look_at turns a camera to a point"
    # As the raster has it: along the optical axis, and through a lens along the ray.
    reach = boxes[ahead][..., 2] if camera.distortion_model == "none" else np.linalg.norm(boxes[ahead], axis=-1)
    if reach.max() < camera.near:
        far = f"{reach.max():.3g} m of it, and near is {camera.near:g} m"
        return f"{_things(scene, ahead)} is within {far}; a smaller near shows it"
    if not any(_faces(scene, k, eyes[k]) for k in ahead):
        return f"{_things(scene, ahead)} is seen from behind or edge-on; turn it, or make its material two_sided: true"
    return ""


def _faces(scene: Scene, number: int, eye: np.ndarray) -> bool:
    """Whether any triangle of an instance is turned to a point float64 [3] of its frame, or shows its back too."""
    instance = scene.instances[number]
    corners = instance.mesh.vertices.astype(np.float64)[instance.mesh.faces]
    towards = np.einsum("fx,fx->f", area_vectors(corners), eye - corners[:, 0])
    return scene.materials[instance.material].two_sided or bool((towards > 0.0).any())


def _box(mesh: Mesh) -> np.ndarray:
    """Corners of the box about a mesh in its frame, float64 [8, 3], from the least to the greatest."""
    sides = np.stack((mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)), axis=-1).astype(np.float64)
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)


def _side(length: float, positive: str, negative: str) -> str:
    return f"{abs(round(length, 6)):.3g} m {positive if length >= 0 else negative}"


def _things(scene: Scene, numbers: Sequence[int] | np.ndarray) -> str:
    return _named([scene.instances[k].name for k in numbers])


def _named(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(f"'{name}'" for name in names[:NAMED]) + more
