"""Sends poses from the host to the device, once per instant."""

from __future__ import annotations

from itertools import cycle, pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.runtime.workers import edges_of
from nodes.renderer.geometry.pose_kernels import move_bodies
from nodes.renderer.geometry.poses import POSE_BYTES

PIECE = 1 << 19
"""Bytes that are copied to a GPU at once; what is no more is read by the GPU from where the host wrote it."""

SPARSE_FROM = 1 << 18
"""Bytes of an instant from which on it pays to send only the bodies that may move."""

SPARSE = 4
"""Of this many bodies, at most one may move then."""

READ = 2
"""Buffers that a GPU reads in turn."""


class PoseUpload:
    """Sends poses to a device: those of an instant as `now` and of the one before as `before`, transformd [E, N] on the
    device.

    Through pinned buffers on a GPU, so that nobody waits for the copy. movers int64 [M]: bodies that may move; where
    these are few of many, `sparse` is set, and `advance` sends them alone.
    """

    def __init__(self, envs: int, bodies: int, movers: np.ndarray, device: Any, sparse: bool | None = None) -> None:
        """Makes the buffers of a device. sparse: whether only `movers` are sent; None = where it pays."""
        self._device, shape = device, (envs, bodies)
        pays = envs * bodies * POSE_BYTES >= SPARSE_FROM and len(movers) * SPARSE <= bodies
        self.sparse = pays if sparse is None else sparse
        self.sent = movers if self.sparse else np.arange(bodies)
        """Bodies int64 [M] whose poses `advance` takes."""
        self.now = wp.zeros(shape, dtype=wp.transformd, device=device)
        self.before = wp.zeros(shape, dtype=wp.transformd, device=device)
        self._last: np.ndarray | None = None
        self._missing: np.ndarray | None = None
        """Poses of the bodies `sent` that `_last` has not yet."""
        self.coming = 0
        """0, or which buffer it comes from, from 1 on."""
        self._latest: np.ndarray | None = None
        self._views = {id(a): a.numpy() for a in (self.now, self.before)} if device.is_cpu else {}
        # An instant takes two at most, so that `last` is not written over before the next one is compared with it.
        self._slots = cycle(self._buffers(shape, 4))
        self._together = False
        """Whether `before` is `now` but for what is sent."""
        sent = (envs, len(self.sent))
        self._which: wp.array = wp.array(self.sent, dtype=wp.int32, device=device)
        self._read = self._buffers(sent, READ) if envs * len(self.sent) * POSE_BYTES <= PIECE else []
        self._copied = cycle(self._buffers(sent, 0 if self._read else 4))
        self._landing = wp.zeros((0, 0) if self._read else sent, dtype=wp.transformd, device=device)
        self._fresh = [numbers(buffer, device) for buffer, _, _ in self._read] or [numbers(self._landing, device)]
        self._turns = cycle(range(len(self._fresh)))
        self._poses = [numbers(self.now, device), numbers(self.before, device)]
        self._host = np.zeros((*shape, 7) if self.sparse and device.is_cuda else (0, 0, 7))

    def put(self, poses: np.ndarray) -> None:
        """Puts checked poses into `now`."""
        self._together, self.coming, self._latest = False, 0, None
        self._last, self._missing = self._write(self.now, poses, self._slots), None
        if self._host.size:
            # The buffer that they went through must not change while they are sent.
            self._host[...] = poses
            self._last = self._host

    @property
    def begun(self) -> bool:
        """Tells whether there is a last update."""
        return self._last is not None

    @property
    def last(self) -> np.ndarray | None:
        """Gives what `now` holds, or will when what is `coming` has arrived, float64 [E, N, 7]."""
        if self._missing is not None and self._last is not None:
            self._last[:, self.sent], self._missing = self._missing, None
        return self._last

    def put_before(self, poses: np.ndarray) -> None:
        """Puts checked poses into `before`."""
        self._together = False
        self._write(self.before, poses, self._slots)

    def advance(self, fresh: np.ndarray) -> None:
        """Takes checked poses float64 [E, M, 7] of the bodies `sent`: `arrive` then makes `now` `before`, and them
        `now`."""
        assert self._last is not None
        if self.sparse and not self._together:
            wp.copy(self.before, self.now)
        turn = next(self._turns)
        self._together, self.coming = True, 1 + turn
        if self._device.is_cpu:
            self._latest = self._landing.numpy()
            self._latest[...] = fresh
            self.settle()
            return
        if self._read:
            _, view, done = self._read[turn]
            wp.synchronize_event(done)
            view[...] = fresh
        else:
            view = self._write(self._landing, fresh, self._copied)
        self._latest = view
        if self.sparse:
            # Of many bodies in many environments hardly anybody asks for this.
            self._missing = view
        else:
            self._last = view

    def latest(self) -> np.ndarray:
        """Gives the poses float64 [E, M, 7] in `last` of the bodies `sent`."""
        if self._latest is not None:
            return self._latest
        assert self.last is not None
        return self.last.take(self.sent, axis=1)

    def arrive(self) -> None:
        """Moves what is `coming` into `now`: a launch only; then call `arrived`, also after what was recorded of it."""
        if self.coming:
            fresh = self._fresh[self.coming - 1]
            wp.launch(move_bodies, dim=fresh.shape, inputs=[fresh, self._which, *self._poses], device=self._device)

    def arrived(self) -> None:
        """Notes that what was `coming` is there for all that is launched from now on."""
        if self.coming and self._read:
            self._device.stream.record_event(self._read[self.coming - 1][2])
        self.coming = 0

    def settle(self) -> None:
        """Makes what is `coming` arrive now."""
        self.arrive()
        self.arrived()

    def _buffers(self, shape: tuple[int, ...], count: int) -> list[Any]:
        """Makes pinned arrays, their views, and events after which they may be written; none on a CPU."""
        slots = []
        for _ in range(0 if self._device.is_cpu else count):
            buffer = wp.empty(shape, dtype=wp.transformd, device="cpu", pinned=True)
            slots.append((buffer, buffer.numpy(), wp.Event(self._device)))
            self._device.stream.record_event(slots[-1][2])
        return slots

    def _write(self, target: wp.array, poses: np.ndarray, slots: Any) -> np.ndarray:
        if self._views:
            view = self._views[id(target)]
            view[...] = poses
            return view
        buffer, view, sent = next(slots)
        wp.synchronize_event(sent)
        # In pieces, so that one is on its way while the next is written.
        parts = min(len(poses), 1 + poses.nbytes // PIECE)
        edges = edges_of(len(poses), parts)
        for first, last in pairwise(edges):
            view[first:last] = poses[first:last]
            start, count = first * poses.shape[1], (last - first) * poses.shape[1]
            wp.copy(target, buffer, start, start, count)
        self._device.stream.record_event(sent)
        return view


def numbers(poses: wp.array, device: Any) -> wp.array:
    """Gives the memory of poses [E, N] as float64 [E, N, 7] for kernels of a device, which reads pinned memory too."""
    there: wp.array = wp.array(ptr=poses.ptr, dtype=wp.float64, shape=(*poses.shape, 7), device=device)
    return there
