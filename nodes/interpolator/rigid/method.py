"""`rigid`: every pixel of every sub-frame shows the surface point that is visible then, as the keyframes shaded it.

The renderer's raster finds the point at the sub-frame's own poses, so that geometry and silhouettes are exact. The
point is fixed to its body: its place in the cameras of keyframes A and B follows from the poses then, without any
assumption on the motion between. There log radiance is interpolated by cubic convolution within one smooth piece of
surface, which the keyframe's depth says is this one; where some of the 4 x 4 pixels about the place show another piece,
only if what is left is so even that it cannot be far off. The values of both keyframes are blended in time,
log L = (1 - f) log L_A + f log L_B, or that of the one which shows the point is taken. What neither shows well enough
(it is uncovered, or at a silhouette) and what they disagree about (its light changes) is shaded anew at its own time.
A shadow that comes and goes between two keyframes leaves no trace in either and is missed.

Where a pixel hardly moves over the surface that it shows, this is done at some of the sub-frames, and the others are
lines between them: see plan_kernels. Where the whole image hardly moves, not all triangles are drawn at each: see
sparse_raster.

Light with a waveform may be alike at both keyframes and differ in between. Where all lights that flicker share one, a
keyframe is shaded once with it at its mean and once without these lights; both are looked up and blended, and added up
as the waveform is at the sub-frame, L = L_without + w(t) (L_mean - L_without), which is exact. Where waveforms differ
every surface is shaded at its own time.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.clock import subframe_stamps
from evis.scene.model import Camera, Scene
from nodes.interpolator.keyframe import Report, View
from nodes.interpolator.rigid import keyframe_kernels
from nodes.interpolator.rigid.displacement_kernels import displace
from nodes.interpolator.rigid.gather_kernels import Scenery, make_gather, make_place
from nodes.interpolator.rigid.keyframes import Prepared
from nodes.interpolator.rigid.patches import patches_of
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.sampling import Part, Sampling, Todo
from nodes.interpolator.rigid.sparse_raster import SparseRaster
from nodes.renderer.geometry import is_static
from nodes.renderer.lights import waveform_strength
from nodes.renderer.path import PathOptions
from nodes.renderer.recording import Recording
from nodes.renderer.shading import LIST_WORKERS, Shading
from nodes.renderer.visibility import Visibility

TOLERANCE = 0.1
"""Difference of log radiance between the keyframes up to which light is taken to change evenly: half the contrast
threshold of common sensors."""

SAMPLE_PX = {True: 1.0, False: 0.0}
"""Path [px] between two samples of a pixel, on a CPU and on a GPU, where lists cost more than they save."""

HELD = int(keyframe_kernels.HELD)

PORTION, LEAST = {True: 1 << 21, False: 1 << 25}, 8
"""Pixels of the sub-frames that are worked on at once, on a CPU and on a GPU: what caches and memory hold; and least
sub-frames where there are lines between samples, in which case it is as on a CPU with one environment."""


class Rigid:
    """The method for E keyframes of one camera of a scene, of the same size."""

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        envs: int,
        upsampling: int,
        margin: int = 0,
        channels: int = 1,
        device: str = "cpu",
        threads: int = 1,
        light_samples: int = 16,
        paths: PathOptions | None = None,
        tolerance: float = TOLERANCE,
        sample_px: float | None = None,
        on_device: bool | None = None,
    ) -> None:
        """scene, camera, light_samples, paths: those of the renderer. upsampling: K. channels: 1 or 3. tolerance: error
        of log radiance that is looked for and shaded away. sample_px: path of a pixel over the surface that it shows up
        to which a sub-frame may be a line between two others; 0 = none is, None = SAMPLE_PX. on_device: all is decided
        on the device, for a GPU (None); otherwise by lists that the host divides. The frames are the same, bit for bit.
        """
        self._envs, self._upsampling, self._channels = envs, upsampling, channels
        self._margin, self._tolerance = margin, tolerance
        cpu = wp.get_device(device).is_cpu
        pixels = (camera.height + 2 * margin) * (camera.width + 2 * margin)
        waveforms = {light.waveform for light in scene.lights if light.waveform is not None}
        self._flicker = bool(waveforms)
        self._waveform = waveforms.pop() if len(waveforms) == 1 else None
        # Light that flickers is on no line.
        step = 0.0 if self._flicker else SAMPLE_PX[cpu] if sample_px is None else sample_px
        # Lines end with a portion, which must not depend on the device or on other environments.
        at_once = max(LEAST, PORTION[True] // pixels) if step > 0 else max(1, PORTION[cpu] // (envs * pixels))
        portions = -(-upsampling // at_once)
        self._slots = -(-upsampling // portions)
        self.visibility = Visibility(scene, camera, envs * self._slots, margin, device, threads)
        self.shading = Shading(self.visibility, light_samples=light_samples, paths=paths, remember=False)
        self._placement = Placement(scene)
        self._device = self.visibility.device
        shape = self.visibility.shape
        self._size = (shape[1] - 2 * margin, shape[2] - 2 * margin)
        # As many as the visibility has, for its bands shade the lists of these.
        self._bands = len(self.visibility.bands.rows)
        self._pool = ThreadPoolExecutor(self._bands) if self._bands > 1 else None
        bodies, exact = len(scene.bodies), self._waveform is not None
        self._a, self._b = (Prepared((envs, *shape[1:]), bodies, channels, self._device, exact) for _ in "AB")
        self._at_b: View | None = None
        self._even = True
        self._recording = Recording(self._device)
        # B's own slot comes first, so that its z-buffer is there for all the others.
        order = [upsampling, *range(1, upsampling)]
        self._portions = [order[k : k + self._slots] for k in range(0, upsampling, self._slots)]
        put = self.visibility.put
        self._index = [put(np.array(part, np.int32), wp.int32) for part in self._portions]
        self._scenery = Scenery()
        self._scenery.instance = self.visibility.triangle_instance
        patch, count = patches_of(scene)
        self._scenery.patch = put(patch, wp.int32)
        self._moving = put(self._may_move(patch, count), wp.int32)
        on = np.array([i.body if i.body >= 0 else bodies for i in scene.instances], np.int32)
        self._scenery.body = put(on, wp.int32)
        with wp.ScopedDevice(self._device):
            rows = envs * self._slots
            self._turn = [wp.empty((rows, bodies + 2), dtype=wp.mat33) for _ in "AB"]
            self._shift = [wp.empty((rows, bodies + 2), dtype=wp.vec3) for _ in "AB"]
            self._pixels = wp.empty(rows * self._size[0] * self._size[1], dtype=wp.int32)
            self._radiance = wp.empty(shape, dtype=wp.vec3)
            self._quiet = wp.empty((envs, *shape[1:]), dtype=wp.uint64)
            self._still = wp.zeros((envs, bodies + 2), dtype=wp.int32)
            # Of the last sub-frame of the portion before.
            self._before = wp.empty((envs, bodies), dtype=wp.transformd), wp.empty_like(self._quiet)
            self._strength = wp.zeros(self._slots if exact else 0, dtype=wp.float32)
            whole = envs * shape[1] * shape[2] if exact else 0
            # B's own slot is the first: the pixels of its environments are the first of all.
            starts = [whole * k // self._bands for k in range(self._bands + 1)]
            self._all: wp.array = wp.array(np.arange(whole, dtype=np.int32))
            self._all_count: wp.array = wp.array(np.diff(starts).astype(np.int32))
            self._all_starts = starts[:-1]
        self._flags = np.zeros(self._still.shape, np.int32)
        self._movers = np.array([n for n in range(bodies) if not is_static(scene, n)], np.int64)
        # The portion that lights and what casts shadows are placed for.
        self._lit: Part | None = None
        self._loaded = False
        on_device = not cpu if on_device is None else on_device
        # What is quick to look up in the order of the pixels; only the rest is listed.
        self._staged = on_device and step == 0
        self._sampling = Sampling(
            self.visibility, self._scenery, envs, self._slots, portions, upsampling, channels, step,
            float(np.exp(tolerance / 2)), on_device, self._pool,
        )  # fmt: skip
        self._sparse: SparseRaster | None = None
        self._strides = [1] * envs
        if step > 0 and SparseRaster.pays(self.visibility):
            self._sparse = SparseRaster(self.visibility, envs, step)
        self._count = wp.zeros(self._sampling.counts.size + 1, dtype=wp.int32, device=self._device)
        self._buffer: wp.array | None = None
        self._first_look = make_gather(self.visibility.lens, channels, listed=False, flicker=exact)
        self._gather = make_gather(self.visibility.lens, channels, listed=True, flicker=exact)
        self._place = make_place(channels)

    def between(self, a: View, b: View, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array) -> Report:
        """See Method. Views need `states` and `stamp_ns`; out may be an array of the device."""
        assert a.states is not None and b.states is not None
        stamps = subframe_stamps(a.stamp_ns, b.stamp_ns, self._upsampling)
        poses = self._placement.at(stamps, b.states)
        before = np.asarray(a.states.pose[:, -1])
        # An environment that begins an episode stands where it is at B, and is B throughout.
        held = np.asarray(held, bool)
        poses[:, held] = poses[-1, held]
        if self._at_b is not a:
            self._prepare(a, before)
        self._a, self._b = self._b, self._a
        self._at_b = b
        self._b.take(b.image)
        self._find_still(poses, before, held)
        if self._sparse is not None:
            eyes = np.concatenate([before[None], poses])[:, :, self.visibility.camera_body]
            self._strides = self._sparse.strides(eyes, self._a.packed)
        frames = self._target(out)
        for portion, part in enumerate(self._portions):
            # Slots that are left over repeat the last one.
            slots = [part[min(s, len(part) - 1)] - 1 for s in range(self._slots)]
            placed = self.visibility.frames(poses[slots].reshape(-1, *poses.shape[2:]))
            self.visibility.place(placed)
            self.shading.update(placed)
            if self._flicker:
                self.shading.set_times(np.repeat(stamps[slots], self._envs))
            if self._waveform is not None:
                strength = [waveform_strength(self._waveform, int(t)) for t in stamps[slots]]
                self._strength.assign(np.array(strength, np.float32))
            key = (portion, self._even, self.visibility.still_moved)
            self._recording.run(key, partial(self._launch, portion, frames))
            self.visibility.drawn()
        self._even = not self._even
        if self._device.is_cuda:
            self._placement.expect(stamps)
        if frames is self._buffer:
            self._hand_over(frames, out)
        return self._report()

    def _may_move(self, patch: np.ndarray, count: int) -> np.ndarray:
        """Whether each of the patches may ever move against the camera, bool [count]."""
        v = self.visibility
        if not is_static(v.scene, v.camera_body):
            return np.ones(count, bool)
        moving = np.zeros(count, bool)
        moving[patch[~v.geometry.static[v.geometry.triangle_instance]]] = True
        return moving

    def _launch(self, portion: int, frames: wp.array) -> None:
        """One portion of the sub-frames for what is placed; the first one begins with B itself, the last one ends with
        it. Launches only, which a GPU may have recorded."""
        v, part = self.visibility, self._portions[portion]
        first, closed = int(portion == 0), portion == len(self._portions) - 1
        count = len(part) - first
        if max(self._strides) > 1 and self._sparse is not None:
            self._sparse.draw(first, count, self._strides, closed)
        else:
            v.draw()
        if first:
            self._count.zero_()
            self._sampling.clear()
            if self._waveform is not None:
                self._b.take_lights(self._lit_by)
            self._b.fill(v, self._envs, self._scenery.patch, self._moving, self._count[-1:])
            self._find_quiet()
        if closed:
            m, image = self._margin, self._b.image
            by_env = frames.reshape((self._envs, self._upsampling, *self._size))
            wp.copy(by_env[:, self._upsampling - 1], image[:, m : image.shape[1] - m, m : image.shape[2] - m])
        if count:
            for then, turn, shift in zip((self._a, self._b), self._turn, self._shift):
                given = [v.camera_body, v.poses, then.poses]
                wp.launch(displace, turn.shape, given, [turn, shift], device=self._device)
            before = (self._a.poses, self._a.packed) if first else self._before
            self._sample(Part(portion, first, count, part[first] - 1, closed, before), frames)
            if not closed:
                last = slice((len(part) - 1) * self._envs, len(part) * self._envs)
                for source, target in zip((v.poses, v.packed), self._before):
                    wp.copy(target, source[last])

    def _lit_by(self, which: str) -> wp.array:
        """Radiance of all pixels of the first slot, with the lights so strong."""
        self.shading.lights.select(which)
        self.shading.shade_list(self._radiance, self._all, self._all_count, self._all_starts)
        self.shading.lights.select("now")
        return self._radiance

    def _report(self) -> Report:
        count = self._count.numpy()
        samples = self._envs * (self._upsampling - 1) * self._size[0] * self._size[1]
        sampled = samples if self._staged else int(self._sampling.counts.numpy().sum())
        return Report(nonfinite=int(count[-1]), reshaded=int(count[:-1].sum()), samples=samples, sampled=sampled)

    def _find_still(self, poses: np.ndarray, before: np.ndarray, held: np.ndarray) -> None:
        """Which bodies do not move against the camera in the gap, for `find_quiet`."""
        # Others are at each sub-frame where they are at the last one.
        movers = self._movers
        still = (poses[-1] == before).all(axis=-1)
        still[:, movers] &= (poses[:-1].take(movers, axis=2) == before.take(movers, axis=1)).all(axis=(0, 3))
        camera = still[:, self.visibility.camera_body, None] & (not self._flicker)
        # What emits no light changes with the lamps, but the sky does not.
        rests = still[:, self.visibility.camera_body, None]
        flags = np.concatenate([still & camera, camera, rests], axis=1).astype(np.int32)
        flags[held] = HELD
        if not np.array_equal(flags, self._flags):
            self._flags = flags
            self._still.assign(flags)

    def _find_quiet(self) -> None:
        """Pixels that do not change unless something comes before them."""
        v, a, b = self.visibility, self._a, self._b
        given = [v.span, a.packed, b.packed, a.image, b.image, v.triangle_instance, self._scenery.body, self._still]
        dim = (self._envs, v.shape[1], v.shape[2] // v.span)
        wp.launch(keyframe_kernels.find_quiet, dim, given, [self._quiet], device=self._device)

    def _sample(self, part: Part, frames: wp.array) -> None:
        """Look up what may have changed, shade what no keyframe shows, and again where samples are too far apart."""
        todo: Todo | None
        how = self._arguments(part)
        self._lit = None
        if self._staged:
            todo = self._first_pixels(part, how, frames)
        else:
            todo = self._sampling.plan(part, self._b, self._quiet, frames)
        while todo is not None:
            self._shade(part, todo, self._look_up(todo, how, frames), frames)
            todo = self._sampling.refine(self._a)

    def _arguments(self, part: Part) -> list[Any]:
        """What the kernels that look up have in common."""
        a, b = (key.seen_from(*moved) for key, moved in zip((self._a, self._b), zip(self._turn, self._shift)))
        relight = int(self._flicker and self._waveform is None)
        how: list[Any] = [part.slot0, self._envs, self._upsampling, self._tolerance, relight]
        how += [self._index[part.number], self._strength]
        return [*how, self.visibility.packed, self._quiet, self._scenery, a, b]

    def _first_pixels(self, part: Part, how: list[Any], frames: wp.array) -> Todo:
        """Look up all pixels of a portion but those that need care, which are listed."""
        todo = self._sampling.everything(part)
        dim = part.count * self._envs * self._size[0] * self._size[1]
        given = [self.visibility.view, 0, 0, 1, todo.at, *how, todo.pixels, self._sampling.counts]
        wp.launch(self._first_look, dim, [*given, frames, self._pixels, self._count], device=self._device)
        return todo

    def _look_up(self, todo: Todo, how: list[Any], frames: wp.array) -> list[int]:
        """Look up what is listed. Gives where the list of each band begins of what no keyframe shows."""
        view, made = self.visibility.view, [frames, self._pixels, self._count]
        shared = [*how, todo.pixels, self._sampling.counts, *made]
        if todo.starts is None:
            given: list[Any] = [view, 0, -1, LIST_WORKERS, todo.at, *shared]
            wp.launch(self._gather, LIST_WORKERS, given, device=self._device)
            return [0] * self._bands
        launches = [
            (self._gather, 1, [view, first, last, 1, todo.at + k, *shared])
            for k, (first, last) in enumerate(pairwise(todo.starts))
        ]
        self._sampling.launch(launches)
        return todo.starts[:-1]

    def _shade(self, part: Part, todo: Todo, firsts: list[int], frames: wp.array) -> None:
        """The listed pixels, anew."""
        count = self._count[todo.at : todo.at + self._bands]
        # The first time also for nothing, so that what is rehearsed loads all kernels.
        if self._loaded and todo.starts is not None and not count.numpy().any():
            return
        self._loaded = True
        self.shading.shade_list(self._radiance, self._pixels, count, firsts, self._lit is part)
        self._lit = part
        workers = 1 if self._device.is_cpu else LIST_WORKERS
        for band, first in enumerate(firsts):
            given: list[Any] = [workers, first, band, self._envs, self._upsampling, self._margin]
            given += [self._index[part.number], self._pixels, count, self._radiance]
            wp.launch(self._place, workers, given, [frames], device=self._device)

    def _prepare(self, view: View, poses: np.ndarray) -> None:
        """A keyframe whose z-buffer is not there from the gap before."""
        v = self.visibility
        placed = v.frames(np.tile(poses, (self._slots, 1, 1)))
        if self._sparse is not None:
            v.place(placed)
            self._sparse.draw(1, 0, [1] * self._envs, True)
            v.drawn()
        else:
            v.update(placed)
        self._b.take(view.image)
        if self._waveform is not None:
            self.shading.update(placed)
            self._b.take_lights(self._lit_by)
        self._b.fill(self.visibility, self._envs, self._scenery.patch, self._moving, self._count[-1:])

    def _target(self, out: np.ndarray | wp.array) -> wp.array:
        """The output on a CPU, a buffer in its place on a GPU, as [E K, h, w] pixels."""
        pixel: Any = wp.float32 if self._channels == 1 else wp.vec3
        shape = (self._envs * self._upsampling, *self._size)
        if self._device.is_cpu:
            given = out.numpy() if isinstance(out, wp.array) else out
            return wp.array(given, dtype=pixel, shape=shape, copy=False, device="cpu")
        if self._buffer is None:
            self._buffer = wp.empty(shape, dtype=pixel, device=self._device)
        return self._buffer

    def _hand_over(self, frames: wp.array, out: np.ndarray | wp.array) -> None:
        """Copy what a GPU has made to where it is wanted."""
        if isinstance(out, wp.array):
            wp.copy(out.flatten(), frames.flatten())
        else:
            out[...] = frames.numpy().reshape(out.shape)
