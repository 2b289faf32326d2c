"""Holds a scene's camera as the kernels have it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole
from evis.geometry.distortion import Lens, curvature_bounds, unproject
from evis.scene.model import Camera
from nodes.renderer.raster.lens.view_kernels import BUNDLE, CameraView

BEYOND = 0.05
"""How far outside the field of view [rad] the bounds of triangles are still taken from their corners."""
BULGES = 32
"""Angles off the axis up to which it is known how much edges are bent: at its border a lens may bend them a hundred
times as much as elsewhere."""

LEAST_AHEAD = 0.1
"""Least z of rays that look ahead, and the slope at which one has that."""
WIDEST = 10.0


def lens_of(camera: Camera) -> str:
    """Gives the name of the camera's distortion; `none` also where all coefficients are 0 and the model is a pinhole's
    then."""
    plain = camera.distortion_model == "plumb_bob" and not np.any(camera.distortion)
    return "none" if plain else camera.distortion_model


def finer(camera: Camera, n: int) -> Camera:
    """Gives the same camera with n x n pixels for each one; n^2 of them have a pixel's centre as their mean."""
    if n == 1:
        return camera
    k = np.array(camera.k, np.float64)
    k[:2] *= n
    k[:2, 2] += (n - 1) / 2
    return replace(camera, width=camera.width * n, height=camera.height * n, k=k)


def make_view(camera: Camera, margin: int, device: Any) -> CameraView:
    """Makes the kernels' view of a camera. Raises ValueError naming the camera and what cannot be its intrinsics, size
    or distortion."""
    k = np.asarray(camera.k, np.float64)
    if k.shape != (3, 3) or not np.isfinite(k).all() or not (k[0, 0] > 0 and k[1, 1] > 0) or k[0, 1] or k[1, 0]:
        raise ValueError(f"camera '{camera.name}': k must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], it is {k.tolist()}")
    if camera.width < 1 or camera.height < 1 or margin < 0 or not camera.near > 0:
        raise ValueError(
            f"camera '{camera.name}': {camera.width} x {camera.height} px, margin {margin} px, near {camera.near} m; "
            "the size and near must be above 0"
        )
    try:
        lens = Lens.of(camera.distortion_model, camera.distortion)
    except ValueError as error:
        raise ValueError(f"camera '{camera.name}': {error}") from None
    view = CameraView()
    view.fx, view.fy, view.cx, view.cy = (float(v) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
    view.near, view.margin = float(camera.near), margin
    view.width, view.height = camera.width + 2 * margin, camera.height + 2 * margin
    if lens_of(camera) == "none":
        far_x = max(view.cx + margin, view.width - 1 - margin - view.cx) / view.fx
        far_y = max(view.cy + margin, view.height - 1 - margin - view.cy) / view.fy
        view.reach = float(np.hypot(np.hypot(far_x, far_y), 1.0))
        view.columns = wp.array(_slopes(view.width, margin, view.fx, view.cx), dtype=wp.float32, device=device)
        view.rows = wp.array(_slopes(view.height, margin, view.fy, view.cy), dtype=wp.float32, device=device)
        view.rays = wp.empty((0, 0), dtype=wp.vec3, device=device)
        view.cones = wp.empty((0, 0), dtype=wp.vec4, device=device)
        view.above = view.below = view.bulges = wp.empty(0, dtype=wp.float32, device=device)
        return view
    view.columns = view.rows = view.above = view.below = wp.empty(0, dtype=wp.float32, device=device)
    rays = unproject(k, lens, pinhole.pixel_grid(view.width, view.height) - margin)
    angle = np.arccos(np.clip(rays[..., 2], -1.0, 1.0))
    widest = float(np.nanmax(angle, initial=0.0)) + 1e-5
    view.distorted, view.reach = 1, 1.0
    _hold(view, rays, device)
    view.rays = wp.array(np.nan_to_num(rays).astype(np.float32), dtype=wp.vec3, device=device)
    view.cones = wp.array(cones_of(np.nan_to_num(rays)), dtype=wp.vec4, device=device)
    coefficients: Any = type(view.lens)
    view.lens = coefficients(lens.k)
    view.cos_field, view.sin_field = float(np.cos(widest)), float(np.sin(widest))
    view.domain = lens.domain
    bounded = min(lens.domain, widest + BEYOND, np.pi)
    view.bounded, view.cos_bounded, view.sin_bounded = bounded, float(np.cos(bounded)), float(np.sin(bounded))
    bulges = curvature_bounds(k, lens, bounded, BULGES).astype(np.float32)
    view.bulges = wp.array(bulges, dtype=wp.float32, device=device)
    return view


def _hold(view: Any, rays: np.ndarray, device: Any) -> None:
    """Fills in between which planes rays [H, W, 3] are that all look ahead; NaN where the lens sees nothing."""
    seen = np.isfinite(rays).all(-1)
    view.ahead = int(seen.any() and rays[seen][:, 2].min() > LEAST_AHEAD)
    if not view.ahead:
        return
    # As far outside as a triangle is widened, and more.
    pad = 0.5 / min(view.fx, view.fy)
    across, down = (rays[..., axis] / rays[..., 2] for axis in (0, 1))
    view.left, view.right = float(np.nanmin(across)) - pad, float(np.nanmax(across)) + pad
    least = np.where(seen, down, np.inf).min(axis=1)
    most = np.where(seen, down, -np.inf).max(axis=1)
    above = np.minimum.accumulate(least[::-1])[::-1].clip(-WIDEST, WIDEST) - pad
    below = np.maximum.accumulate(most).clip(-WIDEST, WIDEST) + pad
    view.above, view.below = (wp.array(a.astype(np.float32), dtype=wp.float32, device=device) for a in (above, below))


def cones_of(rays: np.ndarray) -> np.ndarray:
    """Computes `cones` of a CameraView, float32 [ceil(H / BUNDLE), ceil(W / BUNDLE), 4].

    rays: unit vectors [H, W, 3], 0 where the lens sees nothing.
    """
    size, (height, width) = int(BUNDLE), rays.shape[:2]
    padded = np.pad(rays, ((0, -height % size), (0, -width % size), (0, 0)))
    bundles = padded.reshape(padded.shape[0] // size, size, padded.shape[1] // size, size, 3).swapaxes(1, 2)
    middle = bundles.sum((2, 3))
    middle /= np.maximum(np.linalg.norm(middle, axis=-1, keepdims=True), 1e-30)
    there = (bundles != 0).any(-1)
    cosine = np.where(there, (bundles * middle[:, :, None, None]).sum(-1), 1.0).min((2, 3))
    # Where rays go all ways the middle tells nothing.
    wide = np.where(cosine > 0, np.sqrt(np.maximum(1 - cosine**2, 0)) + 1 - cosine, 3.0) + 1e-5
    return np.concatenate([middle, wide[..., None]], axis=-1).astype(np.float32)


def _slopes(count: int, margin: int, focal: float, centre: float) -> np.ndarray:
    """Computes (i - margin - centre) / focal for i < count, in float32."""
    return (np.arange(count, dtype=np.float32) - np.float32(margin) - np.float32(centre)) / np.float32(focal)
