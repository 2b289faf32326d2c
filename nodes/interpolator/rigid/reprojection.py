"""Looks up a portion's sub-frames in both keyframes; what these do not show is shaded at its own time."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.runtime.workers import edges_of
from evis.scene.model import Waveform
from nodes.interpolator.relight.change import LightChange
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframes import KeyframePair, PreparedKeyframe
from nodes.interpolator.rigid.layout import Layout
from nodes.interpolator.rigid.look_up.gather_kernels import GatherLists, make_gather, make_place
from nodes.interpolator.rigid.look_up.portion_kernels import Portion, set_divisors
from nodes.interpolator.rigid.look_up.texture_kernels import make_demodulate
from nodes.interpolator.rigid.sampling import Sampling, SubframeRange, Todo
from nodes.renderer.lighting import LIST_WORKERS, Shading

BLOCK = 128
"""Threads of a block that looks up."""

WORKERS = 1 << 20
"""Threads that share a list of what is to be looked up, on a GPU."""


class Reprojection:
    """Makes the sub-frames in the slots of a shading's visibility, each of `envs` environments, from two keyframes.

    It only launches kernels, but for the lists of a CPU.

    strength float32 [slots E waveforms]: of lights that flicker. counted: int32 on the device, pixels that were shaded
    anew by list and, as the last number, what `nonfinite` has been added to; and pixels that were looked up by list.
    """

    def __init__(
        self, shading: Shading, sampling: Sampling, pieces: wp.array, layout: Layout, change: LightChange | None
    ) -> None:
        """Takes what is looked up and shaded. pieces: body and patch of each triangle. `strength` tells how lights are
        that flicker. change: tells where light changes, if it can."""
        self._change: Any = change.kernel if change else Change()
        changes = change.features if change else LightChanges()
        v = self._v = shading.visibility
        self._shading, self._sampling, self._pieces = shading, sampling, pieces
        envs, channels, waveform_count = layout.envs, layout.channels, layout.waveform_count
        self._pace = layout.pace
        self._envs, self._upsampling, self._on_device = envs, layout.upsampling, layout.on_device
        self._tolerance, self._relight, self._device = layout.tolerance, int(layout.relight), v.device
        self._index = [v.put(np.array(part, np.int32), wp.int32) for part in layout.portions]
        self._frame = [v.put(np.array(part, np.int32) - 1, wp.int32) for part in layout.portions]
        slots = layout.slots
        self._inner = envs * (v.shape[1] - 2 * v.margin) * (v.shape[2] - 2 * v.margin)
        whole = envs * v.shape[1] * v.shape[2] if waveform_count else 0
        # B's own slot is the first: the pixels of its environments are the first of all.
        starts = edges_of(whole, sampling.bands)
        with wp.ScopedDevice(v.device):
            self._radiance = wp.empty(v.shape, dtype=wp.vec3)
            self._pixels = wp.empty(slots * self._inner, dtype=wp.int32)
            self._places = wp.empty(0, dtype=wp.int32)
            self._count = wp.zeros(sampling.counts.size + 1, dtype=wp.int32)
            flagged = layout.on_device and changes.any
            self._flagged = wp.empty(slots * self._inner if flagged else 0, dtype=wp.int32)
            self._flagged_count = wp.zeros_like(sampling.counts)
            self.strength = wp.zeros(slots * envs * waveform_count, dtype=wp.float32)
            self._all: wp.array = wp.array(np.arange(whole, dtype=np.int32))
            self._all_count: wp.array = wp.array(np.diff(starts).astype(np.int32))
        self._lists: Any = GatherLists()
        self._lists.flagged, self._lists.flagged_count = self._flagged, self._flagged_count
        self._lists.pixels, self._lists.places, self._lists.count = self._pixels, self._places, self._count
        self._all_starts = starts[:-1]
        f = shading.features
        kind = (f.textures, f.smooth, f.vertex_colours) if textured_in(shading, layout) else None
        self._demodulate = make_demodulate(*kind) if kind else None
        how = (changes, layout.detailed, kind, layout.on_device)
        self._careful_look = make_gather(v.lens, channels, waveform_count, "careful", *how)
        self._first_looks: list[wp.Kernel] = []
        """What goes before it on a GPU."""
        if layout.on_device:
            self._first_looks.append(make_gather(v.lens, channels, waveform_count, "first", *how))
            if changes.any:
                self._first_looks.append(make_gather(v.lens, channels, waveform_count, "flagged", *how))
        self._place = make_place(channels)
        # The portion that lights and what casts shadows are placed for, on a CPU.
        self._lit: int | None = None
        self._loaded = self._placed = False
        self._changes = changes

    @property
    def nonfinite(self) -> wp.array:
        """Counts the pixels of keyframes that are not used, as they are not finite, int32 [1]."""
        return self._count[-1:]

    @property
    def counted(self) -> tuple[wp.array, wp.array]:
        """Returns the counts that the class describes."""
        return self._count, self._sampling.counts

    def clear(self) -> None:
        """Begins a gap."""
        self._count.zero_()
        self._flagged_count.zero_()
        self._sampling.clear()

    def place(self, pair: KeyframePair) -> None:
        """Places, for poses that have arrived, bodies as they were at the keyframes, and on a GPU lights and their
        shadow casters."""
        v = self._v
        self._lit = None
        pair.displace(v.camera_body, v.poses, pair.motions)
        self._placed = v.device.is_cuda or self._changes.any
        if self._placed:
            self._shading.place()
            self._shading.placed()

    def demodulate(self, keyframe: PreparedKeyframe) -> None:
        """Takes the textures of the first slot out of the light of a keyframe that is filled: a launch only."""
        if self._demodulate is not None:
            v, what = self._v, [self._shading.seen, self._shading.surfaces, keyframe.logs, keyframe.demodulated]

            def of_rows(row0: int, row1: int) -> tuple[Any, list[Any]]:
                return (self._envs, row1 - row0, v.shape[2] // v.span), [v.view, row0, v.span, *what]

            v.row_tiles.launch(self._demodulate, of_rows, v.device, in_parts=True)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        looks = [self._careful_look, *reversed(self._first_looks)]
        shading = [*self._shading.kernels(True), (self._place, LAUNCH_BLOCK)]
        return [*((kernel, BLOCK) for kernel in looks), *shading, *self._sampling.kernels()]

    def light(self, which: Waveform | None, placed: bool) -> wp.array:
        """Gives the radiance of all pixels of the first slot under LightSet.select, vec3 [>= E, H, W]. placed: after
        `place`."""
        shading = self._shading
        shading.lights.select(which)
        ready = placed and self._placed
        shading.shade_list(self._radiance, self._all, self._all_count, self._all_starts, ready)
        shading.lights.select_now()
        return self._radiance

    def reproject(self, part: SubframeRange, pair: KeyframePair, unchanged: wp.array, frames: wp.array) -> None:
        """Looks up what may have changed, shades what no keyframe shows, and again where samples are too far apart."""
        todo: Todo | None
        how: list[Any] = [
            self._portion(part, pair, unchanged),
            pair.kernel(),
            self._change,
            self._shading.seen,
            self._shading.surfaces,
        ]
        if self._on_device:
            todo = self._first_pixels(part, how, frames)
        else:
            todo = self._sampling.plan(part, pair.b, unchanged, frames)
        while todo is not None:
            self._shade(part, todo, self._look_up(todo, how, frames), frames)
            todo = self._sampling.refine(pair.a)

    def _portion(self, part: SubframeRange, pair: KeyframePair, unchanged: wp.array) -> Any:
        """Fills in what the gather reads of a portion and of the scene."""
        portion: Any = Portion()
        portion.slot0, portion.count, portion.envs = part.slot0, part.count, self._envs
        portion.frames = portion.upsampling = self._upsampling
        m = 2 * self._v.margin
        set_divisors(portion, self._v.shape[2] - m, self._v.shape[1] - m)
        portion.pace = self._pace
        portion.tolerance, portion.relight = self._tolerance, self._relight
        portion.keyframes = wp.vec2i(pair.a.first, pair.b.first)
        portion.index, portion.frame, portion.strength = (
            self._index[part.number],
            self._frame[part.number],
            self.strength,
        )
        portion.packed, portion.unchanged, portion.pieces = self._v.packed, unchanged, self._pieces
        return portion

    def _first_pixels(self, part: SubframeRange, how: list[Any], frames: wp.array) -> Todo:
        """Looks up all pixels of a portion but those that need care, which are listed."""
        todo = self._sampling.everything(part)
        shared = self._shared(todo, how, frames)
        for look, threads in zip(self._first_looks, (part.count * self._inner, WORKERS)):
            given: list[Any] = [self._v.view, 0, -1, threads, todo.at, *shared]
            wp.launch(look, threads, given, device=self._device, block_dim=BLOCK)
        return todo

    def _shared(self, todo: Todo, how: list[Any], frames: wp.array) -> list[Any]:
        """Lists what every look at a portion is given alike."""
        lists = self._lists
        lists.todo, lists.todo_count = todo.pixels, self._sampling.counts
        return [*how, lists, frames]

    def _look_up(self, todo: Todo, how: list[Any], frames: wp.array) -> list[int]:
        """Looks up what is listed. Gives where the list of each band begins of what no keyframe shows."""
        view = self._v.view
        shared = self._shared(todo, how, frames)
        if todo.starts is None:
            given: list[Any] = [view, 0, -1, WORKERS, todo.at, *shared]
            wp.launch(self._careful_look, WORKERS, given, device=self._device, block_dim=BLOCK)
            return [0] * self._sampling.bands
        launches = [
            (self._careful_look, 1, [view, first, last, 1, todo.at + k, *shared])
            for k, (first, last) in enumerate(pairwise(todo.starts))
        ]
        self._sampling.launch(launches)
        return todo.starts[:-1]

    def _shade(self, part: SubframeRange, todo: Todo, firsts: list[int], frames: wp.array) -> None:
        """Shades the listed pixels anew."""
        count = self._count[todo.at : todo.at + self._sampling.bands]
        # The first time also for nothing, so that a warm-up loads all kernels.
        if self._loaded and todo.starts is not None and not count.numpy().any():
            return
        self._loaded = True
        ready = self._placed or self._lit == part.number
        self._shading.shade_list(self._radiance, self._pixels, count, firsts, ready)
        self._lit = part.number
        workers = 1 if self._device.is_cpu else LIST_WORKERS
        for band, first in enumerate(firsts):
            given: list[Any] = [workers, first, band, self._envs, self._upsampling, self._v.margin]
            given += [self._frame[part.number], self._pixels, self._places, count, self._radiance]
            wp.launch(self._place, workers, given, [frames], device=self._device)


def textured_in(shading: Shading, layout: Layout) -> bool:
    """Tells whether textures are looked up at their own time: of luminance, under light that is all of one kind."""
    return shading.features.textures and layout.detailed and layout.channels == 1 and not layout.waveforms
