"""Who is seen by each pixel at one instant, without any shading."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.renderer import kernels, output_kernels
from nodes.renderer.geometry import flatten
from nodes.renderer.poses import Frames, check_poses

wp.config.log_level = wp.LOG_WARNING

TILE_WORKERS = 1 << 17
"""Threads that share the tiles of large triangles on a GPU."""

make_raster = cache(kernels.make_raster)


class Visibility:
    """Z-buffer of a scene for E environments: `update(poses)`, then `packed` or `hits()`.

    packed: Warp uint64 [E, H, W] on the device, float32 z-depth bits << 32 | triangle index, all ones where nothing is
    hit. H and W include `margin` pixels on every side. threads: row bands run in parallel on the CPU; the result does
    not depend on it. split: None splits large triangles among threads on a GPU and not on the CPU.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        envs: int = 1,
        margin: int = 0,
        device: str = "cpu",
        threads: int = 1,
        split: bool | None = None,
    ) -> None:
        self.scene, self.camera, self.envs, self.margin = scene, camera, envs, margin
        self.device = _device(device)
        self.shape = (envs, camera.height + 2 * margin, camera.width + 2 * margin)
        self.view = _view(camera, margin)
        # Pixels that one thread of a gather kernel does; on the CPU a row, for starting one costs more.
        self.span = self.shape[2] if self.device.is_cpu else 1
        self.geometry = geometry = flatten(scene)
        self.names = [b.name for b in scene.bodies]
        self.camera_body = scene.body_index(camera.name)
        self.bands = Bands(self.shape[1], threads if self.device.is_cpu else 1)
        two_sided = [scene.materials[i.material].two_sided for i in scene.instances]
        count, vertices, triangles = len(two_sided), len(geometry.vertices), len(geometry.triangles)
        self.points = self.put(geometry.vertices, wp.vec3)
        self.vertex_instance = self.put(geometry.vertex_instance, wp.int32)
        self.triangles = self.put(geometry.triangles, wp.vec3i)
        self.triangle_instance = self.put(geometry.triangle_instance, wp.int32)
        self.two_sided = self.put(np.array(two_sided, np.int32), wp.int32)
        self.vertices = self.empty((envs, vertices), wp.vec3)
        self.rotation = self.empty((envs, count), wp.mat33)
        self.translation = self.empty((envs, count), wp.vec3)
        self.packed = self.empty(self.shape, wp.uint64)
        self._split = self.device.is_cuda if split is None else split
        pieces = envs * triangles if self._split else 0
        self._counter = wp.zeros(1, dtype=wp.uint64, device=self.device)
        self._large = self.empty(pieces, wp.vec2i)
        self._large_start = self.empty(pieces, wp.int64)
        self._rest = [self.put(geometry.rotation, wp.mat33), self.put(geometry.translation, wp.vec3)]
        self._raster = make_raster(self._split)

    def frames(self, poses: np.ndarray) -> Frames:
        """Checked float64 camera-relative matrices of all instances. Raises ValueError naming a body."""
        geometry = self.geometry
        poses = check_poses(poses, self.envs, self.names)
        return Frames(poses, self.camera_body, geometry.body, geometry.rotation, geometry.translation)

    def update(self, poses: np.ndarray | Frames) -> Frames:
        """Fill `packed` for body poses float64 [E, N, 7]."""
        frames = poses if isinstance(poses, Frames) else self.frames(poses)
        store(self.rotation, frames.rotation)
        store(self.translation, frames.translation)
        self.transform()
        self.raster()
        return frames

    def transform(self) -> None:
        """Vertices of all environments to the camera frame."""
        inputs = [self.points, self.vertex_instance, self.rotation, self.translation, self.vertices]
        wp.launch(kernels.to_camera, dim=self.vertices.shape, inputs=inputs, device=self.device)

    def raster(self) -> None:
        """The z-buffer of the transformed vertices. Each band owns its rows, so no two threads share a pixel."""
        self.packed.view(wp.int64).fill_(-1)
        shared = [self.vertices, self.triangles, self.triangle_instance, self.two_sided, self.packed]
        large = [self._counter, self._large, self._large_start]
        dim = (self.envs, len(self.geometry.triangles))
        if self._split:
            self._counter.zero_()
        self.bands.launch(self._raster, lambda row0, row1: (dim, [self.view, row0, row1, *shared, *large]), self.device)
        if self._split:
            inputs = [self.view, TILE_WORKERS, self.vertices, self.triangles, *large, self.packed]
            wp.launch(kernels.raster_tiles, dim=TILE_WORKERS, inputs=inputs, device=self.device)

    def hits(self) -> dict[str, np.ndarray]:
        """What `packed` says, as numpy.

        triangle int32 [E, H, W]: index over all instances, -1 = nothing (of instance i: `geometry.first[i]` on);
        instance int32 [E, H, W], -1 = nothing; point float32 [E, H, W, 3] m in the frame of the instance's body.
        """
        out = [self.empty(self.shape, wp.int32), self.empty(self.shape, wp.int32), self.empty(self.shape, wp.vec3)]
        inputs = [self.view, self.packed, self.triangle_instance, self.rotation, self.translation, *self._rest, *out]
        wp.launch(output_kernels.body_points, dim=self.shape, inputs=inputs, device=self.device)
        return dict(zip(("triangle", "instance", "point"), (a.numpy() for a in out)))

    def put(self, array: np.ndarray, dtype: Any) -> wp.array:
        """A device copy of a numpy array, rounded to float32 where the Warp type is."""
        scalar = getattr(dtype, "_wp_scalar_type_", dtype)
        array = np.ascontiguousarray(array, wp.dtype_to_numpy(scalar))
        return wp.array(array, dtype=dtype, device=self.device)

    def empty(self, shape: Any, dtype: Any) -> wp.array:
        """A device array to be written."""
        return wp.empty(shape, dtype=dtype, device=self.device)


class Bands:
    """Rows split over threads, for kernels that write only the rows they are given."""

    def __init__(self, height: int, threads: int) -> None:
        count = max(1, min(threads, height))
        edges = [height * k // count for k in range(count + 1)]
        self.rows = list(pairwise(edges))
        self._pool = ThreadPoolExecutor(count) if count > 1 else None

    def launch(self, kernel: wp.Kernel, arguments: Any, device: Any) -> None:
        """Run `kernel` once per band; arguments(row0, row1) gives its launch dimensions and inputs."""
        commands = []
        for row0, row1 in self.rows:
            dim, inputs = arguments(row0, row1)
            if self._pool is None:
                wp.launch(kernel, dim=dim, inputs=inputs, device=device)
            else:
                commands.append(wp.launch(kernel, dim=dim, inputs=inputs, device=device, record_cmd=True))
        if self._pool is not None:
            list(self._pool.map(lambda command: command.launch(), commands))


def store(target: wp.array, values: np.ndarray) -> None:
    """Write host values into a device array of the same shape, rounding to its scalar type."""
    if target.device is not None and target.device.is_cpu:
        target.numpy()[...] = values
    else:
        target.assign(np.ascontiguousarray(values, np.float32))


def _device(name: str) -> Any:
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ", ".join(str(d) for d in wp.get_devices())
        raise ValueError(f"there is no device '{name}' here; there is {known}") from None


def _view(camera: Camera, margin: int) -> kernels.View:
    """The kernels' camera. Raises ValueError for intrinsics that are no pinhole's."""
    k = np.asarray(camera.k, np.float64)
    if k.shape != (3, 3) or not np.isfinite(k).all() or not (k[0, 0] > 0 and k[1, 1] > 0) or k[0, 1] or k[1, 0]:
        raise ValueError(f"camera '{camera.name}': k must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], it is {k.tolist()}")
    if camera.width < 1 or camera.height < 1 or margin < 0 or not camera.near > 0:
        raise ValueError(
            f"camera '{camera.name}': {camera.width} x {camera.height} px, margin {margin} px, near {camera.near} m; "
            "the size and near must be above 0"
        )
    view = kernels.View()
    view.fx, view.fy, view.cx, view.cy = (float(v) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    view.near, view.margin = float(camera.near), margin
    view.width, view.height = camera.width + 2 * margin, camera.height + 2 * margin
    far_x = max(view.cx + margin, view.width - 1 - margin - view.cx) / view.fx
    far_y = max(view.cy + margin, view.height - 1 - margin - view.cy) / view.fy
    view.reach = float(np.hypot(np.hypot(far_x, far_y), 1.0))
    return view
