"""Computes what a camera's pixels see at any instant of the states that are known: exact geometry, without images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import interpolate, pinhole, se3
from evis.geometry.distortion import Lens, project, unproject
from evis.scene.model import Camera, Scene
from msgs.header import Header
from msgs.own_time import ORIGIN
from msgs.world import WorldState
from nodes.labeler.motion_kernels import Motion
from nodes.labeler.sight_kernels import Surfaces, first_surfaces, flow_of_surfaces
from nodes.renderer.geometry.triangles import geometry_of
from nodes.renderer.raster.lens.cameras import lens_of

KEPT = 3
"""States that are kept: events may be those of the interval before, and their sub-frames begin before it."""


class History:
    """Keeps the last states of E environments, and gives the motion over all of their time."""

    def __init__(self) -> None:
        self._states: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._motion: Motion | None = None
        self._device: Any = None

    def add(self, state: WorldState) -> None:
        """Takes the next state; one that is not later than those before begins anew."""
        if self._states and state.t[-1] <= self._states[-1][0][-1]:
            self._states = []
        moving = np.array(state.moving, np.int64)
        row = (np.array(state.t), moving, np.array(state.moving_pose), np.array(state.moving_twist))
        self._states = [*self._states, row][-KEPT:]
        self._end = np.array(state.end_pose)
        self._motion = None

    @property
    def known(self) -> bool:
        """Tells whether any state is known."""
        return bool(self._states)

    @property
    def span(self) -> tuple[int, int]:
        """Gives the first and the last time that is known [ns]."""
        return int(self._states[0][0][0]), int(self._states[-1][0][-1])

    def motion(self, device: Any) -> Motion:
        """Gives the motion on a device; where there is only one instant, nothing moves."""
        if self._motion is None or self._device != device:
            self._motion, self._device = self._made(device), device
        return self._motion

    def _made(self, device: Any) -> Motion:
        parts = [part for part in self._states if len(part[0]) > 1]
        if not parts:
            t, moving, pose, twist = self._states[-1]
            none = np.zeros(0, np.int64)
            parts = [(np.append(t, t + 1), none, pose[:, [0, 0]][:, :, none], twist[:, [0, 0]][:, :, none])]
        envs, bodies = self._end.shape[:2]
        columns = np.unique(np.concatenate([part[1] for part in parts]))
        starts, poses, cubics = [], [], []
        for k, (t, moving, pose, twist) in enumerate(parts):
            # What does not move in this interval is where it is in the next state's start, or at the end.
            later = [p for p in parts[k + 1 :]]
            whole = np.empty((envs, len(t), len(columns), 7))
            spin = np.zeros((envs, len(t), len(columns), 6))
            whole[:] = self._rest_after(later, columns)[:, None]
            at = np.searchsorted(columns, moving)
            whole[:, :, at], spin[:, :, at] = pose, twist
            starts.append(t[:-1])
            poses.append(whole[:, :-1])
            cubics.append(interpolate.gaps(t, whole, spin))
        place = np.full(bodies, -1, np.int32)
        place[columns] = np.arange(len(columns))
        motion = Motion()
        motion.start = wp.array(np.append(np.concatenate(starts), parts[-1][0][-1]), dtype=wp.int64, device=device)
        motion.place = wp.array(place, dtype=wp.int32, device=device)
        motion.rest = wp.array(np.ascontiguousarray(self._end), dtype=wp.transformd, device=device)
        motion.pose = wp.array(np.concatenate(poses, 1), dtype=wp.transformd, device=device)
        curves = np.concatenate(cubics, 1)
        motion.cubics = wp.array(curves.reshape(*curves.shape[:3], 6, 3), dtype=wp.vec3d, device=device)
        return motion

    def _rest_after(
        self, later: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]], columns: np.ndarray
    ) -> np.ndarray:
        """Poses [E, C, 7] of bodies that rest in an interval: where the next one in which they move begins."""
        rest = self._end[:, columns].copy()
        for _, moving, pose, _ in reversed(later):
            rest[:, np.searchsorted(columns, moving)] = pose[:, 0]
        return rest


class Histories:
    """Keeps the last states in each time that environments have of their own, by its origin [ns] on the stamps."""

    def __init__(self) -> None:
        self._of: dict[int, History] = {}
        self._origin = np.zeros(0, np.int64)
        self._episodes = np.zeros(0, np.int32)

    def add(self, state: WorldState) -> None:
        """Takes the next state. One of the last one's stamp is of those alone that begin an episode there."""
        envs = len(state.end_pose)
        origin = np.zeros(envs, np.int64) if state.own is None else np.array(state.own[:, ORIGIN])
        known, self._of = self._of, {}
        for start in np.unique(origin).tolist():
            mine = np.flatnonzero(origin == start)
            history = self._of[start] = known.get(start) or History()
            t = np.asarray(state.t if state.own_t is None else state.own_t[mine[0]])
            old = len(self._episodes) == envs and bool((self._origin[mine] == start).all())
            if old and history.known and t[-1] == history.span[1] and self._same(state, mine):
                continue
            steps = np.append(np.diff(t) > 0, True)
            pose, twist = (np.asarray(a)[:, steps] for a in (state.moving_pose, state.moving_twist))
            history.add(replace(state, t=t[steps], moving_pose=pose, moving_twist=twist))
        self._origin, self._episodes = origin, np.array(state.episodes)

    def _same(self, state: WorldState, envs: np.ndarray) -> bool:
        return np.array_equal(np.asarray(state.episodes)[envs], self._episodes[envs])

    def __iter__(self) -> Iterator[tuple[int, np.ndarray, History]]:
        """Gives origins, the environments int64 [n] that have it, and the states in that time."""
        for start, history in self._of.items():
            yield start, np.flatnonzero(self._origin == start), history


class Sight:
    """Finds the surfaces that a camera sees in given directions, for many directions at once, each at a time of its
    own.
    """

    def __init__(self, scene: Scene, camera: Camera, device: str = "cpu") -> None:
        """Takes the scene's meshes. Raises ValueError naming an instance or a camera that is not usable."""
        geometry = geometry_of(scene)
        self.device = wp.get_device(device)
        self._meshes: dict[int, wp.Mesh] = {}
        self.lens: Lens | None = None
        if lens_of(camera) != "none":
            self.lens = Lens.of(camera.distortion_model, camera.distortion)
        self.k = np.asarray(camera.k, np.float64)
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
        s.camera, s.near, s.lens = scene.body_index(camera.name), float(camera.near), int(self.lens is not None)

    def standing(self, bodies: int) -> Motion:
        """Gives the motion of so many bodies that stand in one place, for kernels to be compiled with."""
        pose, still = np.tile(se3.IDENTITY, (1, 1, bodies, 1)), np.zeros((1, 1, bodies, 6))
        history = History()
        history.add(WorldState.dense(Header(0), np.zeros(1, np.int64), pose, still, np.zeros(1, np.int32)))
        return self.motion(history)

    def prepare(self, bodies: int) -> None:
        """Compiles and loads the kernels, as a node does before the graph starts. bodies: of the scene."""
        motion, env, time = self.standing(bodies), np.zeros(1, np.int32), np.zeros(1, np.int64)
        ahead = np.array([[0.0, 0.0, 1.0]])
        self.find_surfaces(motion, env, time, ahead)
        nothing = np.zeros(1, np.int32), np.full(1, np.inf, np.float32)
        self.flow(motion, env, time, ahead, np.zeros((1, 2, 3)), nothing)

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """Gives unit directions float64 [Q, 3] in the camera's frame of places float64 [Q, 2] px in the image."""
        if self.lens is not None:
            return unproject(self.k, self.lens, pixels)
        rays = pinhole.unproject(self.k, pixels, np.ones(len(pixels)))
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def pixels(self) -> tuple[np.ndarray, np.ndarray]:
        """Gives the directions [H W, 3] of all pixels, row by row, and their derivatives [H W, 2, 3]."""
        directions = self.directions(pinhole.pixel_grid(*self.size).reshape(-1, 2))
        return directions, self.derivative(directions)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Gives places float64 [Q, 2] px in the image of points [Q, 3] in the camera's frame; NaN for those that no
        pixel could see."""
        if self.lens is not None:
            return project(self.k, self.lens, points)
        with np.errstate(divide="ignore", invalid="ignore"):
            places = pinhole.project(self.k, points)
        return np.where(points[:, 2:] > 0, places, np.nan)

    def derivative(self, directions: np.ndarray) -> np.ndarray:
        """Gives d(pixel) / d(X, Y, Z) float64 [Q, 2, 3] at a distance of 1 m in unit directions [Q, 3]."""
        if self.lens is not None:
            return np.diag(np.diag(self.k)[:2]) @ self.lens.derivative(directions)
        x, y, z = directions.T
        zero = np.zeros_like(x)
        u, v = np.stack((1 / z, zero, -x / z**2), -1), np.stack((zero, 1 / z, -y / z**2), -1)
        return self.k[:2, :2] @ np.stack((u, v), -2)

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
        given = [self.surfaces, motion, *self._question(env, t, directions)]
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
        given = [self.surfaces, motion, *self._question(env, t, directions), image, ids, distances]
        wp.launch(flow_of_surfaces, len(t), given, [out], device=self.device)
        return out.numpy()

    def motion(self, history: History) -> Motion:
        """Gives a history's motion on this device."""
        return history.motion(self.device)

    def _question(self, env: np.ndarray, t: np.ndarray, directions: np.ndarray) -> list[wp.array]:
        return [self._put(env, wp.int32), self._put(t, wp.int64), self._put(directions, wp.vec3d)]

    def _put(self, values: np.ndarray, dtype: Any) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=self.device)

    def _mesh(self, mesh: Any) -> int:
        """Id of the ray-tracing structure of a mesh about its middle, one for all its instances; 0 for an empty one."""
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
