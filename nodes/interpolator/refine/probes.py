"""Draws z-buffers between the coarse frames of a gap: the thinner and faster things are, the more of them."""

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
"""Z-buffers per gap: least, least per coarse interval, and most."""
ROOM = 1 << 25
"""Most pixels of all z-buffers of an environment."""
MISSED = 0.03
"""How often per pixel and gap something thin may pass between two z-buffers unseen, on average."""
SHORT_NS = 10_000
"""Time over which the speed of things in the image is measured [ns]."""


class Probes:
    """Draws the z-buffers of one gap after another.

    packed uint64 [rows, H, W]: at the middle of each coarse interval, then at its quarters, at its odd eighths, and so
    on, those of all coarse intervals at each level; see path_kernels.entry_at. each int32 [E]: how many parts they make
    of a coarse interval, by environment; most: the greatest of these.
    """

    def __init__(self, rigid: Rigid, threads: int) -> None:
        coarse, layout = rigid.visibility, rigid.layout
        self._rigid, self._envs, self._coarse = rigid, layout.envs, layout.upsampling
        self._least = least_of(layout.upsampling)
        # The least number that any gap has is drawn by one call.
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
        """Draws the z-buffers that a gap needs, after its coarse frames were drawn.

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
        """Computes into how many parts z-buffers must divide a coarse interval in each environment, int64 [E], 2^n."""
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
        """Computes how bodies move relative to the camera in SHORT_NS before coarse frames, at: [K] or [E, K] ns."""
        rigid, v, before = self._rigid, self._rigid.visibility, self._before
        before.begin(np.concatenate([at - SHORT_NS, at[..., -1:]], axis=-1), *states, held)
        # The last coarse frame, the keyframe, has the first slot.
        poses = np.repeat(before.rest[None], self._coarse, axis=0)
        poses[:, :, rigid.placement.movers] = np.roll(before.moved[:-1], 1, axis=0)
        then: wp.array = wp.array(poses.reshape(-1, *poses.shape[2:]), dtype=wp.transformd, device=v.device)
        given = [v.camera_body, v.poses, then]
        wp.launch(displace, self._turn.shape, given, [self._turn, self._shift], device=v.device)


def least_of(upsampling: int) -> int:
    """Gives the least number of parts of a coarse interval, 2^n, for K frames per gap."""
    wanted = max(LEAST_PER_FRAME, -(-LEAST // upsampling))
    return 1 << (wanted - 1).bit_length()


def order_of(instants: Instants, each: int) -> list[int]:
    """Lists the instants, counted from 0, of the `each` - 1 z-buffers inside every coarse interval: middles first."""
    length, order = 1 << instants.depth, []
    step = length
    while step > length // each:
        step //= 2
        inside = range(step, length, 2 * step)
        order += [k * length + i - 1 for k in range(instants.coarse) for i in inside]
    return order
