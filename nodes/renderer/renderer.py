"""A scene's images at one instant: linear HDR radiance, depth, ids, normals and motion, for E environments at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.scene.model import Camera, Scene
from nodes.renderer import output_kernels
from nodes.renderer.cameras import finer
from nodes.renderer.poses import Frames
from nodes.renderer.shading import Shading
from nodes.renderer.visibility import Visibility, store

BEHIND = float(output_kernels.BEHIND)
"""Motion [px] in x and y of a point that lay behind the previous camera: finite, and outside every image."""

OUTPUTS = ("radiance", "depth", "motion", "ids", "normal")

make_outputs = cache(output_kernels.make_outputs)


class Renderer:
    """Renders `scene` from `camera`, which stands where the body of its name is.

    Images are [E, H, W] with H = camera.height + 2 margin and W = camera.width + 2 margin; the inner part is exactly
    the image without margin. `half` gives float16 radiance, clipped at 65504. threads > 1 splits rows over CPU
    threads with the same result, bit for bit.

    Lighting: see `Shading`; direct light of all kinds of lights with shadows, emission, and the sky, uniform or a map,
    not occluded. light_samples: shadow rays for each area light and pixel, a square number. Counters of the last
    `render`: `not_finite` pixels (set to 0, or to the largest float where infinite) and `clipped` ones (half only).

    supersampling: n renders n x n samples for each pixel, side by side: every image, the margin and the unit of motion
    are then those of a camera with n times as many pixels along each side.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        envs: int = 1,
        margin: int = 0,
        device: str = "cpu",
        threads: int = 1,
        half: bool = False,
        light_samples: int = 16,
        supersampling: int = 1,
    ) -> None:
        n = supersampling
        self.visibility = Visibility(scene, finer(camera, n), envs, margin * n, device, threads)
        self.shading = Shading(self.visibility, half, light_samples)
        self.normals = self.shading.normals
        self.device, self.shape = self.visibility.device, self.visibility.shape
        count = len(scene.instances)
        self._turn = wp.zeros((envs, count + 1), dtype=wp.mat33, device=self.device)
        self._shift = wp.zeros((envs, count + 1), dtype=wp.vec3, device=self.device)
        self._camera = wp.zeros(envs, dtype=wp.mat33, device=self.device)
        self.types: dict[str, Any] = {
            "radiance": self.shading.pixel,
            "depth": wp.float32,
            "motion": wp.vec2,
            "ids": wp.int32,
            "normal": wp.vec3,
        }
        self._own: dict[str, wp.array] = {}
        self._still: dict[str, wp.array] = {}
        """Copies of the images of a scene in which nothing moves."""
        self._nothing = {n: wp.empty((0, 0, 0), dtype=t, device=self.device) for n, t in self.types.items()}
        self._last: Frames | None = None
        self.not_finite = self.clipped = 0

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and dtype of an output."""
        dtype = self.types[name]
        return (*self.shape, *getattr(dtype, "_shape_", ())), np.dtype(
            wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
        )

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compile and load the kernels that `outputs` need, so that the first image takes no longer than the others."""
        poses = np.tile(se3.IDENTITY, (self.shape[0], len(self.visibility.names), 1))
        self.render(poses, None, outputs)
        self._last, self._still = None, {}

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int = 0,
    ) -> dict[str, np.ndarray]:
        """The wanted images for body poses float64 [E, N, 7].

        radiance [E, H, W, 3] W/(sr m^2); depth float32 [E, H, W] m along the optical axis, +inf = sky; ids int32
        [E, H, W], 0 = background, else instance index + 1; normal float32 [E, H, W, 3] geometric, world frame, towards
        the camera, 0 = sky; motion float32 [E, H, W, 2] px: where the surface point was at `previous` (poses of the
        previous keyframe) minus where it is; (BEHIND, BEHIND) where it was behind the camera, or where its lens has no
        image; 0 without `previous`. The sky moves as directions do, with the camera's rotation.

        t_ns: the instant, at which lights with a waveform are as strong as they are then.
        out: numpy arrays, or Warp arrays of the renderer's device, to write into (on the CPU without a copy); what it
        lacks comes in the renderer's own buffers, valid until the next call. Raises ValueError for poses that are not
        finite, naming the body.
        """
        wanted = tuple(name for name in OUTPUTS if name in set(outputs))
        unknown = set(outputs) - set(OUTPUTS)
        if unknown:
            raise ValueError(f"the renderer has no output '{min(unknown)}'; it has {', '.join(OUTPUTS)}")
        targets = {name: self.target(name, (out or {}).get(name)) for name in wanted}
        frames = self.visibility.frames(poses)
        before = self.visibility.frames(previous) if previous is not None and "motion" in wanted else None
        if before is not None and before.same(frames):
            before = None
        if "radiance" in targets and self.shading.set_time(t_ns):
            self._still.pop("radiance", None)
        if before is None and self._last is not None and frames.same(self._last):
            self._repeat(frames, targets)
        else:
            self._still = {}
            self._draw(frames, before, targets)
        self._last = frames
        return {name: self.on_host(target, (out or {}).get(name)) for name, target in targets.items()}

    def _draw(self, frames: Frames, before: Frames | None, targets: Mapping[str, wp.array]) -> None:
        self.visibility.update(frames)
        self.geometric(frames, before, targets)
        if "radiance" in targets:
            self.shading.update(frames)
            self.not_finite, self.clipped = self.shading.shade(targets["radiance"])

    def _repeat(self, frames: Frames, targets: Mapping[str, wp.array]) -> None:
        """Nothing moved since the last call: what has been drawn of this instant is copied."""
        missing = {name: target for name, target in targets.items() if name not in self._still}
        if missing:
            self._draw(frames, None, missing)
            self._still.update((name, wp.clone(target)) for name, target in missing.items())
        for name in targets.keys() - missing.keys():
            wp.copy(targets[name], self._still[name])

    def geometric(self, frames: Frames, before: Frames | None, targets: Mapping[str, wp.array]) -> None:
        """Depth, motion, ids and normals of the z-buffer into `targets`; before: None for no motion."""
        if not targets.keys() - {"radiance"}:
            return
        v = self.visibility
        if "motion" in targets:
            turn, shift = frames.displacement(frames if before is None else before)
            store(self._turn, turn)
            store(self._shift, shift)
        if "normal" in targets:
            store(self._camera, frames.camera)
        kernel = make_outputs(*(name in targets for name in OUTPUTS[1:]), lens=v.lens)
        arrays = [targets.get(name, self._nothing[name]) for name in OUTPUTS[1:]]
        shared = [v.packed, v.triangle_instance, self.normals, v.rotation, self._camera, self._turn, self._shift]
        envs, _, width = self.shape

        def arguments(row0: int, row1: int) -> tuple[tuple[int, ...], list[Any]]:
            return (envs, row1 - row0, width // v.span), [v.view, row0, v.span, *shared, *arrays]

        v.bands.launch(kernel, arguments, self.device)

    def target(self, name: str, given: Any) -> wp.array:
        """The Warp array that an output is written to. Raises ValueError where the given one does not fit."""
        shape, dtype = self.array_shape(name)
        if isinstance(given, wp.array):
            if given.dtype != self.types[name] or given.shape != self.shape or given.device != self.device:
                raise ValueError(f"out['{name}'] must be a {self.device} array {self.shape} of {self.types[name]}")
            return given
        if given is not None:
            fits = given.shape == shape and given.dtype == dtype
            if not fits or not given.flags.c_contiguous or not given.flags.writeable:
                have = f"it is {given.shape} of {given.dtype}"
                raise ValueError(f"out['{name}'] must be a writable contiguous array {shape} of {dtype}, {have}")
            if self.device.is_cpu:
                return wp.array(given, dtype=self.types[name], shape=self.shape, copy=False, device=self.device)
        if name not in self._own:
            self._own[name] = wp.empty(self.shape, dtype=self.types[name], device=self.device)
        return self._own[name]

    def on_host(self, target: wp.array, given: Any) -> np.ndarray:
        """The image on the host: in the given array if there is one, which on the CPU holds it already."""
        if not isinstance(given, np.ndarray):
            return target.numpy()
        if self.device.is_cuda:
            host: wp.array = wp.array(given, dtype=target.dtype, shape=target.shape, copy=False, device="cpu")
            wp.copy(host, target)
            wp.synchronize_device(self.device)
        return given
