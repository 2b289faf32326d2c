"""Computes ground truth for one camera from poses, depth and ids, by pure functions of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole, se3
from evis.geometry.distortion import Lens, unproject
from evis.gpu.host_copies import HostCopies
from evis.warp_start import start_warp
from nodes.labeler import image_label_kernels as kernels

start_warp()


def crop(image: Any, margin: int) -> Any:
    """Leaves out the margin of images [E, H + 2 margin, W + 2 margin, ...], numpy's or Warp's, as a view."""
    return image[:, margin:-margin, margin:-margin] if margin else image


def lens_of(model: str, coefficients: np.ndarray) -> Lens | None:
    """Makes the lens that CameraInfo describes, None for a pinhole. Raises ValueError for an unknown model."""
    straight = model == "plumb_bob" and not np.any(coefficients)
    return None if straight or model == "none" else Lens.of(model, np.asarray(coefficients).tolist())


class FlowField:
    """Computes the forward optical flow [px/s] of rigid bodies, exact at the stamp.

    A surface point X (camera frame) of body i moves relative to the camera with X' = b_i + w_i x X, where w_i is the
    body's angular velocity relative to the camera and b_i the velocity that the body, thought to go on, has at the
    camera's centre. The image velocity is the derivative of the projection, (5.16) in Ma et al., An Invitation to 3-D
    Vision; nothing is differenced.

    """

    def __init__(
        self,
        k: np.ndarray,
        size: tuple[int, int],
        bodies: Sequence[int],
        camera: int,
        lens: Lens | None = None,
        device: str = "cpu",
    ) -> None:
        """Looks at the lens once, for every pixel.

        Args:
            k: float64 [3, 3] px, of the image without margin.
            size: (width, height) px.
            bodies: for every id, 0 (background) first, the index of its body in the state, -1 for the static world.
            camera: index of the camera's body.
            lens: its distortion, None for a pinhole.
            device: where images are, as Warp names it.
        """
        self.k = np.asarray(k, np.float64)
        self.bodies = np.asarray(bodies, np.int64)
        self.camera = camera
        pixels = pinhole.pixel_grid(*size)
        # Points on these rays have z = 1, so that depth scales them.
        if lens is None:
            self._rays = pinhole.unproject(self.k, pixels, np.ones(size[::-1]))
            x, y = self._rays[..., 0], self._rays[..., 1]
            one, none = np.ones_like(x), np.zeros_like(x)
            plane = np.stack((np.stack((one, none, -x), -1), np.stack((none, one, -y), -1)), -2)
        else:
            unit = unproject(self.k, lens, pixels)
            with np.errstate(divide="ignore", invalid="ignore"):
                self._rays = unit / unit[..., 2:]
                plane = lens.derivative(unit) * unit[..., 2, None, None]
        # d(pixel) / d(X, Y, Z) on the rays, [H, W, 2, 3]
        focal = self.k[:2, :2] if lens is None else np.diag(np.diag(self.k)[:2])
        self._device: Any = wp.get_device(device)
        self._on_rays = self._there(np.ascontiguousarray(self._rays), wp.vec3d)
        self._derivative = self._there(np.ascontiguousarray(focal @ plane), wp.vec3d)
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
            self._on_rays, self._derivative, self._there(motions, wp.vec3d), self._there(depth, wp.float32),
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
        """The same memory for a kernel, with its strides, or a copy on the device."""
        if not isinstance(values, np.ndarray):
            return values
        return wp.array(values, dtype=dtype, device=self._device, copy=not self._device.is_cpu)


def boxes(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the visible extent of every instance in ids int32 [E, H, W], the background left out.

    Returns float32 [B, 4] (x0, y0, x1, y1, inclusive pixels), int32 [B] environment and int32 [B] id, by environment
    and then id.
    """
    count = int(ids.max(initial=0)) + 1
    least = np.full((len(ids), count, 2), np.iinfo(np.int32).max, np.int32)
    most = np.full_like(least, -1)
    if ids.size:
        given = _array(np.ascontiguousarray(ids), wp.int32)
        found = [_array(least, wp.int32), _array(most, wp.int32)]
        wp.launch(kernels.extents, ids.shape[:2], [given], found, device="cpu")
    env, number = np.nonzero(most[:, 1:, 0] >= 0)
    box = np.concatenate((least[env, number + 1], most[env, number + 1]), axis=1).astype(np.float32)
    return box, env.astype(np.int32), (number + 1).astype(np.int32)


def _array(values: np.ndarray, dtype: Any) -> wp.array:
    """The same memory for a kernel, with its strides."""
    return wp.array(values, dtype=dtype, device="cpu", copy=False)
