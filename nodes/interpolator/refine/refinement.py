"""Finds the samples of single pixels between frames: first along runs, then by halving intervals in rounds."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.runtime.workers import Workers, edges_of
from evis.scene.sampling import LONGEST_GAP_NS
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.keyframe import KeyframeView, Span
from nodes.interpolator.refine.evaluation.evaluator import Evaluator, make_look_up_kernels
from nodes.interpolator.refine.instants import Instants, instants_of, least_parts
from nodes.interpolator.refine.light.flicker import Flicker
from nodes.interpolator.refine.light.highlights import Highlights, tolerance_for
from nodes.interpolator.refine.light.light_visibility import LightVisibility
from nodes.interpolator.refine.paths.albedo_scale import least_spacing
from nodes.interpolator.refine.probing.probes import ProbeForecast, Probes
from nodes.interpolator.refine.rounds import Rounds, Window
from nodes.interpolator.refine.samples.means import Means
from nodes.interpolator.refine.samples.sort_kernels import count_samples, make_sort, place_samples
from nodes.interpolator.refine.specialisation import Kernels
from nodes.interpolator.refine.window_kernels import WindowParameters, WindowScene, make_coarse_frames
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.sampling import pixels_per_radian
from nodes.interpolator.rigid.slots import Poses
from nodes.interpolator.samples import Further

PART = 2.0
"""Tolerances of ln I within which an interval is left whole: the ends may differ by so much, and the middle lie so far
off the straight line between them."""
PLAIN = 0.4
"""Tolerances within which ln I looked up in a keyframe counts as a straight line: look-ups are cheap."""
FLICKERING = 0.8
"""Tolerances within which ln of a lamp's strength counts as a straight line between two instants, at each of which all
that it lights is looked at: with half of that scenes take a tenth to a third more time with 0.3 ms, and errors are .002
to .020 where they are .004 to .032."""
EVEN = 2.5
"""Distance [px] from a straight way, for a tolerance of 1, up to which a point counts as on it: with less the drone's
events are nearer by 5 %, for 12 % more time, which a closer tolerance of time makes nearer by 15 %."""
BESIDE = 2
"""Threads beside the caller's that work out what the motion of bodies tells."""
SWINGS = 0.02
"""Share of the samples at which what is painted goes up and down from one instant to the next, from which on a part of
its peaks is missed: eight scenes have up to 0.013, a wall of stripes that loses a third of its events 0.2 to 0.7."""
ROUGH = 4.0
"""Tolerances by which neighbouring pixels of a keyframe differ where look-ups between them may miss contrast."""


@dataclass(frozen=True)
class MotionForecast:
    """Holds what the motion of the bodies tells of a gap.

    stamps: of all instants, int64 [n] or [E, n] ns. poses: at these. probes: see Probes.foresee. parts, unseen: see
    LightVisibility.parts.
    """

    gap: Span
    stamps: np.ndarray
    poses: Poses
    probes: ProbeForecast | None
    parts: np.ndarray
    unseen: np.ndarray


class Refinement:
    """Finds further samples of single pixels between the frames that a `Rigid` made last."""

    def __init__(self, rigid: Rigid, tolerance_ns: float, threads: int, light_samples: int, fineness: int = 1) -> None:
        """Takes what makes the frames. tolerance_ns: greatest error wanted in the time of a threshold crossing [ns].
        fineness: sub-pixels per pixel and axis, whose mean the pixel is."""
        self._rigid = rigid
        self._threads, self._light_samples = threads, light_samples
        layout = rigid.layout
        v = rigid.visibility
        self._tolerance_ns = tolerance_for(v.scene, tolerance_ns)
        self._spacing = least_spacing(tolerance_ns)
        self._highlights = Highlights(v, rigid.placement.movers)
        # Gaps in a row are divided as each by itself would be.
        self._gaps = layout.envs if rigid.in_a_row else 1
        self._device, self._pixels = v.device, layout.envs // self._gaps * v.shape[1] * v.shape[2]
        self._rounds: dict[tuple[int, int], Rounds] = {}
        self._probes = Probes(rigid, tolerance_ns, threads)
        self._looks = least_parts(layout.upsampling)
        channels = layout.channels
        self._gain = pixels_per_radian(v) if v.view.distorted else max(v.view.fx, v.view.fy)
        self._pixel = pixel_type(channels)
        waveforms = (light.waveform for light in v.scene.lights)
        self._flicker = Flicker(waveforms, FLICKERING * layout.tolerance, v.device, layout.waveforms)
        self._sort_each, self._rank = make_sort(channels)
        self._kernels, self._light_visibility = Kernels.of(rigid), LightVisibility(rigid)
        self._means = Means(rigid, fineness, tolerance_ns) if fineness > 1 else None
        self._held = wp.zeros(layout.envs, dtype=wp.int32, device=v.device)
        self._parts = wp.zeros((2, layout.envs), dtype=wp.int32, device=v.device)
        self.as_long_as_ns = 0
        """Length of a gap as finely as which shorter ones are divided [ns], so as to be prepared for it."""
        self._foreseen: MotionForecast | None = None
        """Of the gap that follows, if it is known already."""
        # A GPU has a host of many cores, which it would wait for.
        self._beside = Workers(BESIDE, "motion") if self._device.is_cuda else None
        self._moved_once = False
        self.evaluated = self.shaded = 0
        """How many samples the last gap has, and how many of them were shaded."""
        self.reached = True
        """Whether these are as close as the tolerance of time asks for, where need be."""
        self.unseen = np.zeros(layout.envs, bool)
        """Whether something in an environment is so fast that part of it passes pixels between two looks at them."""

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that take long to compile, as `build_together` takes them."""
        looks = [(kernel, LAUNCH_BLOCK) for kernel in make_look_up_kernels(self._rigid)]
        sort = self._sort_each if self._device.is_cpu else self._rank
        window = self._kernels.to_build(self._rigid.shading.occluders.trees)
        light = [(self._light_visibility.kernel, LAUNCH_BLOCK)] if self._light_visibility.likely() else []
        means = [] if self._means is None else self._means.kernels()
        return [*looks, *window, *self._probes.kernels(), *light, (sort, LAUNCH_BLOCK), *means]

    def further(
        self,
        a: KeyframeView,
        b: KeyframeView,
        held: np.ndarray,
        frames: wp.array,
        following: Span | None,
        meanwhile: Callable[[], None],
    ) -> Further | None:
        """Computes the samples between the frames [E K, h, w] of the gap made last; None without any.

        following: the gap after it, if it is known, which is prepared while a GPU works on this one. meanwhile: what
        else is done then, once or more.
        """
        gap, envs = Span.between(a, b, held), self._rigid.layout.envs
        self.evaluated = self.shaded = 0
        self.unseen = np.zeros(envs, bool)
        known, self._foreseen = self._foreseen, None
        instants = self._instants(gap)
        length = gap.longest
        self.reached = instants.reached and length < LONGEST_GAP_NS and self._flicker.follows(length)
        if length <= 0 or length >= LONGEST_GAP_NS or instants.depth == 0:
            return None
        rounds = self._rounds_of(instants)
        evaluator = rounds.evaluator
        motion = known if known and known.gap.same(gap) else self._motion(gap, instants, evaluator)
        stamps, poses = motion.stamps, motion.poses
        self._rigid.widen(poses)
        evaluator.begin(stamps, gap, poses)
        self._probes.draw(motion.probes, instants, poses, gap, evaluator.targets.albedo_scale)
        self.unseen = self._probes.unseen | motion.unseen | (self._highlights.unseen(poses) & ~held)
        self._held.assign(held.astype(np.int32))
        self._parts.assign(motion.parts.astype(np.int32))
        self._flicker.find(gap.starts, stamps, instants.coarse)

        def while_it_works() -> None:
            meanwhile()
            self._prepare(gap, stamps, following)

        # Environments that have no gap now may have one next time; a CPU makes room as it goes.
        share = 1.0 if self._gaps == 1 or self._device.is_cpu else float((~held).mean())
        coarse: Any = make_coarse_frames(self._rigid.layout.channels)()
        coarse.image_a, coarse.frames = self._rigid.pair.a.image, frames
        marks = self._flicker.kernel
        marks.at_frames, marks.within = self._rigid.strength, evaluator.strength
        total, swings = 0, np.zeros(envs, np.int64)
        for first, last in instants.windows():
            evaluator.send(instants.of_window(first), instants.count)
            params = self._parameters(instants, evaluator, first)
            params.parts = int(motion.parts.max())
            window = Window(last - first, params, self._scene_of(rounds), coarse, marks)
            found = rounds.run(window, total, while_it_works, share)
            total, swings = found.samples, swings + found.swings
            self.shaded += found.shaded
        self.evaluated = total
        self.unseen |= swings > SWINGS * total / max(int((~held).sum()), 1)
        if not total:
            return None
        times = np.broadcast_to(stamps, (envs, instants.count)) - gap.starts[:, None]
        since: wp.array = wp.array(times.astype(np.int32), dtype=wp.int32, device=self._device)
        further = self._sorted(rounds.samples.arrays, total, since)
        if self._means is None:
            return further
        return self._means.of(further, self._held, since, 1 << instants.depth, self._rigid.pair.a.image, frames)

    def stamps(self, gap: Span) -> np.ndarray:
        """Gives the times of all instants of a gap, int64 [n] or [E, n] ns."""
        return gap.stamps(self._instants(gap).count)

    def _instants(self, gap: Span) -> Instants:
        """Chooses the instants at which pixels may be looked at in a gap."""
        coarse, length = self._rigid.layout.upsampling, max(gap.longest, self.as_long_as_ns)
        looks = max(self._looks, 1 << (-(-self._flicker.instants(length) // coarse) - 1).bit_length())
        return instants_of(length, coarse, self._tolerance_ns, self._pixels, looks, self._device.is_cpu)

    def _motion(self, gap: Span, instants: Instants, evaluator: Evaluator) -> MotionForecast:
        """Works out what the bodies' motion tells of a gap, on the host alone."""
        stamps = gap.stamps(instants.count)
        poses = evaluator.places.find(stamps, gap.a, gap.b, gap.held)
        parts = partial(self._light_visibility.parts, instants, poses, gap.ends - gap.starts, gap.held)
        probes = partial(self._probes.foresee, instants, stamps, poses, gap)
        if self._beside is None or not self._moved_once:
            # What compiles and loads a kernel is not for several threads at once.
            self._moved_once = True
            return MotionForecast(gap, stamps, poses, probes(None), *parts())
        light = self._beside.submit(parts)
        return MotionForecast(gap, stamps, poses, probes(self._beside), *light.result())

    def _prepare(self, gap: Span, stamps: np.ndarray, following: Span | None) -> None:
        """Prepares the gap after this one; stamps: of all instants of this one."""
        if self._foreseen is not None:
            return
        if following is None:
            if self._device.is_cuda and not gap.apart:
                self._rigid.placement.expect(stamps)
            return
        instants = self._instants(following)
        rounds = self._rounds.get((instants.per_window, instants.depth))
        ascends = following.held | (following.ends > following.starts)
        if rounds is None or not ascends.all() or following.held.all():
            return
        # What is wrong with its states is told when it is its turn, after the events of this gap.
        with suppress(ValueError):
            self._rigid.foresee(following)
            self._foreseen = self._motion(following, instants, rounds.evaluator)

    def _rounds_of(self, instants: Instants) -> Rounds:
        """Gives what works on these instants; one is kept, as gaps seldom differ by more than a nanosecond."""
        shape = instants.per_window, instants.depth
        if shape not in self._rounds:
            # What is not used any more is freed first.
            self._rounds.clear()
            evaluator = Evaluator(self._rigid, instants.slots, self._threads, self._light_samples)
            self._rounds[shape] = Rounds(self._rigid, evaluator, instants, self._kernels, self._light_visibility)
        return self._rounds[shape]

    def _parameters(self, instants: Instants, evaluator: Evaluator, first: int) -> Any:
        params: Any = WindowParameters()
        layout = self._rigid.layout
        params.jump = params.bend = PART * layout.tolerance
        params.straight, params.rough = PLAIN * layout.tolerance, ROUGH * layout.tolerance
        params.first, params.coarse, params.slots, params.depth = (
            first,
            instants.coarse,
            instants.inside,
            instants.depth,
        )
        params.probes = self._probes.most
        params.rows = self._rigid.visibility.envs
        params.envs, params.margin = layout.envs, evaluator.visibility.margin
        params.height, params.width = evaluator.size
        params.gain, params.even, params.spacing = self._gain, EVEN * layout.tolerance, self._spacing
        return params

    def _scene_of(self, rounds: Rounds) -> Any:
        scene: Any = WindowScene()
        evaluator, scene.bends = rounds.evaluator, rounds.bends
        scene.motions = evaluator.motions
        scene.held, scene.packed_a = self._held, self._rigid.pair.a.packed
        scene.packed, scene.targets = self._rigid.visibility.packed, evaluator.targets
        scene.probed, scene.probes = self._probes.packed, self._probes.each
        scene.parts, scene.alpha = self._parts, evaluator.change.alpha
        scene.surfaces = evaluator.shading.surfaces
        return scene

    def _sorted(self, samples: list[wp.array], total: int, since: wp.array) -> Further:
        """Sorts the samples by pixel and time. since: int32 [E, instants], ns from the gap's start to each instant."""
        layout, device = self._rigid.layout, self._device
        envs, (height, width) = layout.envs, self._rigid.size
        count = envs * height * width
        pixels, instants, values = samples
        with wp.ScopedDevice(device):
            first, taken = wp.zeros(count + 1, dtype=wp.int32), wp.zeros(count, dtype=wp.int32)
            order, offset = wp.empty(total, dtype=wp.int32), wp.empty(total, dtype=wp.int32)
            value = wp.empty(total, dtype=self._pixel)
            wp.launch(count_samples, total, [pixels, first])
            wp.utils.array_scan(first, first, inclusive=True)
            wp.launch(place_samples, total, [pixels, first, taken, order])
            if device.is_cpu:
                given = [height * width, first, instants, values, since, order, offset, value]
                sampling = self._rigid.sampling
                edges = edges_of(count, sampling.bands)
                sampling.launch([(self._sort_each, e - s, [s, *given]) for s, e in pairwise(edges)])
            else:
                given = [height * width, first, pixels, instants, values, since, order]
                wp.launch(self._rank, total, given, [offset, value])
        return Further(first, offset, value)
