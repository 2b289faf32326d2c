"""Computes the pinhole camera, and the image motion of points fixed to moving bodies, in float64 closed form.

Camera frame: x right, y down, z forward. Pixel (0, 0) is the centre of the top-left pixel, so an image of width W has
its left edge at -0.5 and its middle at (W - 1) / 2.
"""

from __future__ import annotations

import math

import numpy as np

from evis.geometry import se3


def intrinsics(width: int, height: int, focal: float) -> np.ndarray:
    """Makes the matrix K [3, 3] with square pixels, focal length [px], and the principal point in the middle of the
    image.
    """
    return np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


def focal_from_fov(height: int, fov: float) -> float:
    """Computes the focal length [px] that makes the image, edge to edge, `fov` [rad] high."""
    return 0.5 * height / math.tan(0.5 * fov)


def pixel_grid(width: int, height: int) -> np.ndarray:
    """Computes the pixel centres (x, y), float64 [height, width, 2]."""
    return np.stack(np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)), axis=-1)


def project(k: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Computes the pixels [..., 2] of points [..., 3] in the camera frame; behind the camera the result means
    nothing.
    """
    points = np.asarray(points, np.float64)
    u, v = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    return np.stack((k[0, 0] * u + k[0, 1] * v + k[0, 2], k[1, 1] * v + k[1, 2]), axis=-1)


def unproject(k: np.ndarray, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Computes the points [..., 3] in the camera frame of pixels [..., 2] at z-depths [...] [m]."""
    pixels, depth = np.asarray(pixels, np.float64), np.asarray(depth, np.float64)
    v = (pixels[..., 1] - k[1, 2]) / k[1, 1]
    u = (pixels[..., 0] - k[0, 2] - k[0, 1] * v) / k[0, 0]
    return np.stack((u * depth, v * depth, depth), axis=-1)


def backward_motion(
    k: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    camera: np.ndarray,
    body: np.ndarray,
    camera_before: np.ndarray,
    body_before: np.ndarray,
) -> np.ndarray:
    """Computes where the surface point seen at a pixel was before, minus where it is now [px], [..., 2].

    pixels [..., 2], depth [...] now; poses [..., 7] of the camera and of the body that the point is fixed to, now and
    before (the paper's motion vector).
    """
    point = se3.transform(camera, unproject(k, pixels, depth))
    before = se3.transform(body_before, se3.transform(se3.inverse(body), point))
    return project(k, se3.transform(se3.inverse(camera_before), before)) - np.asarray(pixels, np.float64)
