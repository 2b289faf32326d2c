"""`rigid`: every pixel of every sub-frame shows the surface point that is visible then, as the keyframes shaded it.

The renderer's raster finds the point at the sub-frame's own poses, so that geometry and silhouettes are exact. The
point is fixed to its body: its place in the cameras of keyframes A and B follows from the poses then, without any
assumption on the motion between. There log radiance is interpolated by cubic convolution within one smooth piece of
surface, which the keyframe's depth says is this one; where some of the 4 x 4 pixels about the place show another piece,
only if what is left is so even that it cannot be far off. The values of both keyframes are blended in time,
log L = (1 - f) log L_A + f log L_B, or that of the one which shows the point is taken. What neither shows well enough
(it is uncovered, or at a silhouette) and what they disagree about (its light changes) is shaded anew at its own time.
A shadow that comes and goes between two keyframes leaves no trace in either and is missed.

Light with a waveform may be alike at both keyframes and differ in between. Where all lights that flicker share one, a
keyframe is shaded once with it at its mean and once without these lights; both are looked up and blended, and added up
as the waveform is at the sub-frame, L = L_without + w(t) (L_mean - L_without), which is exact. Where waveforms differ
every surface is shaded at its own time.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
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
from nodes.renderer.geometry import is_static
from nodes.renderer.lights import waveform_strength
from nodes.renderer.path import PathOptions
from nodes.renderer.recording import Recording
from nodes.renderer.shading import LIST_WORKERS, Shading
from nodes.renderer.visibility import Visibility

TOLERANCE = 0.1
"""Difference of log radiance between the keyframes up to which light is taken to change evenly: half the contrast
threshold of common sensors."""

HELD = int(keyframe_kernels.HELD)

PORTION = {True: 1 << 20, False: 1 << 25}
"""Pixels of the sub-frames that are worked on at once, on a CPU and on a GPU: what caches and memory hold."""


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
        staged: bool | None = None,
    ) -> None:
        """scene, camera, light_samples, paths: those of the renderer. upsampling: K. channels: 1 or 3. tolerance: error
        of log radiance that is looked for and shaded away. staged: a thread for every pixel first and the hard ones
        later, for a GPU (None); otherwise a list of what has changed. The frames are the same, bit for bit."""
        self._envs, self._upsampling, self._channels = envs, upsampling, channels
        self._margin, self._tolerance = margin, tolerance
        pixels = envs * (camera.height + 2 * margin) * (camera.width + 2 * margin)
        cpu = wp.get_device(device).is_cpu
        portions = -(-upsampling // max(1, PORTION[cpu] // pixels))
        waveforms = {light.waveform for light in scene.lights if light.waveform is not None}
        self._flicker = bool(waveforms)
        self._waveform = waveforms.pop() if len(waveforms) == 1 else None
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
            self._count = wp.zeros(len(self._portions) * self._bands + 1, dtype=wp.int32)
            self._pixels = wp.empty(rows * self._size[0] * self._size[1], dtype=wp.int32)
            self._radiance = wp.empty(shape, dtype=wp.vec3)
            self._quiet = wp.empty((envs, *shape[1:]), dtype=wp.uint64)
            self._still = wp.zeros((envs, bodies + 2), dtype=wp.int32)
            self._staged = not cpu if staged is None else staged
            self._todo = wp.empty(self._pixels.size if self._staged else 0, dtype=wp.int32)
            self._todo_count = wp.zeros_like(self._count)
            self._strength = wp.zeros(self._slots if exact else 0, dtype=wp.float32)
            whole = envs * shape[1] * shape[2] if exact else 0
            # B's own slot is the first: the pixels of its environments are the first of all.
            starts = [whole * k // self._bands for k in range(self._bands + 1)]
            self._all: wp.array = wp.array(np.arange(whole, dtype=np.int32))
            self._all_count: wp.array = wp.array(np.diff(starts).astype(np.int32))
            self._all_starts = starts[:-1]
        self._flags = np.zeros(self._still.shape, np.int32)
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
        v.draw()
        first = int(portion == 0)
        if first:
            self._count.zero_()
            self._todo_count.zero_()
            if self._waveform is not None:
                self._b.take_lights(self._lit_by)
            self._b.fill(v, self._envs, self._scenery.patch, self._moving, self._count[-1:])
            self._find_quiet()
        count = len(part) - first
        if count:
            for then, turn, shift in zip((self._a, self._b), self._turn, self._shift):
                given = [v.camera_body, v.poses, then.poses]
                wp.launch(displace, turn.shape, given, [turn, shift], device=self._device)
            self._shade(portion, self._look_up(portion, first, count, frames), frames)
        if portion == len(self._portions) - 1:
            m, image = self._margin, self._b.image
            by_env = frames.reshape((self._envs, self._upsampling, *self._size))
            wp.copy(by_env[:, self._upsampling - 1], image[:, m : image.shape[1] - m, m : image.shape[2] - m])

    def _lit_by(self, which: str) -> wp.array:
        """Radiance of all pixels of the first slot, with the lights so strong."""
        self.shading.lights.select(which)
        self.shading.shade_list(self._radiance, self._all, self._all_count, self._all_starts)
        self.shading.lights.select("now")
        return self._radiance

    def _report(self) -> Report:
        count = self._count.numpy()
        samples = self._envs * (self._upsampling - 1) * self._size[0] * self._size[1]
        return Report(nonfinite=int(count[-1]), reshaded=int(count[:-1].sum()), samples=samples)

    def _find_still(self, poses: np.ndarray, before: np.ndarray, held: np.ndarray) -> None:
        """Which bodies do not move against the camera in the gap, for `find_quiet`."""
        still = (poses == before).all(axis=(0, 3))
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

    def _look_up(self, portion: int, first: int, count: int, frames: wp.array) -> list[int]:
        """Look everything up that may have changed. Gives where the list of each band begins."""
        v = self.visibility
        a, b = (key.seen_from(*moved) for key, moved in zip((self._a, self._b), zip(self._turn, self._shift)))
        envs, (height, width) = self._envs, self._size
        relight = int(self._flicker and self._waveform is None)
        how: list[Any] = [first, envs, self._upsampling, self._tolerance, relight, self._index[portion]]
        how += [self._strength, v.packed, self._quiet, self._scenery, a, b]
        made = [frames, self._pixels, self._count]
        bands = self._bands
        if self._staged:
            shared = [*how, self._todo, self._todo_count, *made]
            dim = count * envs * height * width
            wp.launch(self._first_look, dim, [v.view, 0, 0, 1, portion * bands, *shared], device=self._device)
            given: list[Any] = [v.view, 0, -1, LIST_WORKERS, portion * bands, *shared]
            wp.launch(self._gather, LIST_WORKERS, given, device=self._device)
            return [0] * bands
        todo = self._changed(portion, first, count, frames)
        starts: list[Any] = [len(todo) * k // bands for k in range(bands + 1)]
        listed: wp.array = wp.array(todo, dtype=wp.int32, copy=False, device="cpu")
        launches = []
        for k in range(bands):
            given = [v.view, *starts[k : k + 2], 1, portion * bands + k, *how, listed, self._count, *made]
            launches.append(wp.launch(self._gather, 1, given, device="cpu", record_cmd=True))
        if self._pool is None:
            launches[0].launch()
        else:
            list(self._pool.map(lambda launch: launch.launch(), launches))
        return starts[:-1]

    def _changed(self, portion: int, first: int, count: int, frames: wp.array) -> np.ndarray:
        """On a CPU: B in all frames, and the pixels int32 [n] of [count, E, h, w] where that is not what is seen."""
        v, m, (height, width) = self.visibility, self._margin, self._size
        inner = (..., slice(m, m + height), slice(m, m + width))
        image = self._b.image.numpy()[:, m : m + height, m : m + width]
        by_env = frames.numpy().reshape(self._envs, self._upsampling, height, width, -1)
        which = np.array(self._portions[portion][first:]) - 1
        by_env[:, which] = image.reshape(self._envs, 1, height, width, -1)
        packed = v.packed.numpy().reshape(self._slots, self._envs, *v.shape[1:])[first : first + count]
        return np.flatnonzero(packed[inner] != self._quiet.numpy()[inner]).astype(np.int32)

    def _shade(self, portion: int, firsts: list[int], frames: wp.array) -> None:
        """The listed pixels, anew."""
        bands = self._bands
        count = self._count[portion * bands : (portion + 1) * bands]
        self.shading.shade_list(self._radiance, self._pixels, count, firsts)
        workers = 1 if self._device.is_cpu else LIST_WORKERS
        for band, first in enumerate(firsts):
            given: list[Any] = [workers, first, band, self._envs, self._upsampling, self._margin]
            given += [self._index[portion], self._pixels, count, self._radiance]
            wp.launch(self._place, workers, given, [frames], device=self._device)

    def _prepare(self, view: View, poses: np.ndarray) -> None:
        """A keyframe whose z-buffer is not there from the gap before."""
        placed = self.visibility.update(np.tile(poses, (self._slots, 1, 1)))
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
