"""Renders a scene's images at one instant: linear HDR radiance, depth, ids, normals and motion, for E environments at
once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.building import begin_building, build_together
from evis.gpu.cuda_graph import Branch, CudaGraphs
from evis.scene.model import Camera, Scene
from nodes.renderer.geometry.pose_upload import READ
from nodes.renderer.geometry.poses import InstancePoses, same_bytes
from nodes.renderer.lighting import Shading
from nodes.renderer.poses_before import LAST as LAST
from nodes.renderer.raster import output_kernels
from nodes.renderer.raster.lens import displacement_kernels
from nodes.renderer.raster.lens.cameras import finer
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions

BEHIND = float(displacement_kernels.FAR_AWAY)
"""Motion [px] in x and y of a point that lay behind the previous camera: finite, and outside every image."""

LIGHT = ("radiance", "luminance")
GEOMETRIC = ("depth", "motion", "ids", "normal")
OUTPUTS = LIGHT + GEOMETRIC

make_outputs = cache(output_kernels.make_outputs)


class Renderer:
    """Renders `scene` from `camera`, which stands where the body of its name is.

    Images are [E, H, W] with H = camera.height + 2 margin and W = camera.width + 2 margin; the inner part is exactly
    the image without margin. `half` gives float16 radiance and luminance, clipped at 65504. threads > 1 splits rows
    over CPU threads with the same result, bit for bit.

    Lighting: see `Shading`; direct light of all kinds of lights with shadows, emission, and the sky, uniform or a map,
    not occluded. light_samples: shadow rays for each area light and pixel, a square number. Pixels that are not finite
    are counted, and set to 0, or to the largest float where infinite.

    paths: light from the sky that things hide, from glowing surfaces and over other surfaces, see `paths.PathOptions`;
    None leaves it out.

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
        paths: PathOptions | None = None,
    ) -> None:
        n = supersampling
        self.visibility = Visibility(scene, finer(camera, n), envs, margin * n, device, threads)
        self.shading = Shading(self.visibility, ShadingOptions(light_samples, paths, half))
        self.normals = self.shading.normals
        self.device, self.shape = self.visibility.device, self.visibility.shape
        count = len(scene.instances)
        self._turn = wp.zeros((envs, count + 1), dtype=wp.mat33, device=self.device)
        self._shift = wp.zeros((envs, count + 1), dtype=wp.vec3, device=self.device)
        self.types: dict[str, Any] = {
            "radiance": self.shading.pixel,
            "luminance": self.shading.scalar,
            "depth": wp.float32,
            "motion": wp.vec2,
            "ids": wp.int32,
            "normal": wp.vec3,
        }
        self._own: dict[str, wp.array] = {}
        self._given: dict[str, wp.array] = {}
        """Warp arrays that were found to fit at the last call."""
        self._still: dict[str, wp.array] = {}
        """Copies of the images of a scene in which nothing moves."""
        self._nothing = {n: wp.empty((0, 0, 0), dtype=t, device=self.device) for n, t in self.types.items()}
        self._drawn = self._at_rest = False
        self._graphs, self._ahead = CudaGraphs(self.device), Branch(self.device)

    def counts(self) -> tuple[int, int]:
        """Gives pixels of the last drawn light that were not finite, and clipped to float16; waits for it."""
        return self.shading.counts()

    def counts_later(self) -> Callable[[], tuple[int, int]]:
        """Makes a function that gives `counts` of the images launched by now, and waits for these alone."""
        return self.shading.counts_later()

    def array_shape(self, name: str) -> tuple[tuple[int, ...], np.dtype]:
        """Gives the shape and dtype of an output."""
        dtype = self.types[name]
        return (*self.shape, *getattr(dtype, "_shape_", ())), np.dtype(
            wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
        )

    def begin(self, outputs: Iterable[str]) -> None:
        """Has the kernels that `outputs` need compiled, while the caller does something else, for `prepare`."""
        begin_building(self.device, self._kernels(outputs))

    def _kernels(self, outputs: Iterable[str]) -> list[tuple[wp.Kernel, int]]:
        lit = {"radiance", "luminance"} & set(outputs)
        return [*(self.shading.kernels(False) if lit else ()), *self.visibility.kernels()]

    def prepare(self, outputs: Iterable[str]) -> None:
        """Compiles and loads the kernels that `outputs` need, so that the first image takes no longer than the others.

        On a GPU also record the launches, which takes two images for each buffer that poses come from.
        """
        wanted = list(outputs)
        build_together(self.device, self._kernels(wanted))
        for k in range(1 + 2 * READ if self.device.is_cuda else 1):
            out = self.buffers(wanted) if self.device.is_cuda else None
            self.render(self._poses_at(k * 1_000_000), LAST if k else None, wanted, out)
        self._drawn, self._still = False, {}

    def _poses_at(self, t_ns: int) -> np.ndarray:
        """Gives poses [E, N, 7] at a time [ns]; what physics moves is at the origin."""
        t = np.array([t_ns], np.int64)
        paths = (body.trajectory for body in self.visibility.scene.bodies)
        return np.tile([se3.IDENTITY if path is None else path.pose(t)[0] for path in paths], (self.shape[0], 1, 1))

    def render(
        self,
        poses: np.ndarray,
        previous: np.ndarray | str | None = None,
        outputs: Iterable[str] = ("radiance",),
        out: Mapping[str, Any] | None = None,
        t_ns: int | np.ndarray = 0,
    ) -> dict[str, Any]:
        """Renders the wanted images for body poses float64 [E, N, 7].

        radiance [E, H, W, 3] W/(sr m^2), luminance [E, H, W] of that very radiance; depth float32 [E, H, W] m along the
        optical axis, +inf = sky; ids int32 [E, H, W], 0 = background, else instance index + 1; normal float32
        [E, H, W, 3] geometric, world frame, towards the camera, 0 = sky; motion float32 [E, H, W, 2] px: where the
        surface point was at `previous` (poses of the previous keyframe, or LAST) minus where it is; (BEHIND, BEHIND)
        where it was behind the camera, or where its lens has no image; 0 without `previous`. The sky moves as
        directions do, with the camera's rotation.

        t_ns: the instant, at which lights with a waveform are as strong as they are then; int64 [E], one for each
        environment, where these have times of their own.
        out: numpy arrays, or Warp arrays of the renderer's device, to write into (on the CPU without a copy); what it
        lacks comes in the renderer's own buffers, valid until the next call. What is given as a Warp array is given
        back as it is, and nobody waits for a GPU to have written it; all else is numpy. Raises ValueError for poses
        that are not finite, naming the body.
        """
        wanted = tuple(name for name in OUTPUTS if name in set(outputs))
        unknown = set(outputs) - set(OUTPUTS)
        if unknown:
            raise ValueError(f"the renderer has no output '{min(unknown)}'; it has {', '.join(OUTPUTS)}")
        targets = {name: self.target(name, (out or {}).get(name)) for name in wanted}
        if not targets.keys().isdisjoint(LIGHT) and self.shading.set_time(t_ns):
            self._still = {name: image for name, image in self._still.items() if name not in LIGHT}
        if not self._drawn or isinstance(previous, np.ndarray) or not self._draw_next(poses, previous, targets):
            self._draw_all(poses, previous, targets)
        self._drawn = True
        return {name: self.on_host(target, (out or {}).get(name)) for name, target in targets.items()}

    def _draw_next(self, poses: np.ndarray, previous: str | None, targets: Mapping[str, wp.array]) -> bool:
        """Draws the images after those of the last call; False, and none are drawn, where nothing has moved since.

        Of many bodies only those that may move are looked at before a GPU begins to draw, and the rest while it does;
        should they have moved too, all is drawn once more.
        """
        v = self.visibility
        frames = v.advance(poses, previous is not None and "motion" in targets)
        if frames is None:
            return False
        self._still = {}
        self._draw(frames, targets)
        if not v.as_placed(poses):
            frames = v.instance_poses(poses)
            v.place_others(frames)
            self._draw(frames, targets)
        return True

    def _draw_all(self, poses: np.ndarray, previous: np.ndarray | str | None, targets: Mapping[str, wp.array]) -> None:
        """Draws the images, or copies what is kept of the last ones where nothing has moved."""
        v = self.visibility
        frames = v.instance_poses(poses)
        before = None
        if isinstance(previous, str):
            before = v.last if "motion" in targets and self._drawn else None
        elif previous is not None and "motion" in targets:
            before = np.ascontiguousarray(previous, np.float64)
        same = self._drawn and v.same(frames)
        if same and (before is None or same_bytes(before, frames.bodies)):
            self._repeat(frames, targets)
            return
        self._still = {}
        v.place(frames, before)
        self._draw(frames, targets)

    def _draw(self, frames: InstancePoses, targets: Mapping[str, wp.array]) -> None:
        """Draws the images of what the visibility has placed."""
        v = self.visibility
        if not targets.keys().isdisjoint(LIGHT):
            self.shading.update(frames)
        everything = False
        if "motion" in targets:
            # What is at rest has zeros already, unless it was not at the last call.
            everything = v.still_displaced or not self._at_rest
            self._at_rest = not v.still_displaced
        written = tuple((name, target.ptr) for name, target in targets.items())
        key = (v.coming, v.still_moved, v.moved, everything, self.shading.occluders.builds, written)
        self._graphs.run(key, lambda: self._launch(targets, everything))
        v.drawn()

    def _launch(self, targets: Mapping[str, wp.array], everything: bool) -> None:
        """Launches what draws the images of all that is placed, and does nothing else: it is recorded under a key."""
        lit = not targets.keys().isdisjoint(LIGHT)
        ahead, shading = self._ahead, self.shading
        self.visibility.arrive()
        with ahead.aside():
            self.displace(targets, everything)
            if lit:
                shading.place()

        def placed() -> None:
            with ahead.aside():
                if lit:
                    shading.placed()

        self.visibility.draw(placed)
        ahead.join()
        with ahead.aside():
            self.geometric(targets)
        if lit:
            shading.shade(targets.get("radiance"), True, targets.get("luminance"))
        ahead.join()

    def _repeat(self, frames: InstancePoses, targets: Mapping[str, wp.array]) -> None:
        """Copies what has been drawn of this instant, where nothing has moved since the last call."""
        missing = {name: target for name, target in targets.items() if name not in self._still}
        if missing:
            self.visibility.place(frames)
            self._draw(frames, missing)
            self._still.update((name, wp.clone(target)) for name, target in missing.items())
        for name in targets.keys() - missing.keys():
            wp.copy(targets[name], self._still[name])

    def displace(self, targets: Mapping[str, wp.array], everything: bool = True) -> None:
        """Computes what motion needs of the poses; everything: still instances may have moved."""
        v = self.visibility
        if "motion" in targets and v.moved:
            v.displace(everything, self._turn, self._shift)
        elif "motion" in targets:
            self._turn.zero_()
            self._shift.zero_()

    def geometric(self, targets: Mapping[str, wp.array]) -> None:
        """Writes depth, motion, ids and normals of the z-buffer into `targets`, after `displace`."""
        if targets.keys().isdisjoint(GEOMETRIC):
            return
        v = self.visibility
        kernel = make_outputs(*(name in targets for name in GEOMETRIC), lens=v.lens)
        arrays = [targets.get(name, self._nothing[name]) for name in GEOMETRIC]
        shared = [v.packed, v.triangle_instance, self.normals, v.rotation, v.eye, self._turn, self._shift]
        envs, _, width = self.shape

        def arguments(row0: int, row1: int) -> tuple[tuple[int, ...], list[Any]]:
            return (envs, row1 - row0, width // v.span), [v.view, row0, v.span, *shared, *arrays]

        v.row_tiles.launch(kernel, arguments, self.device)

    def buffers(self, outputs: Iterable[str]) -> dict[str, wp.array]:
        """Gives the renderer's own arrays on its device, as `out` of `render` takes them: so nobody waits for a GPU."""
        return {name: self.target(name, None) for name in outputs}

    def target(self, name: str, given: Any) -> wp.array:
        """Gives the Warp array that an output is written to. Raises ValueError where the given one does not fit."""
        if given is not None and given is self._given.get(name):
            return self._given[name]
        shape, dtype = self.array_shape(name)
        if isinstance(given, wp.array):
            if given.dtype != self.types[name] or given.shape != self.shape or given.device != self.device:
                raise ValueError(f"out['{name}'] must be a {self.device} array {self.shape} of {self.types[name]}")
            self._given[name] = given
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

    def on_host(self, target: wp.array, given: Any) -> Any:
        """Gives the image on the host: in the given array if there is one, which on the CPU holds it already."""
        if isinstance(given, wp.array):
            return given
        if given is None:
            return target.numpy()
        if self.device.is_cuda:
            host: wp.array = wp.array(given, dtype=target.dtype, shape=target.shape, copy=False, device="cpu")
            wp.copy(host, target)
            wp.synchronize_device(self.device)
        return given
