"""Holds a keyframe in the form in which the sub-frames look things up in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.cuda_graph import CudaGraphs
from evis.scene.model import Waveform
from nodes.interpolator.displacement_kernels import BodyMotion, displace
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.rigid import keyframe_kernels
from nodes.interpolator.rigid.look_up.log_kernels import log_type
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.visibility import Visibility


class KeyframePair:
    """Holds two keyframes of E environments that take turns as A and B: arrays [2 E, H, W], one after the other.

    Of E gaps in a row, which are as environments whose times differ, a gap's A is the B of the one before: E + 1
    keyframes, of which all but the last are A and all but the first are B.

    patch, support int32, inverse float32 and texels vec4 as in keyframe_kernels; logs: as of `log_type`. bare float32:
    ln of the light alone on textures, elsewhere NO_ALBEDO, in scenes that have textures. motions BodyMotion
    [2 P E, N + 2]: how the bodies of the sub-frames have moved since A, then since B.
    """

    def __init__(
        self,
        shape: tuple[int, int, int],
        slots: int,
        bodies: int,
        channels: int,
        device: Any,
        waveform_count: int = 0,
        textured: bool = False,
        in_a_row: bool = False,
    ) -> None:
        """Allocates both keyframes. shape: E, H, W. waveform_count: as of `log_type`. in_a_row: the E are gaps in a
        row."""
        envs, rows = shape[0], 2 * slots * shape[0]
        self._in_a_row = in_a_row
        both = (envs + 1 if in_a_row else 2 * envs, *shape[1:])
        pixel = pixel_type(channels)
        with wp.ScopedDevice(device):
            self.logs = wp.empty(both, dtype=log_type(channels, waveform_count))
            self.demodulated = wp.zeros(both if textured else (0, 0, 0), dtype=wp.float32)
            self.patch = wp.empty(both, dtype=wp.int32)
            self.support = wp.empty(both, dtype=wp.int32)
            self.inverse = wp.empty(both, dtype=wp.float32)
            self.texels = wp.empty(both, dtype=wp.vec4)
            self.image = wp.empty(both, dtype=pixel)
            self.packed = wp.empty(both, dtype=wp.uint64)
            self.poses = wp.empty((both[0], bodies), dtype=wp.transformd)
            self.motions = wp.empty((rows, bodies + 2), dtype=BodyMotion)
        self._struct, self._channels = make_keyframes(channels, waveform_count), channels
        self._waveform_count = waveform_count
        self.a, self.b = (
            PreparedKeyframe(self, first, shape, device, channels, waveform_count)
            for first in (0, 1 if in_a_row else envs)
        )
        self._kernels: dict[tuple[int, int], Any] = {}
        """The structs that `kernel` has made, by the first row of A and where the motion is."""

    def swap(self, graphs: CudaGraphs) -> None:
        """Begins a gap: B becomes A, and the other keyframe is to be filled. Of gaps in a row the last B becomes the
        first A, by launches that `graphs` records."""
        if self._in_a_row:
            graphs.run("swap", self._last_to_first)
        else:
            self.a, self.b = self.b, self.a

    def _last_to_first(self) -> None:
        for name in ("logs", "demodulated", "patch", "support", "inverse", "texels", "image", "packed", "poses"):
            array = getattr(self, name)
            if array.size:
                wp.copy(array[:1], array[-1:])

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that keyframes are taken in by, as `build_together` takes them.

        They are generic and of one module, which is compiled anew when another of them is made; so all are made here.
        """
        image, logs = (array.dtype for array in (self.image, self.logs))
        kinds: Any = {"image": wp.array3d(dtype=image), "logs": wp.array3d(dtype=logs)}
        if self._waveform_count:
            taking = keyframe_kernels.make_prepare_flickering(self._channels, self._waveform_count)
        else:
            taking = wp.overload(keyframe_kernels.prepare_pixels, kinds)
        unchanged: Any = {name: wp.array3d(dtype=image) for name in ("image_a", "image_b")}
        wp.overload(keyframe_kernels.find_unchanged, unchanged)
        wp.overload(keyframe_kernels.find_support, {"logs": kinds["logs"]})
        return [(taking, LAUNCH_BLOCK)]

    @property
    def fresh(self) -> tuple[int, wp.array]:
        """Gives the first row, and poses transformd [rows, N], of what is new of a gap whose B has its poses."""
        return (0, self.poses) if self._in_a_row else (self.b.first, self.b.poses)

    def displace(self, camera: int, poses: wp.array, motions: wp.array) -> None:
        """Computes how bodies at poses transformd [R, N] have moved since A, then since B, BodyMotion [2 R, N + 2]:
        launches only."""
        rows = poses.shape[0]
        for k, then in enumerate((self.a, self.b)):
            out = motions[k * rows : (k + 1) * rows]
            wp.launch(displace, out.shape, [camera, poses, then.poses], [out], device=poses.device)

    def kernel(self, beside: wp.array | None = None) -> Any:
        """Gives the struct that the gather reads, which is made once. beside: motions at other instants than the
        sub-frames."""
        motions = self.motions if beside is None else beside
        which = self.a.first, motions.ptr
        if which not in self._kernels:
            # Those of motion that is not asked for any more would keep its memory.
            kept = (motions.ptr, self.motions.ptr)
            self._kernels = {k: keys for k, keys in self._kernels.items() if k[1] in kept}
            self._kernels[which] = self._made(motions)
        return self._kernels[which]

    def _made(self, motions: wp.array) -> Any:
        keys: Any = self._struct()
        size = self.a.patch.size
        keys.first = wp.vec2i(*(size // len(self.a.patch) * prepared.first for prepared in (self.a, self.b)))
        keys.image, keys.motions = self.b.image, motions
        for name in ("patch", "support", "inverse", "logs", "demodulated", "texels"):
            setattr(keys, name, getattr(self, name).flatten())
        return keys


class PreparedKeyframe:
    """Holds the device arrays of one keyframe of E environments, written by `take`, `take_poses`, `take_packed` and
    `fill`.

    image: its luminance or RGB; packed: its z-buffer; logs: its logarithm; poses: wp.transformd [E, N]; all these and
    the others are its part of a pair's, from row `first` on.
    """

    def __init__(
        self,
        pair: KeyframePair,
        first: int,
        shape: tuple[int, int, int],
        device: Any,
        channels: int,
        waveform_count: int,
    ) -> None:
        self.first, self._shape, self._device = first, shape, device
        # Pixels that one thread does; on the CPU a row, for starting one costs more.
        self._span = shape[2] if device.is_cpu else 1
        mine = slice(first, first + shape[0])
        self.logs, self.patch, self.support = pair.logs[mine], pair.patch[mine], pair.support[mine]
        self.inverse, self.texels = pair.inverse[mine], pair.texels[mine]
        self.demodulated = pair.demodulated[mine] if pair.demodulated.size else pair.demodulated
        self.image, self.packed, self.poses = pair.image[mine], pair.packed[mine], pair.poses[mine]
        self._take_in = (
            keyframe_kernels.make_prepare_flickering(channels, waveform_count)
            if waveform_count
            else keyframe_kernels.prepare_pixels
        )
        with wp.ScopedDevice(device):
            # With those of each waveform at their mean, and without any.
            self._lights = [wp.empty((waveform_count + 1, *shape), dtype=wp.vec3)] if waveform_count else []

    def take(self, image: wp.array) -> None:
        """Takes the keyframe's image, float32 [E, H, W] or [E, H, W, 3]."""
        wp.copy(self.image, image.view(wp.vec3).reshape(self._shape) if image.ndim == 4 else image)

    def take_poses(self, visibility: Visibility, envs: int) -> None:
        """Takes the bodies' poses, from the first `envs` environments: a launch only."""
        wp.copy(self.poses, visibility.poses[:envs])

    def take_packed(self, visibility: Visibility, envs: int) -> None:
        """Takes the z-buffer of the first `envs` environments: a launch only."""
        wp.copy(self.packed, visibility.packed[:envs])

    def take_lights(self, waveforms: Sequence[Waveform], shade: Callable[[Waveform | None], wp.array]) -> None:
        """Computes what `fill` needs where lights flicker. shade: gives radiance [>= E, H, W] of vec3, under
        LightSet.select."""
        for k, which in enumerate((*waveforms, None)):
            wp.copy(self._lights[0][k], shade(which)[: self._shape[0]])

    def fill(self, pieces: wp.array, moving: wp.array, straight: float, nonfinite: wp.array) -> None:
        """Fills the other arrays from the image and the z-buffer: launches only.

        straight: difference of ln I from linear interpolation that counts as none, negative where nobody asks.
        pieces: body and patch [T]; moving int32 of each patch: whether it may move. nonfinite int32 [1]: has the number
        of pixels added whose radiance is not finite; they are not used.
        """
        dim = (*self._shape[:2], self._shape[2] // self._span)
        given = [self._span, self.packed, pieces, self.image, *self._lights]
        made = [self.logs, self.patch, self.inverse, self.texels, nonfinite]
        wp.launch(self._take_in, dim, given, made, device=self._device)
        given = [self._span, straight, moving, self.patch, self.inverse, self.logs]
        wp.launch(keyframe_kernels.find_support, dim, given, [self.support], device=self._device)
