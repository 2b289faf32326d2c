"""Computes everything that a camera sees at one instant, in several environments, and flow from one instant to
another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.labeler.rays import instant_kernels as kernels
from nodes.labeler.rays.motion_kernels import Motion
from nodes.labeler.rays.ray_caster import RayCaster
from nodes.renderer.raster.visibility import Visibility


@dataclass
class Seen:
    """Holds what every pixel sees, on the device: ids int32 [E, P], 0 for the background, points [E, P] in the camera's
    frame, and normals [E, P] in the frame of their mesh."""

    ids: wp.array
    points: wp.array
    normals: wp.array


@dataclass
class Instant:
    """Holds the poses of all bodies at an instant, and what the pixels see once that was computed.

    poses: of the bodies, float64 [E, N, 7]. to_mesh: of the meshes, on the device.
    """

    poses: np.ndarray
    to_mesh: Any
    seen: Seen | None = None

    def same(self, other: Instant) -> bool:
        """Tells whether everything is where it is at another instant."""
        return np.array_equal(self.poses, other.poses)


class Instants:
    """Computes where the surfaces seen by one camera are at single instants, and their flow from one to another."""

    def __init__(self, scene: Scene, camera: Camera, caster: RayCaster) -> None:
        """Takes what is seen, and what finds surfaces. caster: of the same camera."""
        self._scene, self._camera, self._caster, self._device = scene, camera, caster, caster.device
        self._directions: wp.array = wp.array(caster.pixels()[0], dtype=wp.vec3d, device=self._device)
        self._raster: Visibility | None = None
        self._shell: wp.array = wp.array(caster.shell, dtype=wp.int32, device=self._device)

    def at(self, motion: Motion, envs: np.ndarray, t: int) -> Instant:
        """Finds where things are in environments int64 [E] at a time [ns], which outside the motion's counts to its
        nearest end."""
        bodies, instances = (len(envs), motion.place.shape[0]), (len(envs), len(self._shell))
        poses: wp.array = wp.empty(bodies, dtype=wp.transformd, device=self._device)
        to_mesh: Any = kernels.CameraToMesh()
        to_mesh.turn = wp.empty(instances, dtype=wp.mat33d, device=self._device)
        to_mesh.shift = wp.empty(instances, dtype=wp.vec3d, device=self._device)
        of: wp.array = wp.array(envs.astype(np.int32), dtype=wp.int32, device=self._device)
        wp.launch(kernels.find_poses, bodies, [motion, of, t], [poses], device=self._device)
        given = [self._caster.surfaces, motion, of, t]
        wp.launch(kernels.find_camera_to_mesh, instances, given, [to_mesh], device=self._device)
        return Instant(np.array(poses.numpy()).reshape(*bodies, 7), to_mesh)

    def seen(self, instant: Instant) -> Seen:
        """Gives what every pixel sees."""
        if instant.seen is None:
            envs, device = len(instant.poses), self._device
            if self._raster is None or self._raster.envs != envs:
                self._raster = Visibility(self._scene, self._camera, envs, device=str(device))
            raster = self._raster
            raster.update(instant.poses)
            seen = Seen(*(self._empty(instant, kind) for kind in (wp.int32, wp.vec3d, wp.vec3)))
            given = [instant.to_mesh, int(self._caster.projection.lens is not None), self._directions]
            given += [raster.packed.reshape(seen.ids.shape)]
            given += [raster.triangles, raster.triangle_instance, raster.points]
            wp.launch(kernels.find_points, seen.ids.shape, given, [seen.ids, seen.points, seen.normals], device=device)
            instant.seen = seen
        return instant.seen

    def flow(self, start: Instant, end: Instant) -> tuple[np.ndarray, np.ndarray]:
        """Gives how far what pixels see at one instant has moved at another, float32 [E, H, W, 2] px, and whether it is
        seen there, uint8 [E, H, W]."""
        caster, device, (width, height) = self._caster, self._device, self._caster.size
        seen = self.seen(start)
        shape = seen.ids.shape
        flow, valid = self._empty(start, wp.vec2), self._empty(start, wp.uint8)
        places: wp.array = wp.empty((0, 0), dtype=wp.vec2d, device=device)
        if caster.projection.lens is not None:
            points = self._empty(start, wp.vec3d)
            given = [start.to_mesh, end.to_mesh, seen.ids, seen.points]
            wp.launch(kernels.carry_points, shape, given, [points], device=device)
            projected = caster.projection.places(points.numpy().reshape(-1, 3))
            places = wp.array(projected.reshape(*shape, 2), dtype=wp.vec2d, device=device)
        given = [
            caster.surfaces,
            start.to_mesh,
            end.to_mesh,
            self._shell,
            wp.mat33d(*caster.projection.k.ravel()),
            width,
            height,
        ]
        given += [seen.ids, seen.normals, seen.points, places]
        wp.launch(kernels.flow_to_places, shape, given, [flow, valid], device=device)
        image = len(start.poses), height, width
        return flow.numpy().reshape(*image, 2), valid.numpy().reshape(image)

    def _empty(self, instant: Instant, kind: Any) -> wp.array:
        return wp.empty((len(instant.poses), len(self._directions)), dtype=kind, device=self._device)
