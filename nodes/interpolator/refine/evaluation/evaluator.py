"""Computes the radiance of single pixels at instants: looked up in the keyframes, or shaded if neither shows it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.keyframe import Span
from nodes.interpolator.refine.evaluation.visibility_kernels import Targets
from nodes.interpolator.refine.paths.albedo_scale import albedo_scale_of
from nodes.interpolator.refine.paths.texture_charts import charts_of
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.look_up.gather_kernels import GatherLists, make_gather, make_place
from nodes.interpolator.rigid.look_up.portion_kernels import Portion, set_divisors
from nodes.interpolator.rigid.method import Rigid
from nodes.interpolator.rigid.patches import neighbours_of
from nodes.interpolator.rigid.reprojection import textured_in
from nodes.interpolator.rigid.slots import Poses, Slots
from nodes.renderer.lighting import LIST_WORKERS, Shading
from nodes.renderer.lights.lights import waveform_strengths
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions
from nodes.renderer.shadows.grid_kernels import Grid

WORKERS = 1 << 20, 1 << 18
"""Threads that share a list of pixels on a GPU, where they are looked up: the first one, and shorter ones."""


def changes_of(rigid: Rigid) -> LightChanges:
    """Tells how light may change in the scene of a `Rigid`."""
    return rigid.change.features if rigid.change else LightChanges()


def make_look_up_kernels(rigid: Rigid) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels that look up listed pixels, and that write to their places what was shaded."""
    layout, f = rigid.layout, rigid.shading.features
    kind = (f.textures, f.smooth, f.vertex_colours) if textured_in(rigid.shading, layout) else None
    how = (
        layout.channels,
        layout.waveform_count,
        "careful",
        changes_of(rigid),
        layout.detailed,
        kind,
        layout.on_device,
    )
    return make_gather(rigid.visibility.lens, *how, single=True), make_place(layout.channels, single=True)


class Evaluator:
    """Evaluates listed pixels at the instants of one window, in the gap whose frames a `Rigid` made last.

    hits: uint64 [list], z-buffer entries, which the caller writes first. values: [list], the radiance found. bands:
    parts of the list, each for a CPU thread. strength: float32 [slots E waveforms], of lights that flicker.
    change: struct for kernels of how light changes at the instants.
    """

    def __init__(self, rigid: Rigid, slots: int, threads: int, light_samples: int) -> None:
        self._rigid, layout = rigid, rigid.layout
        coarse = rigid.visibility
        scene, camera, self._envs, self._slots = coarse.scene, coarse.camera, layout.envs, slots
        sparse = True if len(rigid.placement.movers) else None
        v = self.visibility = Visibility(
            scene, camera, self._envs * slots, coarse.margin, str(coarse.device), threads,
            layered=False, sparse=sparse, drawn=False,
        )  # fmt: skip
        options = ShadingOptions(light_samples, None, remember=False, traced=True)
        self.shading = Shading(v, options, rigid.shading.occluders.meshes)
        self.places = Slots(scene, v, rigid.placement, slots)
        change = rigid.change
        self.change: Any = change.beside(self.shading) if change else Change()
        self._room = 0
        self.size = (v.shape[1] - 2 * v.margin, v.shape[2] - 2 * v.margin)
        self.bands = len(v.row_tiles.parts)
        self._pixel = pixel_type(layout.channels)
        bodies = len(v.names) + 2
        with wp.ScopedDevice(v.device):
            self._radiance = wp.empty(v.shape, dtype=wp.vec3)
            self.motions = wp.empty((2 * v.envs, bodies), dtype=BodyMotion)
            """Of each body since A (rows 0 .. R - 1) and since B (R ..), [2 R, N + 2]."""
            self._frame = wp.zeros(slots, dtype=wp.int32)
            self._index: wp.array = wp.zeros(slots, dtype=wp.int32)
            self.strength = wp.zeros(v.envs * layout.waveform_count, dtype=wp.float32)
        self._gather, self._place = make_look_up_kernels(rigid)
        self._targets, self._portion = self._make_targets(), self._make_portion()
        self._lists: dict[int, tuple[tuple[wp.array, ...], Any]] = {}
        self._at: list[int] = []
        """The instants that `_index` has."""
        self.reserve(1)

    def _make_targets(self) -> Any:
        v, targets = self.visibility, Targets()
        targets.vertices, targets.triangles, targets.instance = v.vertices, v.triangles, v.triangle_instance
        targets.two_sided, targets.pieces = v.two_sided, self._rigid.pieces
        targets.first = v.put(v.geometry.first, wp.int32)
        targets.neighbours = v.put(neighbours_of(v.scene), wp.vec3i)
        targets.albedo_scale = v.put(albedo_scale_of(v.scene, v.geometry, self._rigid.layout.tolerance), wp.float32)
        targets.charts = v.put(charts_of(v.scene, v.geometry), wp.int32)
        return targets

    @property
    def targets(self) -> Any:
        """Gives the kernels' struct of surfaces that rays can meet, with the present trees."""
        self._targets.casters = self.shading.occluders.casters
        return self._targets

    def begin(self, stamps: np.ndarray, gap: Span, poses: Poses) -> None:
        """Begins a gap; stamps: of all instants, int64 [n] or [E, n] ns. poses: at these."""
        self._stamps = stamps
        self.places.begin(stamps, gap.a, gap.b, gap.held, poses)

    def send(self, instants: list[int], upsampling: int) -> None:
        """Sends where moving bodies are at an instant for each slot, and how bright lamps are, and then `place` has to
        be called; instants: counted from 1, of `upsampling` in the gap."""
        v, rigid, shading = self.visibility, self._rigid, self.shading
        shading.update(self.places.place([i - 1 for i in instants]))
        v.settle()
        if instants != self._at:
            self._index.assign(np.array(instants, np.int32))
        self._at, self._upsampling = instants, upsampling
        if rigid.layout.flicker:
            shown = self._stamps[..., np.array(instants) - 1]
            shown = np.repeat(shown, self._envs) if shown.ndim == 1 else shown.T.reshape(-1)
            shading.set_times(shown)
            if rigid.layout.waveforms:
                strength = waveform_strengths(rigid.layout.waveforms, shown)
                self.strength.assign(strength.astype(np.float32).reshape(-1))

    def place(self) -> None:
        """Places bodies, lights and what casts shadows for what was sent: launches only."""
        v, rigid = self.visibility, self._rigid
        v.place_instances()
        rigid.pair.displace(v.camera_body, v.poses, self.motions)
        self.shading.place()
        self.shading.placed()
        if rigid.change is not None:
            rigid.change.place_beside(v, self.change)

    def reserve(self, size: int) -> None:
        """Makes room for lists of `size` pixels; entries there are lost where the arrays must grow."""
        if size > self._room:
            self._room = size + size // 2
            with wp.ScopedDevice(self.visibility.device):
                self.hits = wp.empty(self._room, dtype=wp.uint64)
                self.values = wp.empty(self._room, dtype=self._pixel)
                self._anew, self._places = (wp.empty(self._room, dtype=wp.int32) for _ in range(2))

    def workers(self, number: int) -> int:
        """Gives how many threads share list `number`, counted from 0."""
        return 1 if self.visibility.device.is_cpu else WORKERS[min(number, 1)]

    def evaluate(
        self, number: int, listed: wp.array, most: int, count: wp.array, bands: Sequence[int], unseen: wp.array
    ) -> None:
        """Computes `values` of the pixels of list `number`: launches only, but that a CPU reads how many are unseen.

        listed: int32, indices into [slots, E, h, w]; band k's begin at k * most. count [bands]: how many there are, of
        which the first `most` of a band are looked at. bands: those that have any. unseen [bands]: 0, to which is added
        how many neither keyframe shows.
        """
        v, rigid = self.visibility, self._rigid
        values = self.values.reshape((1, 1, -1))
        keys = rigid.pair.kernel(self.motions)
        lists = self._lists_of(number, listed, count, unseen)
        portion = self._portion
        portion.upsampling, portion.packed = self._upsampling, self.hits.reshape((1, 1, -1))
        portion.keyframes = wp.vec2i(rigid.pair.a.first, rigid.pair.b.first)
        how = [portion, keys, self.change, self.shading.seen, self.shading.surfaces, lists]
        workers = self.workers(number)
        launches: list[tuple[wp.Kernel, int, list[Any]]] = []
        for k in bands:
            given: list[Any] = [v.view, k * most, (k + 1) * most, workers, k, *how]
            launches.append((self._gather, workers, [*given, values]))
        rigid.sampling.launch(launches)
        # On a GPU reading the count would wait for the kernel, so the shading is launched in any case.
        if v.device.is_cpu and not unseen.numpy().any():
            return
        firsts = [k * most for k in range(self.bands)]
        self.shading.shade_list(self._radiance, self._anew, unseen, firsts, True)
        workers = 1 if v.device.is_cpu else LIST_WORKERS
        given = [self._envs, 1, v.margin, self._frame, self._anew, self._places, unseen, self._radiance, values]
        rigid.sampling.launch([(self._place, workers, [workers, first, k, *given]) for k, first in enumerate(firsts)])

    def lit(self) -> list[Any]:
        """Gives what single points are shaded by at the instants: poses, surfaces, lights, sky and casters."""
        shading = self.shading
        return [shading.seen, shading.surfaces, shading.lights.kernel, shading.sky, shading.occluders.casters, Grid()]

    def _lists_of(self, number: int, listed: wp.array, count: wp.array, unseen: wp.array) -> Any:
        """Gives the struct GatherLists of list `number`, which is made anew where an array is another one."""
        arrays = listed, count, self._anew, self._places, unseen
        known = self._lists.get(number)
        if known is None or any(old is not new for old, new in zip(known[0], arrays)):
            lists: Any = GatherLists()
            # Nothing is flagged here: a list of that is not read.
            lists.flagged, lists.flagged_count, lists.todo, lists.todo_count = listed, count, listed, count
            lists.pixels, lists.places, lists.count = self._anew, self._places, unseen
            known = self._lists[number] = arrays, lists
        return known[1]

    def _make_portion(self) -> Any:
        """Fills in what does not change of the struct that the gather kernel reads of the slots and of the scene."""
        portion: Any = Portion()
        layout, rigid = self._rigid.layout, self._rigid
        portion.slot0, portion.count, portion.envs, portion.frames = 0, self._slots, self._envs, 1
        set_divisors(portion, self.size[1], self.size[0])
        portion.tolerance, portion.relight = layout.tolerance, int(layout.relight)
        portion.pace = layout.pace
        portion.index, portion.frame, portion.strength = self._index, self._frame, self.strength
        portion.unchanged, portion.pieces = rigid.unchanged, rigid.pieces
        return portion
