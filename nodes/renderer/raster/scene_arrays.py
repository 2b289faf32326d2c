"""Holds what a raster draws: a scene's triangles and a camera on a device, and where the instances are."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.devices import device_named
from evis.scene.model import Camera, Scene
from nodes.renderer.geometry.triangles import geometry_of
from nodes.renderer.raster.lens.cameras import lens_of, make_view
from nodes.renderer.raster.row_tiles import RowTiles


class SceneArrays:
    """Holds a scene for E environments on a device, with room for the places of its instances and for a z-buffer.

    On the device: `points` vec3 [V] and `triangles` vec3i [T] of the geometry; `eye` mat33 [E], camera to world;
    `rotation` mat33 and `translation` vec3 [E, I], instance to camera; `packed` uint64 [E, H, W].
    """

    def __init__(self, scene: Scene, camera: Camera, envs: int, margin: int, device: str, threads: int) -> None:
        """Brings the scene to a device. margin: pixels beyond the image on every side. threads: of the CPU, which share
        the image's rows."""
        self.scene, self.camera, self.envs, self.margin = scene, camera, envs, margin
        self.device = device_named(device)
        self.shape = (envs, camera.height + 2 * margin, camera.width + 2 * margin)
        self.view, self.lens = make_view(camera, margin, self.device), lens_of(camera)
        # Pixels that one thread of a gather kernel does; on the CPU a row, for starting one costs more.
        self.span = self.shape[2] if self.device.is_cpu else 1
        # Tiles of pixels and threads of each, see view_kernels.tile_pixel.
        self.tiles = (envs, -(-self.shape[1] // 4) * -(-self.shape[2] // 8), 32)
        self.geometry = geometry = geometry_of(scene)
        self.names = [b.name for b in scene.bodies]
        self.camera_body = scene.body_index(camera.name)
        self.row_tiles = RowTiles(self.shape[1], threads if self.device.is_cpu else 1)
        self.sides = np.array([scene.materials[i.material].two_sided for i in scene.instances], bool)
        """bool [I]: whether an instance's triangles are seen from both sides."""
        count = len(self.sides)
        self.points = self.put(geometry.vertices, wp.vec3)
        self.triangles = self.put(geometry.triangles, wp.vec3i)
        self.triangle_instance = self.put(geometry.triangle_instance, wp.int32)
        self.two_sided = self.put(self.sides, wp.int32)
        self.rotation = self.empty((envs, count), wp.mat33)
        self.translation = self.empty((envs, count), wp.vec3)
        self.eye = self.empty(envs, wp.mat33)
        self.packed = self.empty(self.shape, wp.uint64)

    def put(self, array: np.ndarray, dtype: Any) -> wp.array:
        """Copies a numpy array to the device, rounded to float32 where the Warp type is."""
        scalar = getattr(dtype, "_wp_scalar_type_", dtype)
        array = np.ascontiguousarray(array, wp.dtype_to_numpy(scalar))
        return wp.array(array, dtype=dtype, device=self.device)

    def empty(self, shape: Any, dtype: Any) -> wp.array:
        """Makes an array on the device that is still to be written."""
        return wp.empty(shape, dtype=dtype, device=self.device)


def store(target: wp.array, values: np.ndarray) -> None:
    """Writes host values into a device array of the same shape, rounded to its scalar type."""
    if target.device is not None and target.device.is_cpu:
        target.numpy()[...] = values
    else:
        target.assign(np.ascontiguousarray(values, np.float32))
