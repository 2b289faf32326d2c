"""Who is seen by each pixel at one instant, without any shading."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.renderer import clusters, output_kernels, raster_kernels
from nodes.renderer.cameras import lens_of, make_view
from nodes.renderer.geometry import flatten, is_static
from nodes.renderer.poses import Frames, check_poses

wp.config.log_level = wp.LOG_WARNING

TILE_WORKERS = 1 << 17
"""Threads that share the tiles of large triangles on a GPU."""

make_raster = cache(raster_kernels.make_raster)
make_raster_tiles = cache(raster_kernels.make_raster_tiles)


class Visibility:
    """Z-buffer of a scene for E environments: `update(poses)`, then `packed` or `hits()`.

    packed: Warp uint64 [E, H, W] on the device, float32 z-depth bits << 32 | triangle index, all ones where nothing is
    hit; for a distorted camera, the distance along the pixel's ray in place of the depth. H and W include `margin`
    pixels on every side. threads: row bands run in parallel on the CPU; the result does not depend on it. split: None
    splits large triangles among threads on a GPU and not on the CPU.

    While a still camera sees still instances where they were, these are kept as a layer and only the others are drawn
    over it; the z-buffer is the same, bit for bit. layered=False draws everything anew. `vertices` holds those of
    instances that may be seen.
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
        layered: bool = True,
    ) -> None:
        self.scene, self.camera, self.envs, self.margin = scene, camera, envs, margin
        self.device = _device(device)
        self.shape = (envs, camera.height + 2 * margin, camera.width + 2 * margin)
        self.view, self.lens = make_view(camera, margin, self.device), lens_of(camera)
        # Pixels that one thread of a gather kernel does; on the CPU a row, for starting one costs more.
        self.span = self.shape[2] if self.device.is_cpu else 1
        self.geometry = geometry = flatten(scene)
        self.names = [b.name for b in scene.bodies]
        self.camera_body = scene.body_index(camera.name)
        self.bands = Bands(self.shape[1], threads if self.device.is_cpu else 1)
        two_sided = np.array([scene.materials[i.material].two_sided for i in scene.instances], bool)
        count, vertices, triangles = len(two_sided), len(geometry.vertices), len(geometry.triangles)
        self.points = self.put(geometry.vertices, wp.vec3)
        self.triangles = self.put(geometry.triangles, wp.vec3i)
        self.triangle_instance = self.put(geometry.triangle_instance, wp.int32)
        self.two_sided = self.put(two_sided, wp.int32)
        self.vertices = self.empty((envs, vertices), wp.vec3)
        self.rotation = self.empty((envs, count), wp.mat33)
        self.translation = self.empty((envs, count), wp.vec3)
        self.packed = self.empty(self.shape, wp.uint64)
        still = geometry.static & is_static(scene, self.camera_body)
        pieces = clusters.triangle_blocks(geometry, still, two_sided), clusters.vertex_blocks(geometry, still)
        self._blocks = [(self._put_blocks(p), p.still, len(p.instance)) for p in pieces]
        self._still = np.flatnonzero(still)
        self._layered = layered and 0 < pieces[0].still
        self._layer = self.empty(self.shape if self._layered else (0, 0, 0), wp.uint64)
        self._basis: tuple[np.ndarray, ...] | None = None
        self._split = self.device.is_cuda if split is None else split
        listed = envs * triangles if self._split else 0
        self._counter = wp.zeros(1, dtype=wp.uint64, device=self.device)
        self._large = self.empty(listed, wp.vec2i)
        self._large_start = self.empty(listed, wp.int64)
        self._rest = [self.put(geometry.rotation, wp.mat33), self.put(geometry.translation, wp.vec3)]
        self._lanes = 1 if self.device.is_cpu else clusters.SIZE
        self._raster = make_raster(self._split, self.lens)

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
        if not self._layered:
            self.packed.view(wp.int64).fill_(-1)
            self._draw(self.packed, True, True)
            return frames
        basis = (frames.rotation[:, self._still], frames.translation[:, self._still])
        if self._basis is None or not all(map(np.array_equal, basis, self._basis)):
            self._layer.view(wp.int64).fill_(-1)
            self._draw(self._layer, True, False)
            self._basis = basis
        wp.copy(self.packed, self._layer)
        self._draw(self.packed, False, True)
        return frames

    def _draw(self, packed: wp.array, still: bool, moving: bool) -> None:
        """Add the still blocks, the others, or both to a z-buffer. Bands own their rows: no two threads share one."""
        (blocks, first, count), (points, first_points, count_points) = self._blocks
        start, end = (0 if still else first), (count if moving else first)
        start_points, end_points = (0 if still else first_points), (count_points if moving else first_points)
        if end <= start:
            return
        place = [self.rotation, self.translation]
        inputs = [self.view, start_points, self._lanes, points, self.points, *place, self.vertices]
        dim = (self.envs, end_points - start_points, self._lanes)
        wp.launch(raster_kernels.to_camera, dim=dim, inputs=inputs, device=self.device)
        shared = [start, self._lanes, blocks, self.two_sided, *place, self.vertices, self.triangles, packed]
        large = [self._counter, self._large, self._large_start]
        dim = (self.envs, end - start, self._lanes)
        if self._split:
            self._counter.zero_()
        self.bands.launch(self._raster, lambda row0, row1: (dim, [self.view, row0, row1, *shared, *large]), self.device)
        if self._split:
            inputs = [self.view, TILE_WORKERS, self.vertices, self.triangles, *large, packed]
            wp.launch(make_raster_tiles(self.lens), dim=TILE_WORKERS, inputs=inputs, device=self.device)

    def hits(self) -> dict[str, np.ndarray]:
        """What `packed` says, as numpy.

        triangle int32 [E, H, W]: index over all instances, -1 = nothing (of instance i: `geometry.first[i]` on);
        instance int32 [E, H, W], -1 = nothing; point float32 [E, H, W, 3] m in the frame of the instance's body.
        """
        out = [self.empty(self.shape, wp.int32), self.empty(self.shape, wp.int32), self.empty(self.shape, wp.vec3)]
        inputs = [self.view, self.packed, self.triangle_instance, self.rotation, self.translation, *self._rest, *out]
        wp.launch(output_kernels.body_points, dim=self.shape, inputs=inputs, device=self.device)
        return dict(zip(("triangle", "instance", "point"), (a.numpy() for a in out)))

    def _put_blocks(self, blocks: clusters.Blocks) -> Any:
        put = raster_kernels.Blocks()
        for name in ("instance", "first", "last"):
            setattr(put, name, self.put(getattr(blocks, name), wp.int32))
        put.centre, put.axis = self.put(blocks.centre, wp.vec3), self.put(blocks.axis, wp.vec3)
        for name in ("radius", "extent", "cosine"):
            setattr(put, name, self.put(getattr(blocks, name), wp.float32))
        return put

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
