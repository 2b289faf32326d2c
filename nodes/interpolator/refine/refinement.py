"""Finds the samples of single pixels between frames: first along runs, then by halving intervals in rounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import KeyframeView, own_subframes
from nodes.interpolator.refine.change_kernels import Changes, find_changes
from nodes.interpolator.refine.evaluator import Evaluator
from nodes.interpolator.refine.flicker import Flicker
from nodes.interpolator.refine.further_kernels import count_samples, make_sort, place_samples
from nodes.interpolator.refine.instants import Instants, instants_of
from nodes.interpolator.refine.interval_kernels import make_intervals, make_rounds, see
from nodes.interpolator.refine.path_kernels import Cut, Stage, make_instances
from nodes.interpolator.refine.probing.probes import Probes
from nodes.interpolator.refine.run_kernels import make_find_runs
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.samples import Further
from nodes.renderer.lighting import LIST_WORKERS

PART = 2.0
"""Tolerances of ln I within which an interval is left whole: the ends may differ by so much, and the middle lie so far
off the straight line between them."""
PLAIN = 0.6
"""Tolerances within which ln I looked up in a keyframe counts as a straight line: look-ups are cheap."""
ROUGH = 4.0
"""Tolerances by which neighbouring pixels of a keyframe differ where look-ups between them may miss contrast."""
SPARE = 1.5
"""Allocated size over needed size, so that lists seldom grow."""
LOOKS, LEAST_LOOKS = 32, 4
"""Instants per gap and per coarse interval, at least."""


class Lists:
    """Holds a growing list on a device, as a struct of arrays for kernels: `kernel`, of `size` entries."""

    def __init__(self, struct: Any, pixel: Any, device: Any) -> None:
        """pixel: the type of ln I."""
        self.kernel: Any = struct()
        self._types = {
            name: pixel if name in VALUES else wp.uint64 if name in ENTRIES else wp.int32 for name in struct.vars
        }
        self._device, self.size = device, 0

    def reserve(self, size: int) -> None:
        """Makes room for `size` entries; entries there are lost where the arrays must grow."""
        if size > self.size:
            self.size = int(SPARE * size)
            for name, dtype in self._types.items():
                setattr(self.kernel, name, wp.empty(self.size, dtype=dtype, device=self._device))


ENTRIES = ("before", "after")
"""Fields that hold z-buffer entries, uint64."""
VALUES = ("start", "end", "rise", "tail")
"""Fields that hold ln I or changes of it."""


class Refinement:
    """Finds further samples of single pixels between the frames that a `Rigid` made last."""

    def __init__(self, rigid: Rigid, tolerance_ns: float, threads: int, light_samples: int) -> None:
        """tolerance_ns: greatest error wanted in the time of a threshold crossing [ns]."""
        self._rigid, self._tolerance_ns = rigid, tolerance_ns
        self._threads, self._light_samples = threads, light_samples
        layout = rigid.layout
        v = rigid.visibility
        self._device, self._pixels = v.device, layout.envs * v.shape[1] * v.shape[2]
        self._evaluators: dict[int, Evaluator] = {}
        self._probes = Probes(rigid, threads)
        self._looks = 1 << (max(LEAST_LOOKS, -(-LOOKS // layout.upsampling)) - 1).bit_length()
        channels = layout.channels
        self._pixel: Any = wp.float32 if channels == 1 else wp.vec3
        self._find_plain, self._find_runs = make_find_runs(v.lens, channels, layout.exact_flicker, layout.relight)
        self._flicker = Flicker((light.waveform for light in v.scene.lights), PLAIN * layout.tolerance, v.device)
        self._others = wp.empty(0, dtype=wp.int32, device=v.device)
        self._first = wp.empty(0, dtype=wp.int32, device=v.device)
        self._changes = Lists(Changes, self._pixel, v.device)
        self._check, self._split = make_rounds(channels)
        self._sort_each, self._rank = make_sort(channels)
        self._instances = Lists(make_instances(channels), self._pixel, v.device)
        self._lists = [Lists(make_intervals(channels), self._pixel, v.device) for _ in range(2)]
        self._made: list[wp.array] = [wp.empty(0, dtype=t, device=v.device) for t in (int, int, self._pixel)]
        self._held = wp.zeros(layout.envs, dtype=wp.int32, device=v.device)
        self._most = self._most_changes = 0
        """Most entries of `_instances` and of `_changes` that a band has needed in a window so far."""
        self.evaluated = self.shaded = 0
        """How many samples the last gap has, and how many of them were shaded."""
        self.reached = True
        """Whether these are as close as the tolerance of time asks for, where need be."""
        self.unseen = False
        """Whether something is so fast that part of it passes pixels between two looks at them."""

    def further(self, a: KeyframeView, b: KeyframeView, held: np.ndarray, frames: wp.array) -> Further | None:
        """Computes the samples between the frames [E K, h, w] of the gap made last; None without any."""
        rigid = self._rigid
        envs = rigid.layout.envs
        starts, ends = a.times(envs), b.times(envs)
        gap = int((ends - starts)[~held].max(initial=0))
        self.evaluated = self.shaded = 0
        self.unseen = False
        coarse, cpu = rigid.layout.upsampling, self._device.is_cpu
        looks = max(self._looks, 1 << (-(-self._flicker.instants(gap) // coarse) - 1).bit_length())
        instants = instants_of(gap, coarse, self._tolerance_ns, self._pixels, looks, cpu)
        self.reached = instants.reached and gap < 1 << 31 and self._flicker.follows(gap)
        if gap <= 0 or gap >= 1 << 31 or instants.depth == 0:
            return None
        if a.own is None and b.own is None:
            stamps = instants.stamps(a.stamp_ns, b.stamp_ns)
        else:
            stamps = own_subframes(a, b, held, instants.count)
        evaluator = self._evaluator(instants)
        assert a.states is not None and b.states is not None
        evaluator.begin(stamps, a.states, b.states, held)
        self._probes.draw(instants, stamps, ends - starts, evaluator.places, (a.states, b.states), held)
        self.unseen = self._probes.unseen
        self._held.assign(held.astype(np.int32))
        self._flicker.find(starts, stamps, coarse)
        total = 0
        for first, last in instants.windows():
            total = self._window(instants, evaluator, first, last, frames, total)
        self.evaluated, self.shaded = total, evaluator.shaded
        since = np.broadcast_to(stamps, (envs, instants.count)) - starts[:, None]
        return self._sorted(total, since.astype(np.int32)) if total else None

    def _evaluator(self, instants: Instants) -> Evaluator:
        """Gives the evaluator for these instants; one is kept, as gaps seldom differ by more than a nanosecond."""
        if instants.slots not in self._evaluators:
            self._evaluators = {
                instants.slots: Evaluator(self._rigid, instants.slots, self._threads, self._light_samples)
            }
        return self._evaluators[instants.slots]

    def _window(
        self, instants: Instants, evaluator: Evaluator, first: int, last: int, frames: wp.array, total: int
    ) -> int:
        """Refines coarse intervals first .. last - 1; total: samples so far. Returns the samples then."""
        evaluator.place(instants.of_window(first), instants.count)
        cut, stage = self._cut(instants, evaluator, first), self._stage(evaluator)
        starts, counts = self._runs(evaluator, cut, stage, last, frames)
        if not any(counts):
            return total
        listed, there = self._instances, self._lists[0]
        image, packed = self._rigid.pair.a.image, self._rigid.pair.a.packed
        self._evaluate(evaluator, cut, stage, listed, starts, counts)
        made = self._room_for(sum(counts), total)
        given = [image, packed, frames, stage, listed.kernel, evaluator.hits, evaluator.values, *made]
        starts, counts, total = self._round(self._check, cut, starts, counts, given, there, total)
        while any(counts):
            listed = there
            there = self._lists[0] if listed is self._lists[1] else self._lists[1]
            self._evaluate(evaluator, cut, stage, listed, starts, counts)
            made = self._room_for(sum(counts), total)
            given = [self._rigid.pieces, evaluator.hits, evaluator.values, listed.kernel, *made]
            starts, counts, total = self._round(self._split, cut, starts, counts, given, there, total)
        return total

    def _evaluate(
        self, evaluator: Evaluator, cut: Any, stage: Any, listed: Lists, starts: list[int], counts: list[int]
    ) -> None:
        """Computes z-buffer entries and radiance of the listed pixels.

        starts, counts: where the entries of each band begin in the list, and how many there are.
        """
        evaluator.reserve(listed.size)
        pixels = listed.kernel
        launches = []
        for start, count in zip(starts, counts):
            threads = self._threads_of(count)
            given = [evaluator.visibility.view, cut, start, start + count, threads, stage]
            launches.append((see, threads, [*given, pixels.at, pixels.before, pixels.after, evaluator.hits]))
        self._rigid.sampling.launch([one for one in launches if one[1]])
        evaluator.evaluate(pixels.at, starts, counts)

    def _round(
        self, kernel: Any, cut: Any, starts: list[int], counts: list[int], given: list[Any], there: Lists, total: int
    ) -> tuple[list[int], list[int], int]:
        """Adds what was evaluated to the samples, and lists the intervals that are to be halved next in `there`.

        kernel: `check` or `split`. Returns starts and counts by band of that list, and the number of samples.
        """
        known = (total + np.concatenate([[0], np.cumsum(counts)])).tolist()
        rooms = (2 * np.concatenate([[0], np.cumsum(counts)])).tolist()
        there.reserve(rooms[-1])
        found = wp.zeros(len(counts), dtype=wp.int32, device=self._device)
        launches = []
        for k, (start, count) in enumerate(zip(starts, counts)):
            threads = self._threads_of(count)
            where = [cut, start, start + count, threads, known[k], rooms[k], k]
            launches.append((kernel, threads, [*where, *given, there.kernel, found]))
        self._rigid.sampling.launch([one for one in launches if one[1]])
        return rooms[:-1], found.numpy().tolist(), known[-1]

    def _threads_of(self, count: int) -> int:
        return min(count, 1) if self._device.is_cpu else count

    def _runs(
        self, evaluator: Evaluator, cut: Any, stage: Any, last: int, frames: wp.array
    ) -> tuple[list[int], list[int]]:
        """Lists the pixels and instants at which runs need a sample, in the window from cut.first to last - 1.

        The lists grow, and the kernels run again, until everything fits. Returns starts and counts by band.
        """
        rigid, v, bands = self._rigid, evaluator.visibility, evaluator.bands
        height, width = evaluator.size
        envs = rigid.layout.envs
        edges = [height * k // bands for k in range(bands + 1)]
        span = width if v.device.is_cpu else 1
        intervals, inner, probes = last - cut.first, envs * height * width, cut.probes
        if not self._most:
            self._most = self._most_changes = -(-inner // bands)
        if self._others.size < intervals * inner:
            self._others = wp.empty(intervals * inner, dtype=wp.int32, device=v.device)
        if self._first.size < intervals * inner * probes:
            self._first = wp.empty(intervals * inner * probes, dtype=wp.int32, device=v.device)
        while True:
            self._instances.reserve(bands * self._most)
            self._changes.reserve(bands * self._most_changes)
            changes = self._changes.kernel
            changes.first = self._first
            most, most_changes = self._instances.size // bands, self._changes.size // bands
            found, others, changed = (wp.zeros(bands, dtype=wp.int32, device=v.device) for _ in range(3))
            workers = 1 if v.device.is_cpu else LIST_WORKERS
            launches: list[list[tuple[Any, Any, list[Any]]]] = [[], [], []]
            for k in range(bands):
                rows, other = edges[k + 1] - edges[k], intervals * envs * width * edges[k]
                keys, start, marks = rigid.pair.kernel(), rigid.pair.a.packed, self._flicker.kernel
                given = [v.view, cut, edges[k], span, k * most, most, other, k, self._held, keys, stage]
                given += [marks, rigid.strength, evaluator.strength]
                given += [rigid.pair.a.image, start, frames, self._instances.kernel, found, self._others, others]
                launches[0].append((self._find_plain, (intervals * envs, rows, width // span), given))
                given = [v.view, cut, workers, k * most_changes, most_changes, other, k, self._others, others]
                launches[1].append((find_changes, workers, [*given, stage, start, changes, changed]))
                given = [v.view, cut, workers, k * most, most, other, k, self._others, others, changes, keys, stage]
                launches[2].append((self._find_runs, workers, [*given, marks, start, self._instances.kernel, found]))
            for each in launches:
                rigid.sampling.launch(each)
            counts, needed = found.numpy().tolist(), int(changed.numpy().max())
            if max(counts) <= most and needed <= most_changes:
                return [k * most for k in range(bands)], counts
            self._most, self._most_changes = max(*counts, self._most), max(needed, self._most_changes)

    def _cut(self, instants: Instants, evaluator: Evaluator, first: int) -> Any:
        cut: Any = Cut()
        layout = self._rigid.layout
        cut.jump = cut.bend = PART * layout.tolerance
        cut.straight, cut.rough = PLAIN * layout.tolerance, ROUGH * layout.tolerance
        cut.first, cut.coarse, cut.slots, cut.depth = first, instants.coarse, instants.inside, instants.depth
        cut.probes = self._probes.most
        cut.rows = self._rigid.visibility.envs
        cut.envs, cut.margin = layout.envs, evaluator.visibility.margin
        cut.height, cut.width = evaluator.size
        return cut

    def _stage(self, evaluator: Evaluator) -> Any:
        stage: Any = Stage()
        stage.turn, stage.shift = evaluator.moved
        stage.packed, stage.targets = self._rigid.visibility.packed, evaluator.targets
        stage.probed, stage.probes = self._probes.packed, self._probes.each
        return stage

    def _room_for(self, count: int, kept: int) -> list[wp.array]:
        """Makes room for `count` more samples; the first `kept` stay."""
        size = kept + count
        if size > self._made[0].size:
            grown = []
            for old in self._made:
                new = wp.empty(int(SPARE * size), dtype=old.dtype, device=self._device)
                if kept:
                    wp.copy(new, old, 0, 0, kept)
                grown.append(new)
            self._made = grown
        return self._made

    def _sorted(self, total: int, since: np.ndarray) -> Further:
        """Sorts the samples by pixel and time. since: int32 [E, instants], ns from the gap's start to each instant."""
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
            when: wp.array = wp.array(since, dtype=wp.int32)
            if device.is_cpu:
                given = [height * width, first, instants, values, when, order]
                wp.launch(self._sort_each, count, given, [offset, value])
            else:
                given = [height * width, first, pixels, instants, values, when, order]
                wp.launch(self._rank, total, given, [offset, value])
        return Further(first, offset, value)
