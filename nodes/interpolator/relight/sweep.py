"""Sends where moving casters are in a gap to the device, which finds the boxes that hold all these places."""

from __future__ import annotations

from functools import partial
from itertools import cycle

import numpy as np
import warp as wp

from evis.gpu.cuda_graph import CudaGraphs
from nodes.interpolator.relight import sweep_kernels
from nodes.renderer.raster.visibility import Visibility


class Sweep:
    """Finds the boxes of what moves, C bodies with casters on them, in E environments: `lower` and `upper` vec3
    [E, C + 1], as of `Swept`.

    casters: int64, of the movers, which ones these are. size: float32 [C], radius of a ball about each [m]. bodies:
    int32 [I], of the instances on them the place of their body in `lower`, 0 for others.
    """

    def __init__(self, visibility: Visibility, envs: int, movers: np.ndarray, half: np.ndarray) -> None:
        """Takes the boxes about the instances. movers: bodies that may move, int64 [M], ascending. half: half the sides
        of the instances' boxes [I, 3] m."""
        v, geometry = visibility, visibility.geometry
        which = np.flatnonzero(np.isin(geometry.body, movers))
        which = which[np.argsort(geometry.body[which], kind="stable")]
        self._envs, self._device = envs, v.device
        self.casters, first = np.unique(np.searchsorted(movers, geometry.body[which]), return_index=True)
        self.bodies = np.zeros(len(geometry.body), np.int32)
        self.bodies[which] = 1 + np.searchsorted(self.casters, np.searchsorted(movers, geometry.body[which]))
        place = geometry.translation[which]
        reach = np.linalg.norm(place, axis=1) + np.linalg.norm(half[which], axis=1)
        self.size = np.maximum.reduceat(reach, first) if len(first) else np.zeros(0)
        self._first = v.put(np.append(first, len(which)), wp.int32)
        self._rest = [v.put(geometry.rotation[which], wp.mat33d), v.put(place, wp.vec3d)]
        self._half = v.put(half[which], wp.vec3d)
        shape = (envs, len(self.casters) + 1)
        self.lower, self.upper = v.empty(shape, wp.vec3), v.empty(shape, wp.vec3)
        self._poses = v.empty((0, 0, 0), wp.transformd)
        self._buffers = cycle(self._made((0, 0, 0)))
        self._graphs = CudaGraphs(v.device)

    def send(self, moved: np.ndarray, before: np.ndarray, origin: np.ndarray) -> None:
        """Sends the poses of a gap to the device, and finds the boxes around the moving things there.

        Args:
            moved: poses of the movers at the sub-frames, float64 [K, E, M, 7].
            before: the same at the keyframe before, float64 [E, M, 7].
            origin: float64 [3] m, that they are about.
        """
        shape = (len(moved) + 1, self._envs, len(self.casters))
        if self._poses.shape != shape:
            self._poses = wp.empty(shape, dtype=wp.transformd, device=self._device)
            self._buffers, self._graphs = cycle(self._made(shape)), CudaGraphs(self._device)
        number, view, buffer, sent = next(self._buffers)
        if sent is not None:
            wp.synchronize_event(sent)
        # Other modes than `clip` go through one more copy.
        np.take(before, self.casters, axis=1, out=view[0], mode="clip")
        np.take(moved, self.casters, axis=2, out=view[1:], mode="clip")
        self._graphs.run((number, *origin), partial(self._find, buffer, wp.vec3d(*origin)))
        if sent is not None:
            self._device.stream.record_event(sent)

    def _find(self, buffer: wp.array, origin: wp.vec3d) -> None:
        """Finds the boxes of what sweeps through space, of the poses in a buffer: launches only."""
        if self._device.is_cuda:
            wp.copy(self._poses, buffer)
        given = [self._poses, origin, self._first, *self._rest, self._half]
        boxes = [self.lower, self.upper]
        wp.launch(sweep_kernels.sweep, self._poses.shape[1:], given, boxes, device=self._device)
        wp.launch(sweep_kernels.enclose, self._envs, [], boxes, device=self._device)

    def _made(self, shape: tuple[int, ...]) -> list[tuple[int, np.ndarray, wp.array, wp.Event | None]]:
        """Allocates what poses are written into: on a GPU pinned memory that is copied, after an event; else where they
        are read."""
        if self._device.is_cpu:
            return [(0, self._poses.numpy(), self._poses, None)]
        made: list[tuple[int, np.ndarray, wp.array, wp.Event | None]] = []
        for number in range(2):
            buffer = wp.empty(shape, dtype=wp.transformd, device="cpu", pinned=True)
            sent = wp.Event(self._device)
            self._device.stream.record_event(sent)
            made.append((number, buffer.numpy(), buffer, sent))
        return made
