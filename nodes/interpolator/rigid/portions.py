"""Makes the frames of a gap, one portion of its sub-frames after the other: places bodies, draws who is seen, and looks
that up in the keyframes. It launches; nothing here waits for a GPU."""

from __future__ import annotations

from functools import partial

import numpy as np
import warp as wp

from evis.gpu.cuda_graph import Branch, CudaGraphs
from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.relight.change import LightChange
from nodes.interpolator.rigid import keyframe_kernels
from nodes.interpolator.rigid.keyframes import KeyframePair
from nodes.interpolator.rigid.layout import Layout
from nodes.interpolator.rigid.reprojection import Reprojection
from nodes.interpolator.rigid.sampling import SubframeRange
from nodes.interpolator.rigid.slots import Slots
from nodes.renderer.lighting import Shading
from nodes.renderer.lights.lights import waveform_strengths


class Portions:
    """Makes the portions that a layout says, of one gap after another: `begin`, then `make`.

    unchanged: uint64 [E, H, W], z-buffer entries with which pixels show the same all through the gap.
    """

    def __init__(
        self,
        places: Slots,
        shading: Shading,
        layout: Layout,
        pair: KeyframePair,
        reprojection: Reprojection,
        change: LightChange | None,
        filling: tuple[wp.array, wp.array, float, wp.array],
    ) -> None:
        """Takes what places, draws, holds the keyframes and looks up. change: tells where light changes, if it can.
        filling: arguments of PreparedKeyframe.fill."""
        self._places, self._shading, self._layout, self._pair = places, shading, layout, pair
        self._reprojection, self._change, self._filling = reprojection, change, filling
        self._pieces = filling[0]
        v = self._v = shading.visibility
        self._device = v.device
        self._size = (v.shape[1] - 2 * v.margin, v.shape[2] - 2 * v.margin)
        self._graphs, self._beside = CudaGraphs(v.device), Branch(v.device)
        self._turn = 0
        """0 and 1 by turns: of two places in memory one is B's, and what is recorded for a GPU is of that."""
        envs, bodies = layout.envs, len(v.names)
        with wp.ScopedDevice(v.device):
            self.unchanged = wp.empty((envs, *v.shape[1:]), dtype=wp.uint64)
            self._still = wp.zeros((envs, bodies + 2), dtype=wp.int32)
            # Of the last sub-frame of the portion before.
            self._before = wp.empty((envs, bodies), dtype=wp.transformd), wp.empty_like(self.unchanged)
        self._flags = np.zeros(self._still.shape, np.int32)

    def begin(self, unknown: KeyframeView | None) -> None:
        """Begins a gap: the keyframe that ended the last one is A, or, after anything else, one that is unknown."""
        self._pair.swap(self._graphs)
        if unknown is not None:
            self._prepare(unknown)

    def make(self, b: KeyframeView, held: np.ndarray, stamps: np.ndarray, frames: wp.array) -> None:
        """Makes all frames of the gap up to keyframe b.

        held: bool [E], environments that are at b all along. stamps: int64 [K] or [E, K] ns. frames: [E K, h, w].
        """
        for portion, slots in enumerate(self._layout.shown):
            self._shading.update(self._places.place(slots))
            # Launches that were recorded before the occluders' trees were built know others.
            builds = self._shading.occluders.builds
            key = portion, self._turn, builds, self._v.still_moved, self._v.coming
            self._graphs.run(("draw", *key), partial(self._draw, portion))
            self._v.drawn()
            # While a GPU draws.
            if portion == 0:
                self._take(b, held)
            if self._layout.flicker:
                together = stamps.ndim == 1
                shown = np.repeat(stamps[slots], self._layout.envs) if together else stamps.T[slots].reshape(-1)
                self._shading.set_times(shown)
            if self._layout.waveforms:
                self._reprojection.strength.assign(
                    waveform_strengths(self._layout.waveforms, shown).astype(np.float32).reshape(-1)
                )
            self._graphs.run(("look", portion, self._turn, builds), partial(self._reproject, portion, frames))
        self._turn = 1 - self._turn

    def _prepare(self, view: KeyframeView) -> None:
        """Prepares a keyframe whose z-buffer is not there from the gap before."""
        v = self._v
        placed = self._places.place_before()
        v.draw()
        v.drawn()
        a = self._pair.a
        a.take(view.image)
        a.take_poses(v, self._layout.envs)
        if self._change is not None:
            self._change.take(a.first, a.poses)
        a.take_packed(v, self._layout.envs)
        if self._layout.waveforms:
            self._shading.update(placed)
            a.take_lights(self._layout.waveforms, partial(self._reprojection.light, placed=False))
        a.fill(*self._filling)
        self._reprojection.demodulate(a)

    def _take(self, b: KeyframeView, held: np.ndarray) -> None:
        """Prepares what does not depend on the sub-frames: the later keyframe, and what stands still before it."""
        self._pair.b.take(b.image)
        flags = self._places.still(self._layout.flicker, held)
        if self._change is not None:
            flags = self._change.begin(self._places.poses, flags)
        if flags is not self._flags and not np.array_equal(flags, self._flags):
            self._still.assign(flags)
        self._flags = flags

    def _draw(self, portion: int) -> None:
        """Draws who is seen in a portion of the sub-frames, for what is placed; the first one begins with B itself.
        Launches only, which a GPU may have recorded."""
        v = self._v
        v.arrive()
        v.draw(partial(self._launch_beside, portion))
        self._beside.join()

    def _reproject(self, portion: int, frames: wp.array) -> None:
        """Computes the frames of a portion that is drawn: launches only."""
        v, part = self._v, self._layout.portions[portion]
        first, closed = int(portion == 0), portion == len(self._layout.portions) - 1
        count = len(part) - first
        if first:
            self._pair.b.take_packed(v, self._layout.envs)
        with self._beside.aside():
            if closed:
                m, image = v.margin, self._pair.b.image
                by_env = frames.reshape((self._layout.envs, self._layout.upsampling, *self._size))
                wp.copy(
                    by_env[:, self._layout.upsampling - 1], image[:, m : image.shape[1] - m, m : image.shape[2] - m]
                )
            if first:
                self._find_unchanged()
                if self._change is not None:
                    self._change.exclude_relit(self._pieces, self.unchanged)
        if first:
            if self._layout.waveforms:
                self._pair.b.take_lights(self._layout.waveforms, partial(self._reprojection.light, placed=True))
            self._pair.b.fill(*self._filling)
            self._reprojection.demodulate(self._pair.b)
        self._beside.join()
        if count:
            before = (self._pair.a.poses, self._pair.a.packed) if first else self._before
            given = SubframeRange(portion, first, count, part[first] - 1, closed, before)
            self._reprojection.reproject(given, self._pair, self.unchanged, frames)
            if not closed:
                last = slice((len(part) - 1) * self._layout.envs, len(part) * self._layout.envs)
                for source, target in zip((v.poses, v.packed), self._before):
                    wp.copy(target, source[last])

    def _launch_beside(self, portion: int) -> None:
        """Launches what needs the placed instances but not who is seen: beside the raster on a GPU."""
        with self._beside.aside():
            if portion == 0:
                self._reprojection.clear()
                self._take_poses()
            self._reprojection.place(self._pair)
            if self._change is not None:
                self._change.place()

    def _find_unchanged(self) -> None:
        """Finds the pixels that do not change unless something comes before them."""
        v, a, b = self._v, self._pair.a, self._pair.b
        given = [v.span, a.packed, v.packed[: self._layout.envs], a.image, b.image, self._pieces, self._still]
        dim = (self._layout.envs, v.shape[1], v.shape[2] // v.span)
        wp.launch(keyframe_kernels.find_unchanged, dim, given, [self.unchanged], device=self._device)

    def _take_poses(self) -> None:
        """Reads where bodies, lights and casters are at keyframe B: launches only."""
        self._pair.b.take_poses(self._v, self._layout.envs)
        if self._change is not None:
            self._change.take(*self._pair.fresh)
