"""Holds the instances as occluders: one ray-tracing structure per mesh, and trees over many instances."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.scene.model import Mesh
from nodes.renderer.geometry.poses import InstancePoses
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows import occlusion_kernels
from nodes.renderer.shadows.boxes import box_halves, core_halves, half_extents
from nodes.renderer.shadows.merged import MergedMesh, mergeable
from nodes.renderer.shadows.ray_kernels import Casters

TREE_FROM = 16
"""Instances from which on a tree is faster than trying each one's bounding sphere."""

WORN = 0.5
"""Movers that have gone on average this many times their size since the tree was built let it be built anew."""

CHECKED, ASKED = 8, 4096
"""Images after which that is looked at again, and at how many instances at most, but of one environment at least."""


class Occluders:
    """Makes `casters`, for ray_kernels, of a visibility's instances; `update` and `launch` for every new image.

    still: bool [I]. active: False leaves all meshes out. trees: None for trees from TREE_FROM instances on. merged:
    whether the triangles under the tree of still instances are joined too, which on a GPU is faster for paths.
    """

    def __init__(
        self,
        visibility: Visibility,
        still: np.ndarray,
        active: bool,
        trees: bool | None = None,
        merged: bool = False,
        meshes: dict[int, wp.Mesh] | None = None,
    ) -> None:
        """Takes what sees the scene. meshes: ray-tracing structures by the id of their mesh, which others of the same
        scene have made already."""
        geometry, put = visibility.geometry, visibility.put
        self._visibility = visibility
        self.meshes: dict[int, wp.Mesh] = {} if meshes is None else meshes
        ids = np.array([self._mesh(mesh) if active else 0 for mesh in geometry.meshes], np.uint64)
        order = np.argsort(~still, kind="stable")
        order = order[ids[order] != 0]
        count = int(still[order].sum())
        self._half = half_extents(visibility)
        self._still, self._moving = order[:count], order[count:]
        self.casters = casters = Casters()
        casters.rotation, casters.translation = visibility.rotation, visibility.translation
        casters.mesh, casters.order = put(ids, wp.uint64), put(order, wp.int32)
        casters.box, casters.core = put(box_halves(visibility), wp.vec3), put(core_halves(visibility), wp.vec3)
        casters.outer = put(self._half, wp.vec3)
        casters.radius, casters.shell = put(geometry.radius, wp.float32), put(geometry.shell, wp.int32)
        casters.still, casters.is_still = count, put(still.astype(np.int32), wp.int32)
        casters.turn = visibility.eye
        casters.shift = visibility.empty(visibility.envs, wp.vec3)
        casters.pad = wp.zeros(visibility.envs, dtype=wp.float32, device=visibility.device)
        self._with_still, self._with_moving = (
            len(part) > 0 and (len(part) >= TREE_FROM if trees is None else trees)
            for part in (self._still, self._moving)
        )
        self.trees = self._with_still or self._with_moving
        self._merge = merged
        self._merged: MergedMesh | None = None
        casters.merged_instance = casters.merged_face = visibility.empty(0, wp.int32)
        self._middle, self._size = np.zeros(3), 0.0
        self._still_tree: wp.Bvh | None = None
        bodies = visibility.geometry.body[self._still]
        self._still_bodies = np.unique(bodies[bodies >= 0])
        self._still_at: np.ndarray | None = None
        self._looked = -1
        self.builds = 0
        """How often the tree of still instances was built: launches that were recorded before know another one."""
        self._moving_tree: wp.Bvh | None = None
        self._built, self._age = np.zeros((0, 3)), 0
        boxes = (visibility.envs, len(self._moving) if self._with_moving else 0)
        self._lower, self._upper = visibility.empty(boxes, wp.vec3), visibility.empty(boxes, wp.vec3)
        self._pad_bits = casters.pad.view(wp.int32)
        self._boxed = [put(self._moving, wp.int32), put(self._half, wp.vec3)]

    @property
    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that place trees, as `build_together` takes them."""
        return [(occlusion_kernels.place_trees, LAUNCH_BLOCK)] if self.trees else []

    def update(self, frames: InstancePoses) -> None:
        """Builds the trees that are not there yet, and anew where instances have moved far; poses are placed
        already."""
        if self._with_still and self._looked != self._visibility.still_place:
            self._looked = self._visibility.still_place
            at = frames.bodies[0, self._still_bodies]
            if self._still_at is None or not np.array_equal(at, self._still_at):
                self._still_at = at
                self.builds += 1
                self._build_still(frames)
        if self._with_moving:
            self._age += 1
            if self._moving_tree is None or self._age >= CHECKED:
                self._age = 0
                self._build_moving(frames)

    def launch(self) -> None:
        """Places the still tree for what is in the visibility's `poses`: launches only."""
        v = self._visibility
        if self.trees:
            inputs = [v.poses, v.camera_body, wp.vec3d(*self._middle), self._size]
            outputs = [self.casters.shift, self.casters.pad]
            wp.launch(occlusion_kernels.place_trees, v.envs, inputs, outputs, device=v.device)

    def launch_moving(self) -> None:
        """Places, after `launch`, the moving tree for the visibility's placed instances: launches only."""
        if self._moving_tree is not None:
            self._place_boxes()
            self._moving_tree.refit()

    def _place_boxes(self) -> None:
        v = self._visibility
        inputs, outputs = [*self._boxed, v.rotation, v.translation], [self._lower, self._upper, self._pad_bits]
        wp.launch(occlusion_kernels.place_boxes, self._lower.shape, inputs, outputs, device=v.device)

    def _build_still(self, frames: InstancePoses) -> None:
        """Builds the tree of still instances in the world's axes, about their middle."""
        # They are at the same places in all environments, of which there may be hundreds.
        frames = frames.of_first()
        rotation, translation = frames.body(-1)
        to_world = np.swapaxes(rotation[0], -1, -2)
        turn = to_world @ frames.rotation[0, self._still]
        centre = (frames.translation[0, self._still] - translation[0]) @ to_world.T
        self._middle = (centre.min(0) + centre.max(0)) / 2
        half = (np.abs(turn) @ self._half[self._still, :, None])[..., 0]
        box = centre - self._middle - half, centre - self._middle + half
        self._size = float(np.abs(box).max())
        lower, upper = (self._visibility.put(b, wp.vec3) for b in box)
        self._still_tree = wp.Bvh(lower, upper, constructor="sah")
        self.casters.still_tree = self._still_tree.id
        if self._merge and mergeable(self._visibility, self._still):
            self._merged = merged = MergedMesh(self._visibility, self._still, turn, centre - self._middle)
            self.casters.merged, self.casters.merged_instance = merged.mesh.id, merged.instance
            self.casters.merged_face = merged.face

    def _build_moving(self, frames: InstancePoses) -> None:
        """Builds the tree of moving instances, if there is none or it fits badly."""
        v = self._visibility
        # Of many environments a part tells how far things have gone.
        some = frames.bodies[:: max(1, len(frames.bodies) * len(self._moving) // ASKED)]
        places = some[:, np.maximum(v.geometry.body[self._moving], 0), :3].reshape(-1, 3)
        if self._moving_tree is not None:
            gone = places - self._built
            worn = np.linalg.norm(gone - gone.mean(0), axis=1).mean()
            if worn <= WORN * np.linalg.norm(self._half[self._moving], axis=1).mean():
                return
        self._built = places
        v.settle()
        v.place_instances()
        self._place_boxes()
        if self._moving_tree is not None:
            self._moving_tree.rebuild()
            return
        groups = v.put(np.repeat(np.arange(v.envs), len(self._moving)), wp.int32)
        self._moving_tree = wp.Bvh(self._lower.flatten(), self._upper.flatten(), groups=groups)
        self.casters.moving_tree = self._moving_tree.id

    def _mesh(self, mesh: Mesh) -> int:
        """Gives the id of the ray-tracing structure of a mesh, built once for all its instances; 0 for an empty one."""
        if not len(mesh.faces):
            return 0
        if id(mesh) not in self.meshes:
            points = np.asarray(mesh.vertices, np.float64)
            points = points - (points.min(0) + points.max(0)) / 2
            put: Any = self._visibility.put
            self.meshes[id(mesh)] = wp.Mesh(
                points=put(points, wp.vec3),
                indices=put(np.asarray(mesh.faces).reshape(-1), wp.int32),
                bvh_constructor="sah",
            )
        return int(self.meshes[id(mesh)].id)
