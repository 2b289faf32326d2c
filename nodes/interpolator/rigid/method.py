"""Implements `rigid`: every pixel of every sub-frame shows the surface point that is visible then, as the keyframes
shaded it.

The renderer's raster finds the point at the sub-frame's own poses, so that geometry and silhouettes are exact. The
point is fixed to its body: its place in the cameras of keyframes A and B follows from the poses then, without any
assumption on the motion between. There log radiance is interpolated by cubic convolution within one smooth piece of
surface, which the keyframe's depth says is this one; where some of the 4 x 4 pixels about the place show another piece,
only if what is left is so even that it cannot be far off. The values of both keyframes are blended in time,
log L = (1 - f) log L_A + f log L_B, or that of the one which shows the point is taken. What neither shows well enough
(it is uncovered, at a silhouette, or too fine for the keyframe's pixels) and what they disagree about is shaded anew at
its own time. So is what they agree about although its light changes in between: see `relight`, which computes that.

Where a pixel hardly moves over the surface that it shows, this is done at some of the sub-frames, and the others are
lines between them: see plan_kernels.

Light with a waveform may be alike at both keyframes and differ in between. A keyframe is shaded once without lights
that flicker, and for each waveform once with its lights at their mean besides; all are looked up and blended, and added
up as the waveforms are at the sub-frame, L = L_without + sum_i w_i(t) (L_i - L_without), which is exact. Where there
are too many waveforms every surface is shaded at its own time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK, begin_building, build_together
from evis.gpu.host_copies import HostCopies
from evis.runtime.workers import Workers
from evis.scene.model import Camera, Scene
from nodes.interpolator.displacement_kernels import displace
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.keyframe import KeyframeView, Report, Span
from nodes.interpolator.relight.change import make_light_change
from nodes.interpolator.relight.sweep_kernels import sweep
from nodes.interpolator.relight.swept_kernels import exclude_relit
from nodes.interpolator.rigid.keyframes import KeyframePair
from nodes.interpolator.rigid.layout import RigidOptions, layout_of
from nodes.interpolator.rigid.look_up.look_up_kernels import FINE
from nodes.interpolator.rigid.patches import moving_patches, pieces_of
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.portions import Portions
from nodes.interpolator.rigid.reprojection import Reprojection, textured_in
from nodes.interpolator.rigid.sampling import Sampling
from nodes.interpolator.rigid.slots import Poses, Slots
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.lighting import Shading
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions


class Rigid:
    """Makes the frames between keyframes from the bodies' poses, for E keyframes of one camera, of the same size."""

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
        options: RigidOptions | None = None,
        worlds: Sequence[Scene] = (),
        in_a_row: bool = False,
        late: bool = False,
    ) -> None:
        """Takes a scene and the shape of what is made.

        scene, camera: those of the renderer. upsampling: K. margin: pixels beyond the image on every side. channels: 1
        or 3. threads: of a CPU. worlds: see Placement. in_a_row: the environments are gaps of one environment, each of
        which begins where the one before ends: views have times of their `own`, and the last one's B is the first one's
        A of the next call. late: `between` gives the report of the gap before, so that nobody waits for a GPU, as it
        does of gaps in a row; see `last_report`.
        """
        asked, cpu = options or RigidOptions(), wp.get_device(device).is_cpu
        self.layout = layout_of(scene, camera, envs, upsampling, margin, channels, cpu, asked)
        slots = self.layout.slots
        self.placement = Placement(scene, worlds, envs, threads)
        sparse = True if len(self.placement.movers) else None
        v = self.visibility = Visibility(scene, camera, envs * slots, margin, device, threads, sparse=sparse)
        self._places = Slots(scene, v, self.placement, slots)
        self.shading = Shading(v, ShadingOptions(asked.light_samples, asked.paths, remember=False))
        self._device = v.device
        self.size = (v.shape[1] - 2 * margin, v.shape[2] - 2 * margin)
        textured = textured_in(self.shading, self.layout)
        keyframe, bodies = (envs, *v.shape[1:]), len(scene.bodies)
        waveform_count = self.layout.waveform_count
        self.pair = KeyframePair(keyframe, slots, bodies, channels, self._device, waveform_count, textured, in_a_row)
        self.in_a_row = in_a_row
        """Whether the environments are gaps of one."""
        self._at_b: KeyframeView | None = None
        self._foreseen: tuple[Span, Poses] | None = None
        """A gap that is to come, and its poses."""
        self._held = np.zeros(envs, bool)
        """Environments that began an episode with that keyframe."""
        self.rested = False
        """Whether nothing moved or changed in the last gap."""
        self.looks_at: Callable[[Span], np.ndarray] | None = None
        """Gives the times of a gap at which others look besides: what swings may be back at every frame."""
        self._built = False
        pieces, patches = pieces_of(scene, v.geometry.triangle_instance)
        self.pieces = v.put(pieces, wp.vec2i)
        # As many threads as share the visibility's rows, for these shade the lists.
        tiles = len(v.row_tiles.rows)
        pool = Workers(tiles) if tiles > 1 else None
        lit_by_paths = asked.paths is not None
        self.change = make_light_change(
            self.shading, envs, self.placement.movers, asked.tolerance, lit_by_paths, in_a_row
        )
        self.sampling = Sampling(v, self.pieces, self.layout, pool, self.change)
        self._reprojection = Reprojection(self.shading, self.sampling, self.pieces, self.layout, self.change)
        moving = v.put(moving_patches(pieces, patches, v.geometry, is_static(scene, v.camera_body)), wp.int32)
        straight = FINE * self.layout.tolerance if textured else -1.0
        filling = self.pieces, moving, straight, self._reprojection.nonfinite
        self._portions = Portions(
            self._places, self.shading, self.layout, self.pair, self._reprojection, self.change, filling
        )
        self.unchanged = self._portions.unchanged
        self._counts = [HostCopies(counted) for counted in self._reprojection.counted]
        self._late = late or in_a_row
        self._unread: Callable[[], Report] | None = None
        """Waits for the report of the last gap and gives it, where nobody has got it yet as reports are late."""
        self._buffer: wp.array | None = None

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        changes = [(exclude_relit, LAUNCH_BLOCK), (sweep, LAUNCH_BLOCK)] if self.change else []
        between = [(displace, LAUNCH_BLOCK), *self.pair.kernels(), *changes]
        return [*self._reprojection.kernels(), *self.visibility.kernels(), *between]

    def begin_build(self) -> None:
        """Has its kernels compiled, while the caller does something else, for the first gap."""
        begin_building(self._device, self.kernels())

    @property
    def strength(self) -> wp.array:
        """Gives how strong lights that flicker are at what was drawn, float32 [slots E waveforms], empty without
        such."""
        return self._reprojection.strength

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """Implements `Method.between`. Views need `states` and `stamp_ns`; out may be an array of the device. Where
        reports are `late` it is that of the gap before."""
        return self.begin(a, b, held, out)()

    def begin(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array | None
    ) -> Callable[[], Report]:
        """Makes the frames as `between` does, without a wait for a GPU; what it returns waits, and gives the report.

        out: None on a GPU where `hand_over` is to write the frames later.
        """
        assert a.states is not None and b.states is not None
        if not self._built:
            build_together(self._device, self.kernels())
            self._built = True
        held = np.asarray(held, bool)
        gap = Span.between(a, b, held)
        together, stamps = not gap.apart, gap.stamps(self.layout.upsampling)
        places = self._places
        known, self._foreseen = self._foreseen, None
        poses = known[1] if known is not None and known[0].same(gap) else None
        places.begin(stamps, a.states, b.states, held, poses)
        begun = self._begun(a, held)
        self.rested = self._rests(gap, a, b, begun)
        if self.rested:
            still = self._rest(b, out)
            return lambda: still
        self._portions.begin(None if self._knows(a) else a)
        self._at_b, self._held = b, held
        self.frames = self._target(out)
        self._portions.make(b, held, stamps, self.frames)
        if out is not None:
            self.hand_over(out)
        if self._device.is_cuda and together:
            self.placement.expect(stamps)
        report = partial(self._report, *(copies.take() for copies in self._counts))
        if not self._late:
            return report
        unread, self._unread = self._unread, report
        return unread or Report

    def widen(self, poses: Poses) -> None:
        """Has light change wherever it does at any of a gap's instants, and not at its frames alone, for whoever looks
        there; poses: at these instants, of the gap made last."""
        if self.change is not None:
            self.change.widen(self._places.poses, poses)

    def foresee(self, gap: Span) -> None:
        """Works out the poses of a gap that is to come, while a GPU works on this one."""
        self._foreseen = gap, self._places.find(gap.stamps(self.layout.upsampling), gap.a, gap.b, gap.held)

    def last_report(self) -> Report:
        """Gives the report of the last gap, once, where reports are `late`."""
        unread, self._unread = self._unread, None
        return Report() if unread is None else unread()

    def _knows(self, a: KeyframeView) -> bool:
        """Tells whether keyframe a, of gaps in a row the first one, was B of the last call."""
        before = a.after if self.in_a_row else a
        return before is not None and self._at_b is before

    def _rests(self, gap: Span, a: KeyframeView, b: KeyframeView, begun: np.ndarray) -> bool:
        """Tells whether nothing moves or changes from a to b, as a CPU can tell at once; begun: bool [E], environments
        that began an episode."""
        poses, begins = self._places.poses, gap.held | begun
        if self._device.is_cuda or self.in_a_row or self.layout.flicker or self._at_b is not a or begins.any():
            return False
        moved = poses.moved == poses.before.take(self.placement.movers, axis=1)
        if not (moved.all() and np.array_equal(poses.rest, poses.before)):
            return False
        if not np.array_equal(b.image.numpy().reshape(-1), self.pair.b.image.numpy().reshape(-1)):
            return False
        looks_at = self.looks_at
        return looks_at is None or not self._places.find(looks_at(gap), gap.a, gap.b, gap.held).changed.any()

    def _rest(self, b: KeyframeView, out: np.ndarray | wp.array | None) -> Report:
        """Makes all frames as b, which is as a: what is known of a is known of b."""
        self._at_b = b
        envs, k, (height, width), m = self.layout.envs, self.layout.upsampling, self.size, self.visibility.margin
        image = self.pair.b.image.numpy()[:, m : m + height, m : m + width]
        frames = self._target(out).numpy()
        frames.reshape(envs, k, *image.shape[1:])[...] = image[:, None]
        return Report(samples=envs * (k - 1) * height * width)

    def _begun(self, a: KeyframeView, held: np.ndarray) -> np.ndarray:
        """Tells which environments' episodes begin with keyframe a, bool [E]."""
        if self._at_b is not a and (a.replaces is None or a.replaces is not self._at_b):
            return np.ones(len(held), bool)
        return self._held if a.begun is None else self._held | a.begun

    def _report(self, anew: Callable[[], np.ndarray], listed: Callable[[], np.ndarray]) -> Report:
        """Makes the report of a gap; anew, listed: wait for what `Reprojection.counted` had counted then."""
        count = anew()
        samples = self.layout.envs * (self.layout.upsampling - 1) * self.size[0] * self.size[1]
        looked_up = samples if self.layout.on_device else int(listed().sum())
        return Report(nonfinite=int(count[-1]), reshaded=int(count[:-1].sum()), samples=samples, sampled=looked_up)

    def _target(self, out: np.ndarray | wp.array | None) -> wp.array:
        """Gives the output on a CPU, a buffer in its place on a GPU, as [E K, h, w] pixels."""
        pixel = pixel_type(self.layout.channels)
        shape = (self.layout.envs * self.layout.upsampling, *self.size)
        if self._device.is_cpu:
            given = out.numpy() if isinstance(out, wp.array) else np.asarray(out)
            return wp.array(given, dtype=pixel, shape=shape, copy=False, device="cpu")
        if self._buffer is None:
            self._buffer = wp.empty(shape, dtype=pixel, device=self._device)
        return self._buffer

    def hand_over(self, out: np.ndarray | wp.array) -> None:
        """Copies the frames of the gap made last, which a GPU has made, to where they are wanted."""
        if self.frames is not self._buffer:
            return
        if isinstance(out, wp.array):
            wp.copy(out.flatten(), self.frames.flatten())
        else:
            out[...] = self.frames.numpy().reshape(out.shape)
