"""Draws z-buffers between the coarse frames of a gap, as close in time as what moves in the image asks for."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.cuda_graph import CudaGraphs
from nodes.interpolator.keyframe import Span
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.brief_appearances import BriefAppearances
from nodes.interpolator.refine.probing.camera_motion import displaced_against_camera, faster_between
from nodes.interpolator.refine.probing.curved_motion import CurvedMotion
from nodes.interpolator.refine.probing.probe_kernels import count_single_appearances
from nodes.interpolator.refine.probing.thin_kernels import make_find_thin
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.slots import Poses, Slots
from nodes.renderer.raster.visibility import Visibility

LEAST, LEAST_PER_FRAME, MOST = 8, 2, 1024
"""Times per gap at which it is found out what all pixels see: least, least per coarse interval, and most."""
AT_ONCE, FEWER = 32, 4
"""Z-buffers that are drawn at once, at most, where there is one environment, and how many times fewer the next smaller
size has: each size has memory of its own."""
ROOM = 1 << 25
"""Pixels of all these z-buffers of an environment, at most."""
MISSED = 0.03
"""How often something thin, or a swing of what is painted, may pass a pixel unseen in a gap, on the average, without
being told."""
MISSED_OF_ALL, OF_VISITS, FEW = 0.25, 0.1, 0.003
"""Part of what passes that may be unseen, and where something visits the image in between, unless that is few: so
often a pixel, on the average."""
AS_WANTED_NS = 300_000.0
"""Tolerance of time from which on z-buffers are as many as MISSED, MISSED_OF_ALL, OF_VISITS and FEW ask for. With a
closer one these are as many times less: what passes unseen is then most of what is lost."""
TOLD_OF = 0.05
"""Part of what passes that may be unseen without being told where z-buffers are as close as they can be."""
BRIEF = 2
"""How many times more often things are seen in one z-buffer alone than in none, where all times are as frequent for
which they are on a pixel."""
RECORDED = 128
"""Z-buffers of a gap up to which a GPU keeps the launches that draw them: more are rare."""
SHORT_NS = 10_000
"""Time over which it is found how fast things are."""


@dataclass(frozen=True)
class ProbeForecast:
    """Holds what is known of a gap's z-buffers before any is drawn.

    least, most: per coarse interval. begun [E]: how many are drawn at first. looked_at [E]: of the gap, those in which
    it is found how many are needed. wanted [E]: how many brief appearances, narrow things and curved motion need for
    nothing to be told.
    visits, passing bool [E]: whether something is in the image between two frames alone, and whether something passes
    the near plane; swept bool [E]: so fast that instants show too little of it. pairs: poses of all bodies then and a
    short time before, float64 [n E, N, 7], of the frames and, where it is found there, between them.
    """

    least: int
    most: int
    begun: np.ndarray
    looked_at: np.ndarray
    wanted: np.ndarray
    visits: np.ndarray
    passing: np.ndarray
    swept: np.ndarray
    pairs: list[tuple[np.ndarray, np.ndarray]]


class Probes:
    """Draws z-buffers at instants of one gap after another.

    packed uint64 [rows, H, W]: at the middle of each coarse interval, then at its quarters, at its odd eighths, and so
    on, all coarse intervals of a kind after each other; see `probe_image`. each int32 [E]: how many there are
    per coarse interval, itself included, that an environment goes by; most: of all environments.
    """

    def __init__(self, rigid: Rigid, tolerance_ns: float, threads: int) -> None:
        coarse, layout = rigid.visibility, rigid.layout
        self._rigid, self._envs, self._coarse = rigid, layout.envs, layout.upsampling
        self._threads, self._least = threads, least_of(layout.upsampling)
        # What there is in any case is drawn at once.
        self._first = layout.upsampling * (self._least - 1)
        self._strict = min(tolerance_ns / AS_WANTED_NS, 1.0)
        self._drawers: dict[int, tuple[Visibility, Slots]] = {}
        """By how many z-buffers of each environment they draw at once; made when there is use for them."""
        v = self._v = self._drawer(self._first)[0]
        self._before = Slots(coarse.scene, v, rigid.placement, self._first)
        self._find_thin = make_find_thin(v.lens)
        self._appearances, self._graphs = BriefAppearances(v, rigid.placement), CudaGraphs(v.device)
        self._curved_motion = CurvedMotion(v, rigid.placement, tolerance_ns)
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

    def foresee(
        self, instants: Instants, stamps: np.ndarray, poses: Poses, gap: Span, beside: Executor | None
    ) -> ProbeForecast | None:
        """Works out what the bodies' motion alone tells of a gap; None where nothing moves.

        stamps: of its instants, int64 [n] or [E, n] ns. poses: at all of them. beside: threads that do some of it.
        """
        rigid, coarse, held = self._rigid, self._coarse, gap.held
        if not len(rigid.placement.movers):
            return None
        pixels = self._v.shape[1] * self._v.shape[2]
        shortest = 0 if held.all() else int((gap.ends - gap.starts)[~held].min())
        # How fast things are is found over a time that is shorter than what lies between two of them.
        most = min(MOST, ROOM // pixels, shortest // (2 * SHORT_NS)) // coarse
        most = min(1 << max(most.bit_length() - 1, 0), 1 << instants.depth)
        least = min(self._least, 1 << instants.depth)
        most = max(most, least)
        # So many that what comes and goes is in some of them and goes straight from one to the next, then as many as
        # what is in them needs.
        off = partial(self._curved_motion.needed, instants, poses, shortest, least, most)
        later = None if beside is None else beside.submit(off)
        brief = self._appearances.needed(instants, poses, least, self._strict * MISSED, MISSED)
        curved = off() if later is None else later.result()
        wanted = np.maximum(np.maximum(brief.visits, curved), brief.narrow_told)
        begun = np.where(held, least, np.minimum(np.maximum(wanted, brief.narrow), most))
        # Coarse frames tell, but for what is in the image between them alone, or is faster there than at them.
        looked_at = coarse * np.where(begun > least, begun, 1)
        length = 1 << instants.depth
        # The last one, the keyframe, has the first slot.
        frames = [coarse * length - 1, *range(length - 1, (coarse - 1) * length, length)]
        between = order_of(instants, int(looked_at.max()) // coarse)
        pairs = [self._shortly_before(which, stamps, poses, gap) for which in (frames, between) if which]
        if between:
            looked_at = np.where(
                (brief.visits > least) | faster_between(pairs[0], pairs[1], self._v.camera_body, self._envs),
                looked_at,
                coarse,
            )
            pairs = pairs[: 2 if looked_at.max() > coarse else 1]
        passing, swept = brief.passing & ~held, brief.swept & ~held
        return ProbeForecast(least, most, begun, looked_at, wanted, brief.visits > least, passing, swept, pairs)

    def draw(
        self, ahead: ProbeForecast | None, instants: Instants, poses: Poses, gap: Span, albedo_scale: wp.array
    ) -> None:
        """Draws what a gap needs, whose coarse frames are drawn.

        ahead: as of `foresee`. albedo_scale: as of albedo_scale_of.
        """
        held = gap.held
        self.unseen = np.zeros(self._envs, bool)
        if ahead is None:
            least = min(self._least, 1 << instants.depth)
            each = np.full(self._envs, least)
            self._draw(instants, poses, 1, least)
        else:
            begun = int(ahead.begun.max())
            self._draw(instants, poses, 1, begun)
            each = self._needed(ahead, instants, gap, albedo_scale)
            self.unseen |= ((ahead.wanted > ahead.most) & ~held) | ahead.swept
            self._draw(instants, poses, begun, int(each.max()))
            each = self._draw_single_appearances(ahead, instants, poses, each)
        self.each.assign(each.astype(np.int32))
        self.most = int(each.max())

    def _draw(self, instants: Instants, poses: Poses, drawn: int, each: int) -> None:
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
            mine.poses = poses
            mine.place(order[done : done + count])
            v.settle()
            first, done = done * self._envs, done + count
            v.packed = self.packed[first : done * self._envs]
            if done <= RECORDED:
                self._graphs.run((count, v.packed.ptr, v.still_moved), v.draw)
            else:
                v.draw()
            v.drawn()

    def _draw_single_appearances(
        self, ahead: ProbeForecast, instants: Instants, poses: Poses, each: np.ndarray
    ) -> np.ndarray:
        """Draws more z-buffers where something passes the near plane, until few pixels show a body in one alone.

        What passes it has no edge there whose speed would tell for how long it is on a pixel.

        each: z-buffers per coarse interval that are drawn, int64 [E]; returns their number afterwards.
        """
        v, asked = self._v, ahead.passing
        limit = BRIEF * MISSED * v.shape[1] * v.shape[2]
        while asked.any():
            with wp.ScopedDevice(v.device):
                appearances: wp.array = wp.zeros(self._envs, dtype=wp.int32)
                given: list[wp.array] = [wp.array(a.astype(np.int32), dtype=wp.int32) for a in (asked, each)]
            pair, frames = self._rigid.pair, self._rigid.visibility.packed
            what = [self._coarse, *given, self._rigid.pieces, pair.a.packed, frames, self.packed]
            wp.launch(count_single_appearances, (self._envs, *v.shape[1:]), what, [appearances], device=v.device)
            counted = appearances.numpy()
            self.unseen |= asked & (counted > limit) & (each >= ahead.most)
            asked = asked & (counted > self._strict * limit) & (each < ahead.most)
            drawn, each = int(each.max()), np.where(asked, 2 * each, each)
            if each.max() > drawn:
                self._draw(instants, poses, drawn, int(each.max()))
        return each

    def _count(self, left: int) -> int:
        """Gives how many z-buffers are drawn next: all if they are the first ones, else some of few sizes."""
        if left == self._first:
            return left
        # What is left is a multiple of the coarse intervals times a power of two.
        size = self._coarse
        while FEWER * size <= left and FEWER * size * self._envs <= AT_ONCE:
            size *= FEWER
        return size

    def _needed(self, ahead: ProbeForecast, instants: Instants, gap: Span, albedo_scale: wp.array) -> np.ndarray:
        """Computes how many z-buffers per coarse interval each environment needs for what is in those that are drawn,
        int64 [E], powers of two up to the most. What is painted on things needs none, but may pass between two
        instants."""
        v, coarse, rigid, held = self._v, self._coarse, self._rigid, gap.held
        pixels = v.shape[1] * v.shape[2]
        levels = (ahead.most // ahead.least).bit_length()
        parts = {row0: k for k, (row0, _) in enumerate(v.row_tiles.parts)}
        missed: wp.array = wp.zeros((len(parts), self._envs, levels + 2), dtype=wp.int64, device=v.device)
        span = v.shape[2] if v.device.is_cpu else 1
        gaps: wp.array = wp.array(((gap.ends - gap.starts) / SHORT_NS).astype(np.float32), device=v.device)
        own: wp.array = wp.array(np.where(held, 0, ahead.looked_at).astype(np.int32), device=v.device)
        for first, (now, then), packed in zip((0, coarse), ahead.pairs, (rigid.visibility.packed, self.packed)):
            rows = now.shape[0]
            motions = displaced_against_camera(now, then, v.camera_body, v.device)
            where = [v.view, self._envs, first * self._envs]
            what = [span, gaps, ahead.least * coarse, instants.count, own, motions]
            what += [rigid.pieces, v.triangle_instance, albedo_scale, packed]

            def of_rows(
                y0: int, y1: int, rows: int = rows, where: list[Any] = where, what: list[Any] = what
            ) -> tuple[Any, list[Any]]:
                dim = (rows, y1 - y0, v.shape[2] // span)
                return dim, [*where, y0, *what, missed[parts[y0]]]

            v.row_tiles.launch(self._find_thin, of_rows, v.device, in_parts=True)
        found = missed.numpy().sum(axis=0)
        unseen, all_of_it, painted = found[:, :-2], found[:, -2:-1], found[:, -1:]
        of_all = np.where(ahead.visits, OF_VISITS, MISSED_OF_ALL)[:, None]
        once = pixels * ahead.looked_at[:, None]
        relative = np.maximum(of_all * all_of_it, FEW * once)
        allowed = np.minimum(MISSED * once, relative)
        enough = unseen <= self._strict * allowed
        told = np.minimum(allowed, np.maximum(TOLD_OF * all_of_it, FEW * once))
        self.unseen = ~((unseen[:, -1:] <= told) & (painted <= MISSED * once))[:, 0] & ~held
        enough[:, -1] = True
        return np.maximum(ahead.least << enough.argmax(axis=1), ahead.begun)

    def _shortly_before(
        self, which: list[int], stamps: np.ndarray, poses: Poses, gap: Span
    ) -> tuple[np.ndarray, np.ndarray]:
        """Finds all bodies' poses at some instants, counted from 0, and shortly before each, float64 [n E, N, 7]."""
        movers, ascending = self._rigid.placement.movers, np.argsort(which)
        at = (stamps[..., which] - SHORT_NS)[..., ascending]
        then, now = (np.repeat(poses.rest[None], len(which), axis=0) for _ in range(2))
        moved = self._before.find(np.concatenate([at, stamps[..., -1:]], axis=-1), gap.a, gap.b, gap.held).moved
        then[ascending[:, None], :, movers] = moved[:-1].swapaxes(1, 2)
        now[:, :, movers] = poses.moved[which]
        return now.reshape(-1, *now.shape[2:]), then.reshape(-1, *then.shape[2:])


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
