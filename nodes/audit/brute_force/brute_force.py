"""Computes the luminance of a few pixels at any instants, with nothing reused: every ray is cast and every point shaded
by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from evis.scene.model import Camera, Scene
from nodes.audit.brute_force.first_surface_kernels import make_first_surface
from nodes.audit.brute_force.rays import PixelRays
from nodes.renderer.geometry.pose_kernels import place_instances
from nodes.renderer.geometry.poses import InstancePoses
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.lighting import Shading
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions
from nodes.renderer.shadows.occlusion import Occluders

if TYPE_CHECKING:
    from nodes.renderer.paths.paths import PathOptions

LEAST_SLOTS, MOST_SLOTS, ROOM = 32, 512, 1 << 14
"""Instants that are worked on at once, and things that are placed for all of them together, if nobody says."""


class BruteForce:
    """Computes the luminance of chosen pixels: `choose` them, then `luminance_at` at instants.

    An instant takes a slot, an environment of the renderer's own shading code. What a pixel sees is found by a ray
    instead of the raster; its light is that of the keyframes, to the last bit where ray and raster find one triangle.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        pixels: int,
        groups: int = 1,
        slots: int | None = None,
        device: str = "cpu",
        samples: int = 1,
        light_samples: int = 16,
        paths: PathOptions | None = None,
    ) -> None:
        """pixels: in each of `groups` (environments have their own). slots: instants at once. samples: n, for n x n
        samples of a pixel. light_samples, paths: as of the renderer."""
        self._rays = PixelRays(camera, samples)
        if slots is None:
            slots = min(MOST_SLOTS, max(LEAST_SLOTS, ROOM // (len(scene.instances) + len(scene.bodies))))
        self.slots = slots
        self._shape = (groups, pixels)
        moving = not all(is_static(scene, n) for n in range(len(scene.bodies)))
        compact = self._rays.compact(pixels, groups)
        v = self._visibility = Visibility(
            scene, compact, slots, 0, device, tiled=True, layered=False, sparse=True if moving else None
        )
        v.view.distorted = 1
        if self._rays.lens:
            v.view.near = self._rays.view.near
        options = ShadingOptions(light_samples, paths, remember=False, split=False)
        self._shading = Shading(v, options)
        # Where light casts shadows, rays from the camera go through the same trees.
        shared = any(light.shadows for light in scene.lights) or paths is not None
        triangles = len(v.geometry.triangles) > 0
        self._own = None if shared and triangles else Occluders(v, v.geometry.static, triangles)
        self._occluders = self._own or self._shading.occluders
        self._kernel = make_first_surface(self._occluders.trees)
        # First those that stand still before the camera; the one after the last instance stands for the camera.
        still = v.geometry.static & is_static(scene, v.camera_body)
        order = np.append(np.argsort(~still, kind="stable"), len(still))
        self._still = int(still.sum())
        self._places = [v.put(order, wp.int32), v.put(v.geometry.body, wp.int32)]
        self._places += [v.put(v.geometry.rotation, wp.mat33d), v.put(v.geometry.translation, wp.vec3d)]
        v.rotation.zero_()
        v.translation.zero_()
        v.eye.zero_()
        self._first = v.put(v.geometry.first[:-1], wp.int32)
        self._luminance = wp.zeros(v.shape, dtype=wp.float32, device=v.device)
        self._cells = self._rays.cells(pixels, groups)
        self._instance = np.append(v.geometry.triangle_instance, -1)
        self._others: np.ndarray | None = None
        self._rest = np.zeros((0, 7))
        self._frames: InstancePoses | None = None
        self.nonfinite = 0
        """Samples so far whose light was not finite."""

    def choose(self, pixels: np.ndarray) -> None:
        """Takes the pixels int [G, M, 2] (x, y) of the groups."""
        table = self._rays.table(np.asarray(pixels, np.int64))
        self._visibility.view.rays = wp.array(table, dtype=wp.vec3, device=self._visibility.device)

    def luminance_at(
        self, moved: np.ndarray, t_ns: np.ndarray, slot: np.ndarray, group: np.ndarray, pixel: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Computes luminance float32 [Q] of pixels at instants, and the instance int32 [Q] that each shows, -1 for
        none.

        moved: poses of the movers float64 [T, M, 7], of the T instants, `slots` at most; `rest` was told the others.
        t_ns: int64 [T], when they are. slot, group, pixel: int64 [Q], which instant and which pixel is asked for.
        """
        if not len(slot):
            return np.zeros(0, np.float32), np.zeros(0, np.int32)
        frames = self._place(moved, t_ns)
        at = slot[:, None] * self._visibility.view.width * self._visibility.view.height + self._cells[group, pixel]
        listed = self._put(at.reshape(-1))
        self._shading.update(frames)
        self._shading.place()
        self._shading.placed()
        triangle = self._see(listed, frames)
        count = self._put(np.array([listed.size]))
        self._shading.shade_list(None, listed, count, [0], ready=True, luminance=self._luminance)
        self.nonfinite += self._shading.counts()[0]
        light = self._luminance.numpy().reshape(-1)[at].astype(np.float64).mean(-1).astype(np.float32)
        seen = self._instance[triangle.numpy().reshape(at.shape)[:, at.shape[1] // 2]]
        return light, seen.astype(np.int32)

    def rest(self, poses: np.ndarray, movers: np.ndarray) -> None:
        """Takes the poses float64 [N, 7] of all bodies, of which `luminance_at` gives the movers int64 [M] anew."""
        others = np.delete(poses, movers, 0)
        if self._others is None or not np.array_equal(others, self._others):
            self._others, self._rest = others, poses
            self._frames = None

    def _place(self, moved: np.ndarray, t_ns: np.ndarray) -> InstancePoses:
        """Brings the bodies of all instants to the device; slots that are not used repeat the last one."""
        v, last = self._visibility, len(t_ns) - 1
        which = np.minimum(np.arange(self.slots), last)
        slots, start = last + 1, self._still
        if self._frames is None:
            self._frames = v.instance_poses(np.tile(self._rest, (self.slots, 1, 1)))
            v.place(self._frames)
            slots, start = self.slots, 0
        if moved.shape[1]:
            self._frames = v.send(moved[which])
            v.settle()
        # Not those of slots that are not used, and what stands still only once.
        inputs = [v.poses, v.camera_body, start, *self._places]
        dim = (slots, len(v.geometry.body) + 1 - start)
        wp.launch(place_instances, dim, inputs, [v.rotation, v.translation, v.eye], device=v.device)
        self._shading.set_times(np.asarray(t_ns, np.int64)[which])
        return self._frames

    def _see(self, listed: wp.array, frames: InstancePoses) -> wp.array:
        """The triangle that each listed ray meets, in the z-buffer too."""
        v = self._visibility
        if self._own is not None:
            self._own.update(frames)
            self._own.launch()
            self._own.launch_moving()
        triangle = v.empty(listed.size, wp.int32)
        casters: Any = self._occluders.casters
        inputs = [v.view, int(self._rays.lens), listed, casters, self._first, v.two_sided, v.vertices, v.triangles]
        wp.launch(self._kernel, listed.size, inputs, [v.packed, triangle], device=v.device)
        return triangle

    def _put(self, values: np.ndarray) -> wp.array:
        return self._visibility.put(values, wp.int32)
