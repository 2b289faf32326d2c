"""Computes what a camera's pixels see at any instant of the states that are known: exact geometry, without images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole, se3
from evis.scene.model import Camera, Scene
from msgs.header import Header
from msgs.world import WorldState
from nodes.labeler.projection import Projection
from nodes.labeler.rays.motion_history import MotionHistory
from nodes.labeler.rays.motion_kernels import Motion
from nodes.labeler.rays.ray_caster_kernels import Surfaces, first_surfaces, flow_of_surfaces
from nodes.renderer.geometry.triangles import geometry_of


class RayCaster:
    """Finds the surfaces that a camera sees in given directions, for many directions at once, each at a time of its
    own.
    """

    def __init__(self, scene: Scene, camera: Camera, device: str = "cpu") -> None:
        """Takes the scene's meshes. Raises ValueError naming an instance or a camera that is not usable."""
        geometry = geometry_of(scene)
        self.device = wp.get_device(device)
        self._meshes: dict[int, wp.Mesh] = {}
        self.projection = Projection.of(camera.k, camera.distortion_model, camera.distortion)
        self.size = (camera.width, camera.height)
        self.shell = geometry.shell
        """Whether an instance can cover itself (SHELL_*), int32 [I]."""
        s: Any = Surfaces()
        self.surfaces = s
        s.mesh = self._put(np.array([self._mesh(mesh) for mesh in geometry.meshes], np.uint64), wp.uint64)
        s.body = self._put(geometry.body, wp.int32)
        offset = se3.make_pose(geometry.translation, se3.from_matrix(geometry.rotation))
        s.offset = self._put(offset.reshape(-1, 7), wp.transformd)
        s.radius = self._put(geometry.radius, wp.float32)
        sides = np.array([scene.materials[i.material].two_sided for i in scene.instances], np.int32)
        s.two_sided = self._put(sides, wp.int32)
        s.camera, s.near = scene.body_index(camera.name), float(camera.near)
        s.lens = int(self.projection.lens is not None)

    def still_motion(self, bodies: int) -> Motion:
        """Gives the motion of so many bodies that stand in one place, for kernels to be compiled with."""
        pose, still = np.tile(se3.IDENTITY, (1, 1, bodies, 1)), np.zeros((1, 1, bodies, 6))
        history = MotionHistory()
        history.add(WorldState.dense(Header(0), np.zeros(1, np.int64), pose, still, np.zeros(1, np.int32)))
        return self.motion(history)

    def prepare(self, bodies: int) -> None:
        """Compiles and loads the kernels, as a node does before the graph starts. bodies: of the scene."""
        motion, env, time = self.still_motion(bodies), np.zeros(1, np.int32), np.zeros(1, np.int64)
        ahead = np.array([[0.0, 0.0, 1.0]])
        self.find_surfaces(motion, env, time, ahead)
        nothing = np.zeros(1, np.int32), np.full(1, np.inf, np.float32)
        self.flow(motion, env, time, ahead, np.zeros((1, 2, 3)), nothing)

    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Gives the unit directions [H W, 3] of all pixels, row by row, and d(pixel) / d(X, Y, Z) there [H W, 2, 3]."""
        directions = self.projection.directions(pinhole.pixel_grid(*self.size).reshape(-1, 2))
        return directions, self.projection.derivative(directions)

    def find_surfaces(
        self, motion: Motion, env: np.ndarray, t: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Finds the first surfaces.

        Args:
            motion: of the bodies.
            env: int32 [Q].
            t: int64 [Q] ns; times outside the motion's count to its nearest end.
            directions: float64 [Q, 3], unit, in the camera's frame.

        Returns:
            ids int32 [Q], 0 for the background, and distances float32 [Q] m from the camera's centre, inf there.
        """
        found: wp.array = wp.empty(len(t), dtype=wp.int32, device=self.device)
        distance: wp.array = wp.empty(len(t), dtype=wp.float32, device=self.device)
        given = [self.surfaces, motion, *self._rays(env, t, directions)]
        wp.launch(first_surfaces, len(t), given, [found, distance], device=self.device)
        return found.numpy(), distance.numpy()

    def flow(
        self, motion: Motion, env: np.ndarray, t: np.ndarray, directions: np.ndarray, derivative: np.ndarray,
        surface: Sequence[np.ndarray],
    ) -> np.ndarray:  # fmt: skip
        """Computes the flow float32 [Q, 2] px/s of surfaces, (ids, distances) of `find_surfaces`, at times t."""
        out: wp.array = wp.empty((len(t), 2), dtype=wp.float32, device=self.device)
        image = self._put(derivative, wp.vec3d)
        ids, distances = self._put(surface[0], wp.int32), self._put(surface[1], wp.float32)
        given = [self.surfaces, motion, *self._rays(env, t, directions), image, ids, distances]
        wp.launch(flow_of_surfaces, len(t), given, [out], device=self.device)
        return out.numpy()

    def motion(self, history: MotionHistory) -> Motion:
        """Gives a history's motion on this device."""
        return history.motion(self.device)

    def _rays(self, env: np.ndarray, t: np.ndarray, directions: np.ndarray) -> list[wp.array]:
        return [self._put(env, wp.int32), self._put(t, wp.int64), self._put(directions, wp.vec3d)]

    def _put(self, values: np.ndarray, dtype: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _mesh(self, mesh: Any) -> int:
        """Gives the id of the ray-tracing structure of a mesh about its middle, one for all its instances; 0 for an
        empty one."""
        if not len(mesh.faces):
            return 0
        if id(mesh) not in self._meshes:
            points = np.asarray(mesh.vertices, np.float64)
            points = points - (points.min(0) + points.max(0)) / 2
            self._meshes[id(mesh)] = wp.Mesh(
                points=self._put(points, wp.vec3),
                indices=self._put(np.asarray(mesh.faces).reshape(-1), wp.int32),
                bvh_constructor="sah" if self.device.is_cpu else None,
            )
        return int(self._meshes[id(mesh)].id)
