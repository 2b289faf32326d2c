"""Z-buffers between the coarse frames of a gap, as close in time as what moves in the image asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.cuda_graph import CudaGraphs
from nodes.interpolator.keyframe import States
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.probe_kernels import make_find_thin
from nodes.interpolator.refine.probing.strays import Strays
from nodes.interpolator.refine.probing.visits import Visits
from nodes.interpolator.rigid.displacement_kernels import displace
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.slots import Slots
from nodes.renderer.raster.visibility import Visibility

LEAST, LEAST_PER_FRAME, MOST = 8, 2, 1024
"""Times per gap at which it is found out what all pixels see: least, least per coarse interval, and most."""
AT_ONCE, FEWER = 32, 4
"""Z-buffers that are drawn at once, at most, where there is one environment, and how many times fewer the next smaller
size has: each size has memory of its own."""
ROOM = 1 << 25
"""Pixels of all these z-buffers of an environment, at most."""
MISSED = 0.03
"""How often something thin may pass a pixel unseen in a gap, on the average."""
MISSED_OF_ALL, OF_VISITS, FEW = 0.25, 0.1, 0.003
"""Part of what passes that may be unseen, and where something visits the image in between, unless that is few: so
often a pixel, on the average."""
RECORDED = 128
"""Z-buffers of a gap up to which a GPU keeps the launches that draw them: more are rare."""
SHORT_NS = 10_000
"""Time over which it is found how fast things are."""


class Probes:
    """Draws z-buffers at instants of one gap after another.

    packed uint64 [rows, H, W]: at the middle of each coarse interval, then at its quarters, at its odd eighths, and so
    on, all coarse intervals of a kind after each other; see stage_kernels.entry_at. each int32 [E]: how many there are
    per coarse interval, itself included, that an environment goes by; most: of all environments.
    """

    def __init__(self, rigid: Rigid, tolerance_ns: float, threads: int) -> None:
        coarse, layout = rigid.visibility, rigid.layout
        self._rigid, self._envs, self._coarse = rigid, layout.envs, layout.upsampling
        self._threads, self._least = threads, least_of(layout.upsampling)
        # What there is in any case is drawn at once.
        self._first = layout.upsampling * (self._least - 1)
        self._drawers: dict[int, tuple[Visibility, Slots]] = {}
        """By how many z-buffers of each environment they draw at once; made when there is use for them."""
        v = self._v = self._drawer(self._first)[0]
        self._before = Slots(coarse.scene, v, rigid.placement, self._first)
        self._find_thin = make_find_thin(v.lens)
        self._visits, self._graphs = Visits(v, rigid.placement), CudaGraphs(v.device)
        self._strays = Strays(v, rigid.placement, tolerance_ns)
        with wp.ScopedDevice(v.device):
            self.packed = wp.empty((0, *v.shape[1:]), dtype=wp.uint64)
            self.each = wp.zeros(self._envs, dtype=wp.int32)
        self.most = self._least
        self.unseen = np.zeros(self._envs, bool)
        """Whether an environment needs more than there may be."""

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that takes long to compile, as `build_together` takes it."""
        return [(self._find_thin, LAUNCH_BLOCK)]

    def _drawer(self, count: int) -> tuple[Visibility, Slots]:
        """Gives what draws `count` z-buffers of each environment at once."""
        if count not in self._drawers:
            coarse, placement = self._rigid.visibility, self._rigid.placement
            sparse = True if len(placement.movers) else None
            envs = self._envs * count
            v = Visibility(
                coarse.scene, coarse.camera, envs, coarse.margin, str(coarse.device), self._threads, sparse=sparse
            )
            self._drawers[count] = v, Slots(coarse.scene, v, placement, count)
        return self._drawers[count]

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
        rigid, coarse = self._rigid, self._coarse
        pixels = self._v.shape[1] * self._v.shape[2]
        self.unseen = np.zeros(self._envs, bool)
        shortest = 0 if held.all() else int(lengths[~held].min())
        # How fast things are is found over a time that is shorter than what lies between two of them.
        most = min(MOST, ROOM // pixels, shortest // (2 * SHORT_NS)) // coarse
        most = min(1 << max(most.bit_length() - 1, 0), 1 << instants.depth)
        least = min(self._least, 1 << instants.depth)
        if not len(rigid.placement.movers):
            each = np.full(self._envs, least)
            self._draw(instants, places, 1, least)
        else:
            most = max(most, least)
            # So many that what comes and goes is in some of them, then as many as what is in them needs.
            visits = self._visits.needed(instants, places, least)
            begun = np.where(held, least, np.minimum(visits, most))
            self._draw(instants, places, 1, int(begun.max()))
            # What is found on the host comes first: a GPU draws meanwhile, and is waited for then.
            strays = self._strays.needed(instants, places, shortest, least, most)
            each = self._needed(instants, stamps, lengths, places, states, held, begun, most)
            self.unseen |= (np.maximum(visits, strays) > most) & ~held
            each = np.where(held, each, np.maximum(each, np.minimum(strays, most)))
            self._draw(instants, places, int(begun.max()), int(each.max()))
        self.each.assign(each.astype(np.int32))
        self.most = int(each.max())

    def _draw(self, instants: Instants, places: Slots, drawn: int, each: int) -> None:
        """Draws `each` per coarse interval, of which `drawn` are there."""
        done = self._coarse * (drawn - 1)
        order = order_of(instants, each)
        rows, v = len(order) * self._envs, self._v
        if rows > self.packed.shape[0]:
            packed = wp.empty((rows, *v.shape[1:]), dtype=wp.uint64, device=v.device)
            if done:
                wp.copy(packed[: done * self._envs], self.packed[: done * self._envs])
            self.packed = packed
        while done < len(order):
            count = self._count(len(order) - done)
            v, mine = self._drawer(count)
            mine.moved, mine.before, mine.rest = places.moved, places.before, places.rest
            mine.place(order[done : done + count])
            v.settle()
            first, done = done * self._envs, done + count
            v.packed = self.packed[first : done * self._envs]
            if done <= RECORDED:
                self._graphs.run((count, v.packed.ptr, v.still_moved), v.draw)
            else:
                v.draw()
            v.drawn()

    def _count(self, left: int) -> int:
        """Gives how many z-buffers are drawn next: all if they are the first ones, else some of few sizes."""
        if left == self._first:
            return left
        # What is left is a multiple of the coarse intervals times a power of two.
        size = self._coarse
        while FEWER * size <= left and FEWER * size * self._envs <= AT_ONCE:
            size *= FEWER
        return size

    def _needed(
        self,
        instants: Instants,
        stamps: np.ndarray,
        lengths: np.ndarray,
        places: Slots,
        states: tuple[States, States],
        held: np.ndarray,
        begun: np.ndarray,
        most: int,
    ) -> np.ndarray:
        """How many z-buffers per coarse interval each environment needs, int64 [E], powers of two up to `most`. begun:
        how many of its own are drawn."""
        v, coarse, rigid = self._v, self._coarse, self._rigid
        pixels = v.shape[1] * v.shape[2]
        least = min(self._least, 1 << instants.depth)
        levels = (most // least).bit_length()
        parts = {row0: k for k, (row0, _) in enumerate(v.row_tiles.parts)}
        missed: wp.array = wp.zeros((len(parts), self._envs, levels + 1), dtype=wp.int64, device=v.device)
        span = v.shape[2] if v.device.is_cpu else 1
        gaps: wp.array = wp.array((lengths / SHORT_NS).astype(np.float32), device=v.device)
        # Coarse frames tell, but for what is in the image between them alone.
        looked_at = coarse * np.where(begun > least, begun, 1)
        own: wp.array = wp.array(np.where(held, 0, looked_at).astype(np.int32), device=v.device)
        length = 1 << instants.depth
        # The last one, the keyframe, has the first slot.
        frames = [coarse * length - 1, *range(length - 1, (coarse - 1) * length, length)]
        between = order_of(instants, int(looked_at.max()) // coarse)
        for first, which, packed in ((0, frames, rigid.visibility.packed), (coarse, between, self.packed)):
            rows = len(which) * self._envs
            if not rows:
                continue
            turn, shift = self._displaced(which, stamps, places, states, held)
            where = [v.view, self._envs, first * self._envs]
            what = [span, gaps, least * coarse, own, turn, shift, rigid.pieces, v.triangle_instance, packed]

            def of_rows(
                y0: int, y1: int, rows: int = rows, where: list[Any] = where, what: list[Any] = what
            ) -> tuple[Any, list[Any]]:
                dim = (rows, y1 - y0, v.shape[2] // span)
                return dim, [*where, y0, *what, missed[parts[y0]]]

            v.row_tiles.launch(self._find_thin, of_rows, v.device, in_parts=True)
        found = missed.numpy().sum(axis=0)
        unseen, all_of_it = found[:, :-1], found[:, -1:]
        of_all = np.where(begun > least, OF_VISITS, MISSED_OF_ALL)[:, None]
        once = pixels * looked_at[:, None]
        enough = (unseen <= MISSED * once) & ((unseen <= of_all * all_of_it) | (unseen <= FEW * once))
        self.unseen = ~enough[:, -1] & ~held
        enough[:, -1] = True
        return np.maximum(least << enough.argmax(axis=1), begun)

    def _displaced(
        self, which: list[int], stamps: np.ndarray, places: Slots, states: tuple[States, States], held: np.ndarray
    ) -> tuple[wp.array, wp.array]:
        """How bodies move against the camera in the short time before each of some instants, counted from 0."""
        rigid, v, before = self._rigid, self._v, self._before
        movers = rigid.placement.movers
        at = stamps[..., which] - SHORT_NS
        ascending = np.argsort(which)
        before.begin(np.concatenate([at[..., ascending], stamps[..., -1:]], axis=-1), *states, held)
        then, now = (np.repeat(before.rest[None], len(which), axis=0) for _ in range(2))
        then[ascending[:, None], :, movers] = before.moved[:-1].swapaxes(1, 2)
        now[:, :, movers] = places.moved[which]
        rows = len(which) * self._envs
        given: list[Any] = [wp.array(p.reshape(rows, -1, 7), dtype=wp.transformd, device=v.device) for p in (now, then)]
        with wp.ScopedDevice(v.device):
            turn = wp.empty((rows, now.shape[2] + 2), dtype=wp.mat33)
            shift = wp.empty((rows, now.shape[2] + 2), dtype=wp.vec3)
            wp.launch(displace, turn.shape, [v.camera_body, *given], [turn, shift])
        return turn, shift


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
