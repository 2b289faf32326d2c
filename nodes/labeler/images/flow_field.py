"""Computes the optical flow of images of depth and ids, from the motion of rigid bodies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole, se3
from evis.gpu.host_copies import HostCopies
from evis.warp_start import start_warp
from nodes.labeler.images import image_label_kernels as kernels
from nodes.labeler.projection import Projection

start_warp()


class FlowField:
    """Computes the forward optical flow [px/s] of rigid bodies, exact at the stamp.

    A surface point X (camera frame) of body i moves relative to the camera with X' = b_i + w_i x X, where w_i is the
    body's angular velocity relative to the camera and b_i the velocity that the body, thought to go on, has at the
    camera's centre. The image velocity is the derivative of the projection, (5.16) in Ma et al., An Invitation to 3-D
    Vision; nothing is differenced.
    """

    def __init__(
        self,
        projection: Projection,
        size: tuple[int, int],
        bodies: Sequence[int],
        camera: int,
        device: str = "cpu",
    ) -> None:
        """Looks at the lens once, for every pixel.

        Args:
            projection: of the image without margin.
            size: (width, height) px.
            bodies: for every id, 0 (background) first, the index of its body in the state, -1 for the static world.
            camera: index of the camera's body.
            device: where images are, as Warp names it.
        """
        self.bodies = np.asarray(bodies, np.int64)
        self.camera = camera
        # Depth scales points with z = 1.
        rays, derivative = projection.at_unit_depth(pinhole.pixel_grid(*size))
        self._device: Any = wp.get_device(device)
        self._rays = self._there(np.ascontiguousarray(rays), wp.vec3d)
        self._derivative = self._there(np.ascontiguousarray(derivative), wp.vec3d)
        self._strange = self._there(np.zeros(2, np.int32), wp.int32)
        self._copies = HostCopies(self._strange)
        self._found: Callable[[], np.ndarray] | None = None
        """Tells of ids without a body in the last images."""

    def motions(self, pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Computes (b, w) of every id in the camera frame, float64 [E, ids, 6], for poses [E, N, 7] and twists
        [E, N, 6].
        """
        eye, own = pose[:, self.camera, None], twist[:, self.camera, None]
        still = (np.broadcast_to(a, (len(pose), 1, len(a))) for a in (se3.IDENTITY, np.zeros(6)))
        pose, twist = (np.concatenate(pair, axis=1) for pair in zip((pose, twist), still))
        v, omega = twist[:, self.bodies, :3], twist[:, self.bodies, 3:]
        at_camera = v + se3.cross(omega, eye[..., :3] - pose[:, self.bodies, :3])
        relative = (at_camera - own[..., :3], omega - own[..., 3:])
        return np.concatenate([se3.rotate(se3.conjugate(eye[..., 3:]), a) for a in relative], axis=-1)

    def __call__(self, pose: np.ndarray, twist: np.ndarray, depth: Any, ids: Any, out: Any) -> Any:
        """Writes the flow of images.

        Args:
            pose: float64 [E, N, 7] of the bodies, to the world.
            twist: float64 [E, N, 6] of the bodies, m/s and rad/s, world frame.
            depth: float32 [E, H, W] m, numpy's or Warp's on the device, as the next two.
            ids: int32 [E, H, W].
            out: float32 [E, H, W, 2] px/s, which is given back; NaN where depth is not finite.

        Raises ValueError for an id that has no body; on a GPU, for one in the images before. Of the last ones `settle`
        tells.
        """
        if isinstance(out, np.ndarray) and not self._device.is_cpu:
            raise ValueError(f"flow on {self._device} cannot be written into memory of the host")
        motions = self.motions(pose, twist).reshape(len(pose), -1, 2, 3)
        given = [
            self._rays, self._derivative, self._there(motions, wp.vec3d), self._there(depth, wp.float32),
            self._there(ids, wp.int32),
        ]  # fmt: skip
        found = [self._there(out, wp.float32), self._strange]
        wp.launch(kernels.flow_of_pixels, ids.shape, given, found, device=self._device)
        if self._device.is_cpu:
            self._check(self._strange.numpy())
        else:
            self.settle()
            self._found = self._copies.take()
        return out

    def settle(self) -> None:
        """Raises ValueError for an id that has no body in the last images; waits for the GPU that they were on."""
        if self._found is not None:
            found, self._found = self._found, None
            self._check(found())

    def _check(self, strange: np.ndarray) -> None:
        if strange.any():
            raise ValueError(f"ids run from {strange[1]} to {strange[0]}, CameraInfo names {len(self.bodies)}")

    def _there(self, values: Any, dtype: Any) -> Any:
        """Gives the same memory to a kernel, with its strides, or a copy on the device."""
        if not isinstance(values, np.ndarray):
            return values
        return wp.array(values, dtype=dtype, device=self._device, copy=not self._device.is_cpu)
