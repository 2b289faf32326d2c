"""Finds which triangle each pixel sees at one instant, without any shading."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from evis.gpu.cuda_graph import Branch, CudaGraphs
from evis.scene.model import Camera, Scene
from nodes.renderer.geometry import pose_kernels
from nodes.renderer.geometry.pose_upload import PoseUpload
from nodes.renderer.geometry.poses import (
    InstancePoses,
    check_poses,
    check_shape,
    check_values,
    of_bodies,
    same_bytes,
)
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.raster import output_kernels
from nodes.renderer.raster.raster import NoRaster, RowRaster, TiledRaster
from nodes.renderer.raster.scene_arrays import SceneArrays

wp.config.log_level = wp.LOG_WARNING


class Visibility(SceneArrays):
    """Finds which triangle every pixel sees, for E environments: `update(poses)`, then `packed` or `hits()`.

    packed: Warp uint64 [E, H, W] on the device, entries of depth_kernels, all ones where nothing is hit; for a
    distorted camera, the distance along the pixel's ray in place of the depth. H and W include `margin` pixels on every
    side. threads: share the rows on a CPU; the result does not depend on it. tiled: None has a GPU's threads share all
    triangles (TiledRaster) and a CPU's own their rows (RowRaster, which is for a CPU alone).

    While a still camera sees still instances where they were, these are kept as a layer and only the others are drawn
    over it; the z-buffer is the same, bit for bit. layered=False draws everything anew.

    On the device, for other kernels: `poses` transformd [E, N]; `eye` mat33 [E], camera to world; `rotation` mat33 and
    `translation` vec3 [E, I], instance to camera; `vertices` for triangle_kernels.corner.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        envs: int = 1,
        margin: int = 0,
        device: str = "cpu",
        threads: int = 1,
        tiled: bool | None = None,
        layered: bool = True,
        sparse: bool | None = None,
        drawn: bool = True,
    ) -> None:
        """Brings the scene to a device.

        sparse: whether only bodies that may move are sent from one instant to the next; None = where it pays. drawn:
        False for who fills `packed` himself and never draws.
        """
        super().__init__(scene, camera, envs, margin, device, threads)
        geometry = self.geometry
        still = geometry.static & is_static(scene, self.camera_body)
        self._layered = layered and bool(still[geometry.triangle_instance].any())
        self.moved = self.still_displaced = False
        self.still_place = 0
        self._still_drawn = -1
        self._layer = self.empty(self.shape if self._layered else (0, 0, 0), wp.uint64)
        self._still_bodies = np.array([is_static(scene, k) for k in range(len(self.names))], bool)
        movers = np.flatnonzero(~self._still_bodies)
        self._upload = PoseUpload(envs, len(self.names), movers, self.device, sparse)
        self._sent_names = [self.names[k] for k in self._upload.sent]
        # Of what is sent, the body whose pose most often tells that something has moved.
        place = int(np.searchsorted(self._upload.sent, self.camera_body))
        self._telling = slice(place, place + 1)
        self.poses = self._upload.now
        order = np.concatenate([np.argsort(~still, kind="stable"), [len(still)]])
        self._still_count = int(still.sum())
        self._instances = [
            self.put(order, wp.int32),
            self.put(geometry.body, wp.int32),
            self.put(geometry.rotation, wp.mat33d),
            self.put(geometry.translation, wp.vec3d),
        ]
        tiled = self.device.is_cuda if tiled is None else tiled
        self.raster = ((TiledRaster if tiled else RowRaster) if drawn else NoRaster)(self, still)
        self.vertices, self.view.local = self.raster.vertices, int(self.raster.local)
        self._graphs, self._cleared = CudaGraphs(self.device), Branch(self.device)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that place and draw, as `build_together` takes them."""
        return [(pose_kernels.place_instances, LAUNCH_BLOCK), *self.raster.kernels]

    def instance_poses(self, poses: np.ndarray) -> InstancePoses:
        """Gives poses float64 [E, N, 7], checked. Raises ValueError naming a body."""
        return self._instance_poses_of(check_poses(poses, self.envs, self.names))

    def advance(self, poses: np.ndarray, displaced: bool) -> InstancePoses | None:
        """Places the next instant, from the last one on.

        What is sent is there after `settle`, or `arrive` in a recording.
        Where few of many bodies may move, the others are taken to stay: whether so, `as_placed` tells later.
        displaced: whether the last instant is the previous keyframe. None, and nothing done, where there is no last one
        or nothing has moved since. Raises ValueError naming a body whose pose is not finite.
        """
        upload = self._upload
        if not upload.begun:
            return None
        fresh = check_shape(poses, self.envs, self.names)
        if upload.sparse:
            fresh = of_bodies(fresh, upload.sent)
        check_values(fresh, self._sent_names)
        latest, one = upload.latest(), self._telling
        if fresh[:1, one].tobytes() == latest[:1, one].tobytes() and same_bytes(fresh, latest):
            return None
        still_same = self._layered and (upload.sparse or self._still_same(self._last_poses(), fresh))
        upload.advance(fresh)
        # Of a camera that moves nothing is kept, and who looks after still bodies need not look.
        self.still_place += not (still_same or upload.sparse)
        self.moved, self.still_displaced = displaced, displaced and not still_same
        return self._instance_poses_of(self._last_poses if upload.sparse else fresh)

    def send(self, fresh: np.ndarray) -> InstancePoses:
        """Sends the next instant, from the last one on: poses float64 [E, M, 7] of the bodies that may move, in their
        order; all others stay. What is sent is there after `settle`, or `arrive` in a recording.

        For a visibility that is `sparse`. Raises ValueError naming a body whose pose is not finite.
        """
        upload = self._upload
        assert upload.sparse and upload.begun
        check_values(fresh, self._sent_names)
        upload.advance(fresh)
        return self._instance_poses_of(self._last_poses)

    def _last_poses(self) -> np.ndarray:
        last = self._upload.last
        assert last is not None
        return last

    def arrive(self) -> None:
        """Moves what `advance` or `send` sent into `poses`: a launch only, if `coming`."""
        self._upload.arrive()

    def settle(self) -> None:
        """Moves the poses that are under way to their place on the device at once."""
        self._upload.settle()

    @property
    def coming(self) -> int:
        """Gives 0 where `poses` are there, else a number that tells launches of `arrive` apart."""
        return self._upload.coming

    def as_placed(self, poses: np.ndarray) -> bool:
        """Tells whether all bodies are where `advance` took them to be: to be asked while the device draws."""
        last = self._upload.last
        return not self._upload.sparse or (
            last is not None and same_bytes(check_shape(poses, self.envs, self.names), last)
        )

    def place_others(self, frames: InstancePoses) -> None:
        """Places the instant of `advance` once more, where other bodies have moved too."""
        self.still_place += 1
        self.still_displaced = self.moved
        self._upload.put(frames.bodies)

    def _instance_poses_of(self, poses: np.ndarray | Callable[[], np.ndarray]) -> InstancePoses:
        geometry = self.geometry
        return InstancePoses(poses, self.camera_body, geometry.body, (geometry.rotation, geometry.translation))

    def update(self, poses: np.ndarray | InstancePoses) -> InstancePoses:
        """Fills `packed` for body poses float64 [E, N, 7]. On a GPU nothing is waited for."""
        frames = None if isinstance(poses, InstancePoses) else self.advance(poses, False)
        guessed = frames is not None
        if frames is None:
            frames = poses if isinstance(poses, InstancePoses) else self.instance_poses(poses)
            self.place(frames)
        self._draw_placed()
        if guessed and not isinstance(poses, InstancePoses) and not self.as_placed(poses):
            frames = self.instance_poses(poses)
            self.place_others(frames)
            self._draw_placed()
        return frames

    def _draw_placed(self) -> None:
        def launch() -> None:
            self.arrive()
            self.draw()

        self._graphs.run((self.coming, self.still_moved), launch)
        self.drawn()

    def place(self, frames: InstancePoses, previous: np.ndarray | None = None) -> None:
        """Brings poses to the device for `draw`, and those of the previous keyframe for `displace`.

        Counts in `still_place` how often still bodies or the camera have been elsewhere. Sets `moved`: anything is not
        where it was at `previous`; `still_displaced`: the same of still bodies and the camera.
        """
        upload, now = self._upload, frames.bodies
        last = upload.last
        still_same = last is not None and self._still_same(last, now)
        self.still_place += not still_same
        self.moved = self.still_displaced = False
        if previous is not None and not same_bytes(previous, now):
            self.moved = True
            if last is not None and (previous is last or same_bytes(previous, last)):
                self.still_displaced = not still_same
                wp.copy(upload.before, upload.now)
            else:
                previous = check_poses(previous, self.envs, self.names)
                self.still_displaced = not self._still_same(previous, now)
                upload.put_before(previous)
        upload.put(now)

    @property
    def last(self) -> np.ndarray | None:
        """Gives poses of the last update float64 [E, N, 7], valid until the next one."""
        return self._upload.last

    def same(self, frames: InstancePoses) -> bool:
        """Tells whether every body is where it was at the last update, to the last bit."""
        return self._upload.last is not None and same_bytes(self._upload.last, frames.bodies)

    @property
    def layered(self) -> bool:
        """Tells whether still instances are kept as a layer."""
        return self._layered

    @property
    def still_moved(self) -> bool:
        """Tells whether still bodies or the camera are not where they were when they were last drawn."""
        return self._still_drawn != self.still_place

    def drawn(self) -> None:
        """Notes that all is drawn: to be called after `arrive` and `draw`, or what was recorded of them."""
        self._upload.arrived()
        self._still_drawn = self.still_place

    def draw(self, placed: Callable[[], None] = lambda: None) -> None:
        """Fills `packed` for what is in `poses`: launches only, all arguments of which depend on `still_moved` alone.

        placed: called where the instances are placed and nothing is drawn yet.
        """
        ground, cleared = self._layer if self._layered else self.packed, self._cleared
        clear = not self._layered or self.still_moved
        with cleared.aside():
            self.raster.clear()
            if clear:
                ground.view(wp.int64).fill_(-1)
            else:
                wp.copy(self.packed, ground)
        self.place_instances()
        placed()
        if clear:
            self.raster.draw(ground, True, not self._layered, cleared.join)
        if self._layered and clear:
            wp.copy(self.packed, ground)
        if self._layered:
            self.raster.draw(self.packed, False, True, cleared.join)
        # Also where there was nothing to draw.
        cleared.join()

    def place_instances(self) -> None:
        """Computes `rotation`, `translation` and `eye` for what is in `poses`."""
        start = 0 if self.still_moved or not self._layered else self._still_count
        first = [self.poses, self.camera_body, start, *self._instances]
        dim = (self.envs, len(self.geometry.body) + 1 - start)
        outputs = [self.rotation, self.translation, self.eye]
        wp.launch(pose_kernels.place_instances, dim=dim, inputs=first, outputs=outputs, device=self.device)

    def place_at(self, poses: wp.array, rotation: wp.array, translation: wp.array, eye: wp.array) -> None:
        """Writes where all instances are, for other poses transformd [R, N], to rotation and translation [R, I] and eye
        [R]: a launch only."""
        given = [poses, self.camera_body, 0, *self._instances]
        dim = (poses.shape[0], len(self.geometry.body) + 1)
        outputs = [rotation, translation, eye]
        wp.launch(pose_kernels.place_instances, dim=dim, inputs=given, outputs=outputs, device=self.device)

    def displace(self, everything: bool, turn: wp.array, shift: wp.array) -> None:
        """Computes displacements [E, I + 1] since the previous keyframe (pose_kernels.displace_instances).

        everything: of all instances, not of the moving ones alone.
        """
        start = 0 if everything or not self._layered else self._still_count
        first = [self.poses, self._upload.before, self.camera_body, start, *self._instances]
        dim = (self.envs, len(self.geometry.body) + 1 - start)
        wp.launch(pose_kernels.displace_instances, dim=dim, inputs=first, outputs=[turn, shift], device=self.device)

    def _still_same(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Tells whether the still bodies, in a scene with a layer, are at the same poses."""
        still = self._still_bodies
        return self._layered and (same_bytes(a, b) or np.array_equal(a[:, still], b[:, still]))

    def hits(self) -> dict[str, np.ndarray]:
        """Unpacks the z-buffer into triangles, instances and surface points, as numpy arrays.

        triangle int32 [E, H, W]: index over all instances, -1 = nothing (of instance i: `geometry.first[i]` on);
        instance int32 [E, H, W], -1 = nothing; point float32 [E, H, W, 3] m in the frame of the instance's body.
        """
        out = [self.empty(self.shape, wp.int32), self.empty(self.shape, wp.int32), self.empty(self.shape, wp.vec3)]
        rest = [self.put(self.geometry.rotation, wp.mat33), self.put(self.geometry.translation, wp.vec3)]
        inputs = [self.view, self.packed, self.triangle_instance, self.rotation, self.translation, *rest, *out]
        wp.launch(output_kernels.body_points, dim=self.shape, inputs=inputs, device=self.device)
        return dict(zip(("triangle", "instance", "point"), (a.numpy() for a in out)))
