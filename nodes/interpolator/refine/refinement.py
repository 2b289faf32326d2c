"""Rounds of refinement: intervals of single pixels are cut until they are straight, or as short as is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import KeyframeView, own_subframes
from nodes.interpolator.refine.evaluator import Evaluator
from nodes.interpolator.refine.further_kernels import count_samples, make_sort, place_samples
from nodes.interpolator.refine.instants import Instants, instants_of
from nodes.interpolator.refine.interval_kernels import make_intervals, make_rounds
from nodes.interpolator.refine.suspect_kernels import Cut
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.samples import Further

PART = 0.5
"""Part of the tolerance of ln I that the ends of an interval may differ by, and its middle be off a straight line."""
BLIND = 8
"""Part of a coarse interval up to which what lies between two surfaces that are alike does not matter."""


class Lists:
    """Holds intervals on a device, as many as there is need of."""

    def __init__(self, channels: int, device: Any) -> None:
        self._pixel: Any = wp.float32 if channels == 1 else wp.vec3
        self.kernel: Any = make_intervals(channels)()
        self._device, self.size = device, 0

    def reserve(self, size: int) -> None:
        """Makes room; what is there is lost where there is none."""
        if size > self.size:
            self.size = size + size // 2
            types = {
                "at": wp.int32,
                "ends": wp.int32,
                "first": self._pixel,
                "last": self._pixel,
                "before": wp.uint64,
                "after": wp.uint64,
            }
            for name, dtype in types.items():
                setattr(self.kernel, name, wp.empty(self.size, dtype=dtype, device=self._device))


class Refinement:
    """Finds further samples of single pixels between the frames that a `Rigid` has just made."""

    def __init__(self, rigid: Rigid, tolerance_ns: float, threads: int, light_samples: int) -> None:
        """tolerance_ns: of the time of a crossing."""
        self._rigid, self._tolerance_ns = rigid, tolerance_ns
        self._threads, self._light_samples = threads, light_samples
        layout = rigid.layout
        v = rigid.visibility
        self._device, self._pixels = v.device, layout.envs * v.shape[1] * v.shape[2]
        self._evaluators: dict[int, Evaluator] = {}
        self._begin, self._see, self._split = make_rounds(v.lens, layout.channels, layout.exact_flicker)
        self._sort = make_sort(layout.channels)
        self._lists = [Lists(layout.channels, v.device) for _ in range(2)]
        self._pixel: Any = wp.float32 if layout.channels == 1 else wp.vec3
        self._made: list[wp.array] = [wp.empty(0, dtype=t, device=v.device) for t in (int, int, self._pixel)]
        self._held = wp.zeros(layout.envs, dtype=wp.int32, device=v.device)
        self.evaluated = self.shaded = 0
        """Samples of the last gap, and those of them that were shaded."""
        self.reached = True
        """Whether these are as close as the tolerance of time asks for, where need be."""

    def further(self, a: KeyframeView, b: KeyframeView, held: np.ndarray, frames: wp.array) -> Further | None:
        """Gives samples between the frames [E K, h, w] of the gap just made, None where there are none."""
        rigid = self._rigid
        envs = rigid.layout.envs
        starts, ends = a.times(envs), b.times(envs)
        gap = int((ends - starts)[~held].max(initial=0))
        self.evaluated = self.shaded = 0
        instants = instants_of(gap, rigid.layout.upsampling, self._tolerance_ns, self._pixels)
        self.reached = instants.reached and gap < 1 << 31
        if gap <= 0 or gap >= 1 << 31 or instants.depth == 0:
            return None
        if a.own is None and b.own is None:
            stamps = instants.stamps(a.stamp_ns, b.stamp_ns)
        else:
            stamps = own_subframes(a, b, held, instants.count)
        evaluator = self._evaluator(instants)
        assert a.states is not None and b.states is not None
        evaluator.begin(stamps, a.states, b.states, held)
        self._held.assign(held.astype(np.int32))
        total = 0
        for first, last in instants.windows():
            total = self._window(instants, evaluator, first, last, frames, total)
        self.evaluated, self.shaded = total, evaluator.shaded
        since = np.broadcast_to(stamps, (envs, instants.count)) - starts[:, None]
        return self._sorted(total, since.astype(np.int32)) if total else None

    def _evaluator(self, instants: Instants) -> Evaluator:
        """The evaluator with that many slots; gaps differ by a nanosecond, and hardly ever by more."""
        if instants.slots not in self._evaluators:
            self._evaluators = {
                instants.slots: Evaluator(self._rigid, instants.slots, self._threads, self._light_samples)
            }
        return self._evaluators[instants.slots]

    def _window(
        self, instants: Instants, evaluator: Evaluator, first: int, last: int, frames: wp.array, total: int
    ) -> int:
        """Refines coarse intervals first .. last - 1. Gives how many samples there are then, `total` before."""
        starts, counts = self._coarse(instants, evaluator, first, last, frames)
        if not any(counts):
            return total
        evaluator.place(instants.of_window(first), instants.count)
        cut = self._cut(instants, evaluator)
        v = evaluator.visibility
        here, there = self._lists
        while any(counts):
            ends = [start + count for start, count in zip(starts, counts)]
            bands = [(k, *pair) for k, pair in enumerate(zip(starts, ends)) if pair[1] > pair[0]]
            evaluator.reserve(max(ends))
            given: list[tuple[Any, int, list[Any]]] = []
            for _, start, end in bands:
                threads = 1 if v.device.is_cpu else end - start
                inputs = [v.view, cut, first, instants.coarse, start, end, threads, self._rigid.visibility.packed]
                inputs += [evaluator.targets, here.kernel, evaluator.hits]
                given.append((self._see, threads, inputs))
            self._rigid.sampling.launch(given)
            evaluator.evaluate(here.kernel.at, starts, counts)
            known = (total + np.concatenate([[0], np.cumsum(counts)])).tolist()
            self._reserve(known[-1], total)
            rooms = (2 * np.concatenate([[0], np.cumsum(counts)])).tolist()
            there.reserve(rooms[-1])
            found = wp.zeros(evaluator.bands, dtype=wp.int32, device=v.device)
            given = []
            for k, start, end in bands:
                threads = 1 if v.device.is_cpu else end - start
                inputs = [cut, first << instants.depth, instants.coarse, start, end, threads, known[k], rooms[k], k]
                inputs += [
                    self._rigid.pieces,
                    self._rigid.visibility.packed,
                    evaluator.hits,
                    evaluator.values,
                    here.kernel,
                    *self._made,
                ]
                given.append((self._split, threads, [*inputs, there.kernel, found]))
            self._rigid.sampling.launch(given)
            total = known[-1]
            starts, counts = rooms[:-1], found.numpy().tolist()
            here, there = there, here
        return total

    def _coarse(
        self, instants: Instants, evaluator: Evaluator, first: int, last: int, frames: wp.array
    ) -> tuple[list[int], list[int]]:
        """Lists the coarse intervals first .. last - 1 that are to be cut, by band: where they start, and counts."""
        rigid, v = self._rigid, evaluator.visibility
        height, width = evaluator.size
        cut, envs = self._cut(instants, evaluator), rigid.layout.envs
        edges = [height * k // evaluator.bands for k in range(evaluator.bands + 1)]
        starts = [envs * edge * width * (last - first) for edge in edges]
        lists, found = self._lists[0], wp.zeros(evaluator.bands, dtype=wp.int32, device=v.device)
        lists.reserve(starts[-1])
        span = width if v.device.is_cpu else 1
        given = []
        for k in range(evaluator.bands):
            inputs = [v.view, cut, edges[k], span, wp.vec2i(first, last), instants.coarse, starts[k], k, self._held]
            inputs += [rigid.pieces, rigid.pair.kernel(), rigid.strength, rigid.pair.a.image, rigid.pair.a.packed]
            inputs += [rigid.visibility.packed, frames, lists.kernel, found]
            given.append((self._begin, (envs, edges[k + 1] - edges[k], width // span), inputs))
        rigid.sampling.launch(given)
        return starts[:-1], found.numpy().tolist()

    def _cut(self, instants: Instants, evaluator: Evaluator) -> Any:
        cut: Any = Cut()
        layout = self._rigid.layout
        cut.jump = cut.bend = PART * layout.tolerance
        cut.probes = layout.probes
        cut.blind = max(1, instants.inside // BLIND)
        cut.rows = self._rigid.visibility.envs
        cut.slots, cut.envs, cut.margin = instants.inside, layout.envs, evaluator.visibility.margin
        cut.height, cut.width = evaluator.size
        return cut

    def _reserve(self, size: int, kept: int) -> None:
        """Makes room for samples, and keeps the first ones."""
        if size <= self._made[0].size:
            return
        grown = []
        for old in self._made:
            new = wp.empty(size + size // 2, dtype=old.dtype, device=self._device)
            if kept:
                wp.copy(new, old, 0, 0, kept)
            grown.append(new)
        self._made = grown

    def _sorted(self, total: int, since: np.ndarray) -> Further:
        """The samples by pixel and time. since: of each instant, ns after the gap's start, int32 [E, instants]."""
        layout, device = self._rigid.layout, self._device
        envs, (height, width) = layout.envs, self._rigid.size
        count = envs * height * width
        pixels, instants, values = self._made
        with wp.ScopedDevice(device):
            first, taken = wp.zeros(count + 1, dtype=wp.int32), wp.zeros(count, dtype=wp.int32)
            order, offset = wp.empty(total, dtype=wp.int32), wp.empty(total, dtype=wp.int32)
            value = wp.empty(total, dtype=self._pixel)
            wp.launch(count_samples, total, [pixels, first])
            wp.utils.array_scan(first, first, inclusive=True)
            wp.launch(place_samples, total, [pixels, first, taken, order])
            span = width if device.is_cpu else 1
            given = [height * width, span, first, instants, values, wp.array(since, dtype=wp.int32), order]
            wp.launch(self._sort, -(-count // span), given, [offset, value])
        return Further(first, offset, value)
