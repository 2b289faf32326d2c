"""A keyframe as the sub-frames look things up in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

from nodes.interpolator.rigid import gather_kernels, keyframe_kernels
from nodes.interpolator.rigid.look_up_kernels import LOGS
from nodes.renderer.visibility import Visibility


class Prepared:
    """Device arrays of one keyframe of E environments, written by `take`, `take_poses` and `fill`.

    image: its luminance or RGB; packed: its z-buffer; logs: its logarithm; patch, support int32, inverse float32 and
    texels vec4 [E, H, W] as in keyframe_kernels; poses: wp.transformd [E, N].
    """

    def __init__(
        self, shape: tuple[int, int, int], bodies: int, channels: int, device: Any, flicker: bool = False
    ) -> None:
        """flicker: logs are of the radiance under the lights at their mean, and without those that flicker."""
        self.pixel: Any = wp.float32 if channels == 1 else wp.vec3
        self._shape = shape
        self._struct = gather_kernels.make_keyframe(channels, flicker)
        self._device = device
        # Pixels that one thread does; on the CPU a row, for starting one costs more.
        self._span = shape[2] if device.is_cpu else 1
        with wp.ScopedDevice(device):
            self.image = wp.empty(shape, dtype=self.pixel)
            self.packed = wp.empty(shape, dtype=wp.uint64)
            self.logs = wp.empty(shape, dtype=LOGS[channels, flicker])
            # At their mean, and without.
            self._lights = [wp.empty(shape, dtype=wp.vec3) for _ in range(2)] if flicker else []
            self.patch = wp.empty(shape, dtype=wp.int32)
            self.support = wp.empty(shape, dtype=wp.int32)
            self.inverse = wp.empty(shape, dtype=wp.float32)
            self.texels = wp.empty(shape, dtype=wp.vec4)
            self.poses = wp.empty((shape[0], bodies), dtype=wp.transformd)

    def take(self, image: wp.array) -> None:
        """The keyframe's image, float32 [E, H, W] or [E, H, W, 3]."""
        wp.copy(self.image, image.view(wp.vec3).reshape(self._shape) if image.ndim == 4 else image)

    def take_poses(self, visibility: Visibility, envs: int) -> None:
        """Where the bodies are, from the first `envs` environments: a launch only."""
        wp.copy(self.poses, visibility.poses[:envs])

    def take_lights(self, shade: Callable[[str], wp.array]) -> None:
        """What `fill` needs where lights flicker. shade: gives radiance [>= E, H, W] of vec3, under LightSet.select."""
        for which, image in zip(("mean", "steady"), self._lights):
            wp.copy(image, shade(which)[: self._shape[0]])

    def fill(self, visibility: Visibility, envs: int, pieces: wp.array, moving: wp.array, nonfinite: wp.array) -> None:
        """The rest, from the image and the first `envs` environments of what is visible: launches only.

        pieces: body and patch [T]; moving int32 of each patch: whether it may move. nonfinite int32 [1]: has the number
        of pixels added whose radiance is not finite; they are not used.
        """
        wp.copy(self.packed, visibility.packed[:envs])
        dim = (*self._shape[:2], self._shape[2] // self._span)
        given = [self._span, self.packed, pieces, self.image, *self._lights]
        made = [self.logs, self.patch, self.inverse, self.texels, nonfinite]
        kernel = keyframe_kernels.take_in_lights if self._lights else keyframe_kernels.take_in
        wp.launch(kernel, dim, given, made, device=self._device)
        given = [self._span, moving, self.patch, self.inverse]
        wp.launch(keyframe_kernels.find_support, dim, given, [self.support], device=self._device)

    def seen_from(self, turn: wp.array, shift: wp.array) -> Any:
        """The struct that the gather reads, with the bodies' displacement [P E, N + 2] since."""
        key: Any = self._struct()
        key.image, key.turn, key.shift = self.image, turn, shift
        for name in ("patch", "support", "inverse", "logs", "texels"):
            setattr(key, name, getattr(self, name).flatten())
        return key
