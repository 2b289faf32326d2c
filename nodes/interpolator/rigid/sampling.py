"""Chooses in proportion to a pixel's displacement which sub-frames are looked up, and which lie between two
that are.

This is for a CPU; a GPU looks up all. See plan_kernels. After the first samples every span whose ends differ by too
much gets one in its middle, until none is left, so that what changes at once, a shadow's edge or a line on a surface,
is found to the sub-frame.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.runtime.workers import edges_of
from nodes.interpolator.relight.change import LightChange
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid import plan_kernels
from nodes.interpolator.rigid.body_motion_kernels import BodyMotion, find_body_motion
from nodes.interpolator.rigid.keyframes import PreparedKeyframe
from nodes.interpolator.rigid.layout import Layout
from nodes.interpolator.rigid.plan_kernels import make_plan, make_refine_plan
from nodes.renderer.raster.row_tiles import launch_in_threads
from nodes.renderer.raster.visibility import Visibility

SHORT = int(plan_kernels.SHORT)

CHUNK = 256
"""Pixels whose sub-frames are gone through together on a CPU: what their z-buffers take fits its first cache."""


@dataclass
class SubframeRange:
    """Holds a portion of the sub-frames: number of it; slots slot0 .. slot0 + count - 1 have sub-frames start + 1 ..;
    before: poses [E, N] and z-buffer [E, H, W] of sub-frame `start`; closed: keyframe B comes right after it."""

    number: int
    slot0: int
    count: int
    start: int
    closed: bool
    before: tuple[wp.array, wp.array]


@dataclass
class Todo:
    """Holds the pixels that are to be looked up.

    pixels: int32 indices into [count, E, h, w]; of band k from starts[k] to starts[k + 1], or, with starts None, as
    many as counts[at + k] says on the device. at: where in the counts the first band is.
    """

    pixels: wp.array
    starts: list[int] | None
    at: int


class Sampling:
    """Plans what is to be looked up of a portion of the sub-frames, in rounds: `plan`, then `refine` until it gives
    None."""

    def __init__(
        self,
        visibility: Visibility,
        pieces: wp.array,
        layout: Layout,
        pool: ThreadPoolExecutor | None,
        change: LightChange | None = None,
    ) -> None:
        """Takes who is seen, and who works on it. visibility: of the layout's environments x slots. pieces: body and
        patch of each triangle. pool: as many threads as share the visibility's rows. change: tells where light changes,
        if it can."""
        self._change: Any = change.kernel if change else Change()
        v = self._v = visibility
        envs, slots, step = layout.envs, layout.slots, layout.step
        self._pieces, self._envs, self._upsampling, self._pool = pieces, envs, layout.upsampling, pool
        self._step, self._ratio, self._on_device = step, layout.ratio, layout.on_device
        self.bands = len(v.row_tiles.parts)
        self._size = (v.shape[1] - 2 * v.margin, v.shape[2] - 2 * v.margin)
        inner = envs * self._size[0] * self._size[1]
        self._gain = pixels_per_radian(v)
        self._plan, self._refine = (
            make_plan(layout.channels, change.features if change else LightChanges()),
            make_refine_plan(layout.channels),
        )
        # Each round halves the spans, but for short ones, which it ends; the longest has all slots between its ends.
        self.rounds, longest = 1, slots + 1 if step > 0 else 0
        while longest > 1:
            self.rounds, longest = self.rounds + 1, -(-longest // 2) if longest > SHORT else 0
        bodies = len(v.names) + 2
        with wp.ScopedDevice(v.device):
            rows = (slots + 2) * envs
            self._motion = BodyMotion()
            self._motion.spin = wp.zeros((rows, bodies), dtype=wp.vec3)
            self._motion.shift = wp.zeros((rows, bodies), dtype=wp.vec3)
            self._motion.as_world = wp.zeros((envs, bodies), dtype=wp.int32)
            self._codes = wp.empty((slots, CHUNK * self.bands), dtype=wp.uint8)
            most = inner * (slots // 2 + 1) if step > 0 else 1
            # RowTiles write theirs beside each other, however short their spans are.
            self._todo = wp.empty(max(inner * slots, (SHORT - 1) * most * (self.bands > 1)), dtype=wp.int32)
            self._spans = [wp.empty(most * min(2, self.bands), dtype=wp.vec2i) for _ in range(2)]
            self.counts = wp.zeros(len(layout.portions) * self.rounds * self.bands, dtype=wp.int32)
            self._span_counts = wp.zeros_like(self.counts)
        self._lists: Any = plan_kernels.PlanLists()
        self._lists.todo, self._lists.todo_count = self._todo, self.counts
        self._lists.span_count = self._span_counts
        self._planned: Any = None

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        if self._on_device:
            return []
        made = [self._plan, *((find_body_motion, self._refine) if self._step > 0 else ())]
        return [(kernel, LAUNCH_BLOCK) for kernel in made]

    def clear(self) -> None:
        """Begins a gap."""
        self.counts.zero_()
        self._span_counts.zero_()

    def plan(self, part: SubframeRange, b: PreparedKeyframe, unchanged: wp.array, frames: wp.array) -> Todo:
        """Plans on a CPU the first samples, and finds where neither geometry nor light can have changed B's pixels in
        `frames`."""
        v, count = self._v, part.count
        self._part, self._frames, self._round = part, frames, 0
        poses, packed = part.before
        if self._step > 0:
            given = [v.camera_body, count, int(part.closed), part.slot0, poses, v.poses, b.poses]
            wp.launch(find_body_motion, self._motion.as_world.shape, given, [self._motion], device=v.device)
        active = self._changed(part, b, unchanged, frames)
        planned: Any = plan_kernels.PlannedRange()
        planned.count, planned.closed, planned.slot0, planned.start0 = count, int(part.closed), part.slot0, part.start
        planned.envs, planned.upsampling, planned.row_b = self._envs, self._upsampling, b.first
        planned.step, planned.gain, planned.motion = self._step, self._gain, self._motion
        planned.before, planned.packed, planned.after = packed, v.packed, b.packed
        planned.unchanged, planned.pieces = unchanged, self._pieces
        how: list[Any] = [planned, self._change, active, b.image]
        how += [self._codes, self._lists, frames]
        self._planned, self._lists.spans = planned, self._spans[0]
        at = self._at()
        starts = edges_of(active.size, self.bands)
        launches = []
        for k, (first, last) in enumerate(pairwise(starts)):
            band = part_of(first, last, at + k, first * count, first * (count // 2 + 1))
            given = [v.view, band, CHUNK, CHUNK * k]
            launches.append((self._plan, -(-(last - first) // CHUNK), [*given, *how]))
        self.launch(launches)
        self._joined = self._join(self._spans[0], self._span_counts, at, [s * (count // 2 + 1) for s in starts])
        return self._listed(at, [s * count for s in starts])

    def everything(self, part: SubframeRange) -> Todo:
        """Gives a list that is empty yet, for what is found to be listed while all is looked up."""
        self._part, self._round = part, 0
        return Todo(self._todo, None, self._at())

    def refine(self, a: PreparedKeyframe) -> Todo | None:
        """Draws lines where the samples of the round before allow it, and what is to be looked up where they do not."""
        self._round += 1
        if self._step == 0 or self._round == self.rounds:
            return None
        at, v = self._at(), self._v
        new = self._lists.spans = self._spans[self._round & 1]
        how = [self._ratio, self._planned]
        size = wp.vec2i(*self._size)
        spans = self._joined
        if not spans.size:
            return None
        starts = edges_of(spans.size, self.bands)
        launches = []
        for k, (first, last) in enumerate(pairwise(starts)):
            band = part_of(first, last, at + k, (SHORT - 1) * first, 2 * first)
            given = [size, v.margin, band, *how, spans, a.image, self._frames, self._lists]
            launches.append((self._refine, 1, given))
        self.launch(launches)
        self._joined = self._join(new, self._span_counts, at, [2 * s for s in starts])
        return self._listed(at, [(SHORT - 1) * s for s in starts])

    def _at(self) -> int:
        return (self._part.number * self.rounds + self._round) * self.bands

    def launch(self, launches: list[tuple[wp.Kernel, Any, list[Any]]], block: int = LAUNCH_BLOCK) -> None:
        """Launches kernels, for each band: (kernel, threads, arguments). block: threads of one on a GPU."""
        if self._pool is None:
            for kernel, dim, given in launches:
                wp.launch(kernel, dim, given, device=self._v.device, block_dim=block)
            return
        launch_in_threads(self._pool, launches)

    def _join(self, pieces: wp.array, counts: wp.array, at: int, starts: list[int]) -> wp.array:
        """Joins what the bands have listed from their `starts` on."""
        lengths = counts.numpy()[at : at + self.bands].tolist()
        if self.bands == 1:
            return pieces[: lengths[0]]
        values = pieces.numpy()
        joined = np.concatenate([values[s : s + n] for s, n in zip(starts, lengths)])
        return wp.array(joined, dtype=pieces.dtype, copy=False, device="cpu")

    def _listed(self, at: int, starts: list[int]) -> Todo:
        todo = self._join(self._todo, self.counts, at, starts)
        return Todo(todo, edges_of(todo.size, self.bands), at)

    def _changed(self, part: SubframeRange, b: PreparedKeyframe, unchanged: wp.array, frames: wp.array) -> wp.array:
        """Writes B into all frames, on a CPU, and lists the pixels int32 [n] of [E, h, w] where that is not what is
        always seen."""
        v, m, (height, width) = self._v, self._v.margin, self._size
        inner = (..., slice(m, m + height), slice(m, m + width))
        by_env = frames.numpy().reshape(self._envs, self._upsampling, height, width, -1)
        image = b.image.numpy()[:, m : m + height, m : m + width].reshape(self._envs, 1, height, width, -1)
        by_env[:, part.start : part.start + part.count] = image
        packed = v.packed.numpy().reshape(-1, self._envs, *v.shape[1:])
        still = unchanged.numpy()
        changed = packed[part.slot0] != still
        other = np.empty_like(changed)
        for slot in range(part.slot0 + 1, part.slot0 + part.count):
            np.logical_or(changed, np.not_equal(packed[slot], still, out=other), out=changed)
        return wp.array(np.flatnonzero(changed[inner]).astype(np.int32), copy=False, device="cpu")


def part_of(first: int, last: int, band: int, todo0: int, spans0: int) -> Any:
    """Makes the PlanPart of a band."""
    part: Any = plan_kernels.PlanPart()
    part.first, part.last, part.band, part.todo0, part.spans0 = first, last, band, todo0, spans0
    return part


def pixels_per_radian(v: Visibility) -> float:
    """Computes the most pixels per radian between neighbouring rays of a lens; 0 for a pinhole."""
    if not v.view.distorted:
        return 0.0
    rays = v.view.rays.numpy().astype(np.float64)
    least = np.inf
    for a, b in ((rays[:, 1:], rays[:, :-1]), (rays[1:], rays[:-1])):
        there = np.any(a, axis=-1) & np.any(b, axis=-1)
        least = min(least, np.linalg.norm(a - b, axis=-1)[there].min(initial=np.inf))
    return 1.0 / least
