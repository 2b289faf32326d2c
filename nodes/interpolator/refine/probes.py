"""Z-buffers between the coarse frames of a gap, as close in time as what moves in the image asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import States
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probe_kernels import make_find_thin
from nodes.interpolator.rigid.displacement_kernels import displace
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.slots import Slots
from nodes.renderer.raster.visibility import Visibility

LEAST, LEAST_PER_FRAME, MOST = 16, 2, 1024
"""Times per gap at which it is found out what all pixels see: least, least per coarse interval, and most."""
ROOM = 1 << 25
"""Pixels of all these z-buffers of an environment, at most."""
MISSED = 0.03
"""How often something thin may pass a pixel unseen in a gap, on the average."""
SHORT_NS = 10_000
"""Time over which it is found how fast things are."""


class Probes:
    """Draws z-buffers at instants of one gap after another.

    packed uint64 [rows, H, W]: at the middle of each coarse interval, then at its quarters, at its odd eighths, and so
    on, all coarse intervals of a kind after each other; see path_kernels.entry_at. each int32 [E]: how many there are
    per coarse interval, itself included, that an environment goes by; most: of all environments.
    """

    def __init__(self, rigid: Rigid, threads: int) -> None:
        coarse, layout = rigid.visibility, rigid.layout
        self._rigid, self._envs, self._coarse = rigid, layout.envs, layout.upsampling
        self._least = least_of(layout.upsampling)
        # What there is in any case is drawn at once.
        self._at_once = layout.upsampling * (self._least - 1)
        sparse = True if len(rigid.placement.movers) else None
        v = self._v = Visibility(
            coarse.scene, coarse.camera, self._envs * self._at_once, coarse.margin, str(coarse.device), threads,
            sparse=sparse,
        )  # fmt: skip
        self._places = Slots(coarse.scene, v, rigid.placement, self._at_once)
        self._before = Slots(coarse.scene, v, rigid.placement, self._at_once)
        self._find_thin = make_find_thin(v.lens)
        rows, bodies = self._envs * self._coarse, len(v.names)
        with wp.ScopedDevice(v.device):
            self.packed = wp.empty((0, *v.shape[1:]), dtype=wp.uint64)
            self._turn = wp.empty((rows, bodies + 2), dtype=wp.mat33)
            self._shift = wp.empty((rows, bodies + 2), dtype=wp.vec3)
            self.each = wp.zeros(self._envs, dtype=wp.int32)
        self.most = self._least

    def draw(
        self,
        instants: Instants,
        stamps: np.ndarray,
        lengths: np.ndarray,
        places: Slots,
        states: tuple[States, States],
        held: np.ndarray,
    ) -> None:
        """Draws what a gap needs, whose coarse frames are drawn.

        stamps: of its instants, int64 [n] or [E, n] ns. lengths: of the gap, int64 [E] ns. places: at all instants.
        states: to the keyframes at its start and at its end. held: bool [E], environments that have no gap.
        """
        each = self._needed(instants, stamps, lengths, states, held)
        self.each.assign(each.astype(np.int32))
        self.most = int(each.max())
        order = order_of(instants, self.most)
        chunks = -(-len(order) // self._at_once)
        order += order[-1:] * (chunks * self._at_once - len(order))
        rows = len(order) * self._envs
        v = self._v
        if rows > self.packed.shape[0]:
            self.packed = wp.empty((rows, *v.shape[1:]), dtype=wp.uint64, device=v.device)
        mine = self._places
        mine.moved, mine.before, mine.rest = places.moved, places.before, places.rest
        each_rows = self._at_once * self._envs
        for n in range(chunks):
            mine.place(order[n * self._at_once : (n + 1) * self._at_once])
            v.settle()
            v.packed = self.packed[n * each_rows : (n + 1) * each_rows]
            v.draw()
            v.drawn()

    def _needed(
        self,
        instants: Instants,
        stamps: np.ndarray,
        lengths: np.ndarray,
        states: tuple[States, States],
        held: np.ndarray,
    ) -> np.ndarray:
        """How many z-buffers per coarse interval each environment needs, int64 [E], powers of two."""
        v, coarse, rigid = self._v, self._coarse, self._rigid
        pixels = v.shape[1] * v.shape[2]
        most = min(MOST, ROOM // pixels) // coarse
        most = min(1 << max(most.bit_length() - 1, 0), 1 << instants.depth)
        least = min(self._least, 1 << instants.depth)
        levels = max(most // least, 1).bit_length()
        short = held.all() or lengths[~held].min() < 2 * coarse * SHORT_NS
        if levels == 1 or short or not len(rigid.placement.movers):
            return np.full(self._envs, least)
        at = stamps[..., (1 << instants.depth) - 1 :: 1 << instants.depth]
        self._displace(at, states, held)
        missed: wp.array = wp.zeros((self._envs, levels), dtype=wp.int64, device=v.device)
        span = v.shape[2] if v.device.is_cpu else 1
        gaps: wp.array = wp.array((lengths / SHORT_NS).astype(np.float32), device=v.device)
        begun: wp.array = wp.array(held.astype(np.int32), device=v.device)
        given: list[Any] = [v.view, self._envs, span, gaps, least * coarse, begun, self._turn, self._shift]
        given += [rigid.pieces, v.triangle_instance, rigid.visibility.packed]
        dim = (self._envs * coarse, v.shape[1], v.shape[2] // span)
        wp.launch(self._find_thin, dim, given, [missed], device=v.device)
        enough = missed.numpy() <= MISSED * pixels * coarse
        enough[:, -1] = True
        return least << enough.argmax(axis=1)

    def _displace(self, at: np.ndarray, states: tuple[States, States], held: np.ndarray) -> None:
        """How bodies move against the camera in the short time before each coarse frame, stamps [K] or [E, K] ns."""
        rigid, v, before = self._rigid, self._rigid.visibility, self._before
        before.begin(np.concatenate([at - SHORT_NS, at[..., -1:]], axis=-1), *states, held)
        # The last coarse frame, the keyframe, has the first slot.
        poses = np.repeat(before.rest[None], self._coarse, axis=0)
        poses[:, :, rigid.placement.movers] = np.roll(before.moved[:-1], 1, axis=0)
        then: wp.array = wp.array(poses.reshape(-1, *poses.shape[2:]), dtype=wp.transformd, device=v.device)
        given = [v.camera_body, v.poses, then]
        wp.launch(displace, self._turn.shape, given, [self._turn, self._shift], device=v.device)


def least_of(upsampling: int) -> int:
    """Gives the least z-buffers per coarse interval, a power of two, for K frames per gap."""
    wanted = max(LEAST_PER_FRAME, -(-LEAST // upsampling))
    return 1 << (wanted - 1).bit_length()


def order_of(instants: Instants, each: int) -> list[int]:
    """Lists the instants, counted from 0, of `each` - 1 z-buffers within every coarse interval: middles first."""
    length, order = 1 << instants.depth, []
    step = length
    while step > length // each:
        step //= 2
        inside = range(step, length, 2 * step)
        order += [k * length + i - 1 for k in range(instants.coarse) for i in inside]
    return order
