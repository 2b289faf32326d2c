"""Finds the samples of a window: first along runs, then by halving intervals in rounds, until none is bent."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.cuda_graph import CudaGraphs
from evis.runtime.workers import edges_of
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.evaluation.evaluator import Evaluator
from nodes.interpolator.refine.evaluation.trace_kernels import trace_pixels
from nodes.interpolator.refine.halving.interval_kernels import make_intervals
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.light.light_visibility import LightVisibility
from nodes.interpolator.refine.paths.motion_kernels import find_bends
from nodes.interpolator.refine.runs.transition_kernels import (
    ChangingPixels,
    Transitions,
    find_changed_spans,
    make_find_transitions,
)
from nodes.interpolator.refine.samples.lists import GrowingList, Samples, part_of
from nodes.interpolator.refine.samples.request_kernels import make_requests
from nodes.interpolator.refine.samples.tally import Counts, Tally
from nodes.interpolator.refine.specialisation import TRANSITION_BLOCK, Kernels
from nodes.interpolator.rigid.method import Rigid
from nodes.renderer.lighting import LIST_WORKERS

SEARCHERS = 1 << 21
"""Threads that look for changes and along runs on a GPU."""
AT_FIRST = 1.0
"""Entries of a list for each pixel of an instant, before it is known how many are needed."""


@dataclass(frozen=True)
class Window:
    """Holds what kernels read of some neighbouring coarse intervals of a gap.

    intervals: how many. params: WindowParameters. scene: WindowScene. coarse: CoarseFrames. marks: of lights that
    flicker.
    """

    intervals: int
    params: Any
    scene: Any
    coarse: Any
    marks: Any


@dataclass(frozen=True)
class Found:
    """Holds what was found in a window: how many samples there are then, how many of the new ones were shaded, and
    `swings` int32 [E] of `Tally`."""

    samples: int
    shaded: int
    swings: np.ndarray


class Rounds:
    """Adds the samples of one window after another to `samples`, in lists that grow as need be.

    On a GPU the host does not wait for any count before a window is done: all its launches are one recorded graph, of
    as many rounds as an interval can be halved, and what is too much for a list is only counted, whereupon the list
    grows and the window is done again. On a CPU, where reading a count costs nothing, lists grow first, and the rounds
    end where nothing is left.
    """

    def __init__(
        self,
        rigid: Rigid,
        evaluator: Evaluator,
        instants: Instants,
        kernels: Kernels,
        light_visibility: LightVisibility,
    ) -> None:
        self._rigid, self.evaluator, self._kernels, self._light_visibility = rigid, evaluator, kernels, light_visibility
        v, layout, bands = rigid.visibility, rigid.layout, evaluator.bands
        channels, device = layout.channels, v.device
        pixel = pixel_type(channels)
        self.reads_counts = device.is_cpu
        """Whether the host reads counts while a window is done."""
        self._find_transitions = make_find_transitions(evaluator.shading.occluders.trees)
        self._tally, self._graphs = Tally(bands, layout.envs, device), CudaGraphs(device)
        self._changing: Any = ChangingPixels()
        self._transitions = GrowingList(Transitions, pixel, bands, device)
        self._requests = GrowingList(make_requests(channels), pixel, bands, device)
        self._intervals = [GrowingList(make_intervals(channels), pixel, bands, device) for _ in range(2)]
        self.samples = Samples(channels, self._tally.made, device)
        rows, bodies = 2 * instants.per_window * layout.envs, evaluator.motions.shape[1]
        self.bends = wp.zeros((rows, bodies, instants.depth + 1), dtype=wp.vec2, device=device)

    def run(self, window: Window, total: int, meanwhile: Callable[[], None], share: float) -> Found:
        """Finds the samples of a window that the evaluator was sent the instants of; total: samples so far; meanwhile:
        what the host does before it waits; share: of the environments that have a gap, for lists to have room for what
        all of them may need.
        """
        self._make_room(window)
        if window.params.parts:
            self._light_visibility.make_room(window.intervals, window.params)
            window.scene.light_changes = self._light_visibility.bits
        while True:
            if not self.reads_counts:
                self.evaluator.reserve(max(one.size for one in (self._requests, *self._intervals)))
            self._tally.begin(total)
            self._graphs.run(self._key(window), partial(self._launch, window))
            meanwhile()
            told = self._tally.read()
            made = int(told.made.max())
            if not self._grow(told, made, total):
                # All had room. There is more of it next time, if all environments have a gap then.
                self._grow(told, made, made, share)
                return Found(made, told.shaded, told.swings)

    def _make_room(self, window: Window) -> None:
        """Makes room for the pixels that show several surfaces, and in lists that are still empty."""
        evaluator, device, params = self.evaluator, self._rigid.visibility.device, window.params
        inner = params.envs * params.height * params.width
        most = max(int(AT_FIRST * inner) // evaluator.bands, 1)
        changing, listed = self._changing, window.intervals * inner
        if changing.at is None or changing.at.size < listed:
            for name in ("at", "grazing", "begun", "opened"):
                setattr(changing, name, wp.empty(listed, dtype=wp.int32, device=device))
            changing.seen = wp.empty(listed, dtype=wp.uint64, device=device)
        if changing.first is None or changing.first.size < listed * params.probes:
            changing.first = wp.empty(listed * params.probes, dtype=wp.int32, device=device)
        lists = [self._requests, self._transitions]
        if not self.reads_counts:
            lists += self._intervals
            self.samples.reserve(2 * most * evaluator.bands, 0)
        for each in lists:
            if not each.most:
                each.reserve(most)

    def _grow(self, told: Counts, made: int, kept: int, share: float = 1.0) -> bool:
        """Makes room for what was counted and had none; True where that was anything. kept: samples that stay. share:
        of what there may be, which was counted."""
        needed = [told.transitions, told.lists[0], told.lists[1::2], told.lists[2::2]]
        lists = [self._transitions, self._requests, *self._intervals]
        grown = [each.reserve(math.ceil(most.max() / share)) for each, most in zip(lists, needed)]
        return any([*grown, self.samples.reserve(math.ceil(made / share), kept)])

    def _key(self, window: Window) -> Hashable:
        """Tells all that can differ between the launches of two windows: numbers, and where arrays are that may be
        replaced; all others are written where they were."""
        lists = [self._requests, self._transitions, *self._intervals]
        structs = [
            window.params,
            window.scene,
            window.coarse,
            window.marks,
            self._changing,
            *(each.kernel for each in lists),
        ]
        arrays = [self.evaluator.hits, *self.samples.arrays]
        return (
            *(bytes(struct.__ctype__()) for struct in structs),
            *((array.ptr, array.shape) for array in arrays),
            *(each.most for each in lists),
            self._rigid.pair.a.first,
            self.evaluator.shading.occluders.builds,
        )

    def _launch(self, window: Window) -> None:
        """Does all that a window needs: launches only, but where the host reads counts."""
        self.evaluator.place()
        keys = self._rigid.pair.kernel()
        wp.launch(
            find_bends,
            self.bends.shape[:2],
            [window.params, window.scene, keys.motions],
            [self.bends],
            device=self.bends.device,
        )
        if window.params.parts:
            self._light_visibility.find(window.intervals, window.params, window.scene, self.evaluator)
        self._find(window)
        listed, there = self._requests, self._intervals[0]
        # An interval between two samples, or between one and a coarse frame, has less than 2^depth parts: after as many
        # rounds as `depth` there is none left of two or more.
        for number in range(window.params.depth + 1):
            bands = self._bands(number, listed, there)
            if not bands:
                break
            self._evaluate(window, number, listed, bands)
            self._launch_round(window, number, listed, there, bands)
            listed, there = there, self._intervals[1] if there is self._intervals[0] else self._intervals[0]

    def _bands(self, number: int, listed: GrowingList, there: GrowingList) -> list[int]:
        """Gives the bands whose part of a list has entries, and makes room for what comes of them: where the host reads
        counts. Gives none where something has had no room."""
        if not self.reads_counts:
            return list(range(self.evaluator.bands))
        told = self._tally.read()
        counts, most = told.lists[number], int(told.lists[number].max())
        if most > listed.most or int(told.transitions.max()) > self._transitions.most:
            return []
        there.reserve(2 * most)
        self.evaluator.reserve(listed.size)
        before = int(told.made[number])
        self.samples.reserve(before + int(counts.sum()), before)
        return np.flatnonzero(counts).tolist()

    def _find(self, window: Window) -> None:
        """Lists the pixels and instants at which runs need a sample."""
        rigid, evaluator, params, tally = self._rigid, self.evaluator, window.params, self._tally
        kernels, view, bands = self._kernels, evaluator.visibility.view, evaluator.bands
        cpu, images = evaluator.visibility.device.is_cpu, window.intervals * params.envs
        edges = edges_of(params.height, bands)
        span, listers, searchers = (params.width, 1, 1) if cpu else (1, LIST_WORKERS, SEARCHERS)
        requests, transitions, changing = self._requests.kernel, self._transitions.kernel, self._changing
        scene, seen = window.scene, [rigid.pair.kernel(), window.scene, window.coarse, window.marks, evaluator.change]
        launches: tuple[list[tuple[Any, Any, list[Any]]], ...] = ([], [], [], [], [], [])
        for k in range(bands):
            rows, area = edges[k + 1] - edges[k], images * params.width
            listed = [requests, self._requests.part(k, tally.lists[0])]
            changes = [transitions, self._transitions.part(k, tally.transitions)]
            among = [changing, part_of(area * edges[k], area * rows, k, tally.changing)]
            given = [view, params, edges[k], span, *seen, *listed, *among]
            launches[0].append((kernels.request_single_surface, (images, rows, params.width // span), given))
            search = [view, params, searchers]
            given = [*search, scene, *among, *changes, tally.changed_spans]
            launches[1].append((find_changed_spans, searchers, given))
            given = [*search, tally.changed_spans, scene, changing, *changes]
            launches[2].append((self._find_transitions, searchers, given))
            launches[3].append((kernels.find_transition_times, searchers, [*search, scene, changing, *changes]))
            given = [view, params, listers, scene, *among, transitions, *listed]
            launches[4].append((kernels.request_run_ends, listers, given))
            launches[5].append((kernels.request_runs, searchers, [*search, *seen, *among, *changes, *listed]))
        for number, each in enumerate(launches):
            rigid.sampling.launch(each, TRANSITION_BLOCK if number == 2 else LAUNCH_BLOCK)

    def _evaluate(self, window: Window, number: int, listed: GrowingList, bands: list[int]) -> None:
        """Computes z-buffer entries and radiance of the listed pixels."""
        evaluator, pixels, count = self.evaluator, listed.kernel, self._tally.lists[number]
        workers = evaluator.workers(number)
        of_pixels = [pixels.at, pixels.before, pixels.after, evaluator.hits]
        given = [evaluator.visibility.view, window.params, workers, window.scene]
        launches = [(trace_pixels, workers, [*given, listed.part(k, count), *of_pixels]) for k in bands]
        self._rigid.sampling.launch(launches)
        evaluator.evaluate(number, pixels.at, listed.most, count, bands, self._tally.unseen[number])
        if number == 0 and self._kernels.shade_limbs is not None:
            given = [evaluator.visibility.view, window.params, workers, *evaluator.lit(), pixels]
            launches = [
                (self._kernels.shade_limbs, workers, [*given, listed.part(k, count), evaluator.values]) for k in bands
            ]
            self._rigid.sampling.launch(launches)

    def _launch_round(
        self, window: Window, number: int, listed: GrowingList, there: GrowingList, bands: list[int]
    ) -> None:
        """Adds what was evaluated to the samples, and lists the intervals that are to be halved next in `there`."""
        rigid, evaluator, tally = self._rigid, self.evaluator, self._tally
        workers = evaluator.workers(number)
        kernel, what = self._kernels.split, [window.scene, tally.swings]
        if number == 0:
            kernel, what = self._kernels.check, [window.scene, window.coarse, tally.swings]
        given = [window.params, workers, number, *what, listed.kernel]
        found = [evaluator.hits, evaluator.values, self.samples.kernel, there.kernel]
        count, next_count = tally.lists[number], tally.lists[number + 1]
        launches = [
            (kernel, workers, [*given, listed.part(k, count), *found, there.part(k, next_count)]) for k in bands
        ]
        rigid.sampling.launch(launches)
