"""Computes distorting lenses in float64: OpenCV's Brown-Conrady (`plumb_bob`) and Kannala-Brandt fisheye
(`equidistant`).

plumb_bob, coefficients k1 k2 p1 p2 k3 [k4 k5 k6], with x = X / Z, y = Y / Z, s = x^2 + y^2 (Brown, Decentering
Distortion of Lenses, 1966; the names of ROS's sensor_msgs/CameraInfo):
    g = (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)
    u = x g + 2 p1 x y + p2 (s + 2 x^2),   v = y g + p1 (s + 2 y^2) + 2 p2 x y
equidistant, k1 ... k4, with theta the angle to the optical axis (Kannala and Brandt, A Generic Camera Model, 2006):
    h = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8),   (u, v) = h (X, Y) / hypot(X, Y)
A pixel is (fx u + cx, fy v + cy). Both are one to one only up to some angle, which `Lens.domain` finds; beyond it there
is no image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MODELS = {"none": (0,), "plumb_bob": (4, 5, 8), "equidistant": (4,)}
"""Distortion models, and how many coefficients each takes."""

NEWTON_STEPS = 50


@dataclass(frozen=True)
class Lens:
    """Holds a distortion model and its coefficients, padded with zeros to 8.

    domain: angle to the optical axis [rad] up to which the radial part grows and its inverse is looked for.
    """

    model: str
    k: tuple[float, ...]
    domain: float

    @staticmethod
    def of(model: str, coefficients: Sequence[float]) -> Lens:
        """Makes a lens. Raises ValueError for an unknown model, and for coefficients that do not belong to it or of
        which comes no image."""
        if model not in MODELS:
            raise ValueError(f"there is no distortion model '{model}'; there are {', '.join(MODELS)}")
        given = tuple(float(c) for c in coefficients)
        if len(given) not in MODELS[model]:
            counts = " or ".join(str(n) for n in MODELS[model])
            raise ValueError(f"distortion model {model} takes {counts} coefficients, there are {len(given)}")
        if not all(math.isfinite(c) for c in given):
            raise ValueError(f"distortion coefficients {list(given)} must be finite")
        k = given + (0.0,) * (8 - len(given))
        domain = _domain(model, k)
        if not domain:
            raise ValueError(f"distortion coefficients {list(given)} leave no image: it shrinks from the axis outwards")
        return Lens(model, k, domain)

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Computes the image plane (u, v), float64 [..., 2] in focal lengths, of points [..., 3] in the camera frame.

        NaN for a direction beyond `domain`.
        """
        points = np.asarray(points, np.float64)
        r = np.hypot(points[..., 0], points[..., 1])
        theta = np.arctan2(r, points[..., 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.model == "equidistant":
                ratio = np.divide(self._radial(theta), r, out=np.zeros_like(r), where=r > 0)
                uv = points[..., :2] * ratio[..., None]
            else:
                uv = self._bend(points[..., :2] / points[..., 2:])
        return np.where((theta < self.domain)[..., None], uv, np.nan)

    def undistort(self, uv: np.ndarray) -> np.ndarray:
        """Computes the unit directions float64 [..., 3] of image plane positions [..., 2]; NaN where no direction is
        seen.

        Newton's method from the optical axis outwards, with the step halved until the residual falls, so that it
        converges up to the rim of the domain.
        """
        uv = np.asarray(uv, np.float64)
        if self.model == "equidistant":
            length = np.linalg.norm(uv, axis=-1)
            theta = self._inverse_radial(length)
            ratio = np.divide(np.sin(theta), length, out=np.ones_like(length), where=length > 0)
            return np.concatenate([uv * ratio[..., None], np.cos(theta)[..., None]], -1)
        flat = uv.reshape(-1, 2)
        radius = np.tan(self._inverse_radial(np.linalg.norm(flat, axis=-1)))
        length = np.linalg.norm(flat, axis=-1)
        # Without the tangential part this is the solution; where there is none it starts at the rim.
        start = np.where(np.isfinite(radius), radius, 0.99 * math.tan(min(self.domain, 1.55)))
        ratio = np.divide(start, length, out=np.ones_like(length), where=length > 0)
        xy = self._newton(flat, flat * ratio[..., None])
        z = np.ones((*xy.shape[:-1], 1))
        rays = np.concatenate([xy, z], -1) / np.sqrt(1 + (xy**2).sum(-1))[..., None]
        return rays.reshape(*uv.shape[:-1], 3)

    def jacobian(self, xy: np.ndarray) -> np.ndarray:
        """Returns d(u, v) / d(x, y) of the plumb_bob model, float64 [..., 2, 2]; xy [..., 2] = (X / Z, Y / Z)."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.k
        x, y = xy[..., 0], xy[..., 1]
        s = x * x + y * y
        top, under = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
        g = top / under
        slope = (k1 + s * (2 * k2 + 3 * s * k3) - g * (k4 + s * (2 * k5 + 3 * s * k6))) / under
        cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        uu = g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        vv = g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return np.stack([np.stack([uu, cross], -1), np.stack([cross, vv], -1)], -2)

    def derivative(self, rays: np.ndarray) -> np.ndarray:
        """Returns d(u, v) / d(X, Y, Z) at the unit directions `rays` [..., 3], float64 [..., 2, 3], in focal lengths.

        At a distance d from the camera it is 1 / d of this. NaN where `rays` are.
        """
        x, y, z = rays[..., 0], rays[..., 1], rays[..., 2]
        if self.model == "equidistant":
            r, theta = np.hypot(x, y), np.arctan2(np.hypot(x, y), z)
            on_axis = r == 0
            outwards = np.stack((np.where(on_axis, 1.0, x), y), -1) / np.where(on_axis, 1.0, r)[..., None]
            around = np.stack((-outwards[..., 1], outwards[..., 0]), -1)
            k1, k2, k3, k4 = self.k[:4]
            s = theta * theta
            slope = 1 + s * (3 * k1 + s * (5 * k2 + s * (7 * k3 + s * 9 * k4)))
            # A step along a great circle through the axis changes theta, one across it turns about the axis.
            tilt = np.concatenate((outwards * z[..., None], -r[..., None]), -1)
            turn = np.concatenate((around, np.zeros_like(r)[..., None]), -1)
            stretch = np.divide(self._radial(theta), r, out=np.ones_like(r), where=~on_axis)
            return (slope[..., None] * outwards)[..., None] * tilt[..., None, :] + (
                (stretch[..., None] * around)[..., None] * turn[..., None, :]
            )
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = rays[..., :2] / z[..., None]
            flat = np.zeros((*z.shape, 2, 3))
            flat[..., 0, 0] = flat[..., 1, 1] = 1 / z
            flat[..., 2] = -xy / z[..., None]
        return self.jacobian(xy) @ flat

    def _bend(self, xy: np.ndarray) -> np.ndarray:
        k1, k2, p1, p2, k3, k4, k5, k6 = self.k
        x, y = xy[..., 0], xy[..., 1]
        s = x * x + y * y
        g = (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))
        u = x * g + 2 * p1 * x * y + p2 * (s + 2 * x * x)
        v = y * g + p1 * (s + 2 * y * y) + 2 * p2 * x * y
        return np.stack([u, v], -1)

    def _newton(self, target: np.ndarray, xy: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            residual = self._bend(xy) - target
            error = np.linalg.norm(residual, axis=-1)
            for _ in range(NEWTON_STEPS):
                step = np.linalg.solve(_regular(self.jacobian(xy)), residual[..., None])[..., 0]
                scale = np.ones(len(xy))
                for _ in range(8):
                    tried = xy - scale[:, None] * step
                    remaining = self._bend(tried) - target
                    # A step over a fold would end in the other branch, from which nothing leads back.
                    upright = np.linalg.det(self.jacobian(tried)) > 0
                    worse = ~(upright & (np.linalg.norm(remaining, axis=-1) <= error))
                    if not worse.any():
                        break
                    scale[worse] /= 2
                better = upright & (np.linalg.norm(remaining, axis=-1) < error)
                if not better.any():
                    break
                xy, residual = np.where(better[:, None], tried, xy), np.where(better[:, None], remaining, residual)
                error = np.linalg.norm(residual, axis=-1)
            solved = (error <= 1e-12 * (1 + np.linalg.norm(target, axis=-1))) & (
                np.arctan(np.linalg.norm(xy, axis=-1)) < self.domain
            )
            # The branch on which the map keeps its orientation: a start beyond a fold stays there.
            solved &= np.linalg.det(self.jacobian(xy)) > 0
        return np.where(solved[:, None], xy, np.nan)

    def _radial(self, theta: np.ndarray) -> np.ndarray:
        """Distance from the principal point, in focal lengths, without tangential distortion."""
        if self.model == "equidistant":
            s = theta * theta
            k1, k2, k3, k4 = self.k[:4]
            return theta * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
        k1, k2, _, _, k3, k4, k5, k6 = self.k
        x = np.tan(theta)
        s = x * x
        return x * (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))

    def _inverse_radial(self, length: np.ndarray) -> np.ndarray:
        """The angle at a distance, by bisection on the monotonic branch and so without fail; NaN beyond its end."""
        low, high = np.zeros_like(length), np.full_like(length, self.domain)
        with np.errstate(all="ignore"):
            end = self._radial(high)
            for _ in range(64):
                middle = (low + high) / 2
                under = self._radial(middle) < length
                low, high = np.where(under, middle, low), np.where(under, high, middle)
        return np.where(length < end, (low + high) / 2, np.nan)


def _domain(model: str, k: tuple[float, ...]) -> float:
    """First angle at which the radial part stops growing; pi / 2 or pi at most."""
    most = math.pi if model == "equidistant" else math.pi / 2 - 1e-6
    if model == "none":
        return most
    lens = Lens(model, k, most)
    theta = np.linspace(0.0, most, 20001)
    with np.errstate(all="ignore"):
        radial = lens._radial(theta)
        grows = np.diff(radial) > 0
    if grows.all():
        return most
    return float(theta[np.argmin(grows)])


def _regular(matrices: np.ndarray) -> np.ndarray:
    """The matrices, with the identity in place of a singular one or one that is not finite."""
    bad = ~(np.abs(np.linalg.det(matrices)) > 1e-12)
    return np.where(bad[..., None, None], np.eye(2), matrices)


def project(k: np.ndarray, lens: Lens, points: np.ndarray) -> np.ndarray:
    """Computes the pixels float64 [..., 2] of points [..., 3] in the camera frame; NaN beyond the lens's domain."""
    uv = lens.distort(points)
    return np.stack((k[0, 0] * uv[..., 0] + k[0, 2], k[1, 1] * uv[..., 1] + k[1, 2]), -1)


def unproject(k: np.ndarray, lens: Lens, pixels: np.ndarray) -> np.ndarray:
    """Computes the unit directions float64 [..., 3] of pixels [..., 2]; NaN where the lens sees nothing."""
    pixels = np.asarray(pixels, np.float64)
    uv = np.stack(((pixels[..., 0] - k[0, 2]) / k[0, 0], (pixels[..., 1] - k[1, 2]) / k[1, 1]), -1)
    return lens.undistort(uv)


def curvature_bounds(k: np.ndarray, lens: Lens, angle: float, count: int) -> np.ndarray:
    """Computes bounds [px/rad^2] on the second derivative of the pixel along any great circle, float64 [count + 1]: up
    to 0, 1/count, 2/count, ... of `angle` off the axis.

    The largest of a fine sampling, times 1.5.
    """
    samples = 33 if count == 1 else 4 * count + 1
    theta, phi, psi = np.meshgrid(
        np.linspace(0, angle, samples), np.linspace(0, 2 * np.pi, 16, endpoint=False), np.linspace(0, np.pi, 9)
    )
    sin, cos = np.sin(theta), np.cos(theta)
    out = np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], -1)
    along = np.stack([cos * np.cos(phi), cos * np.sin(phi), -sin], -1)
    across = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], -1)
    tangent = np.cos(psi)[..., None] * along + np.sin(psi)[..., None] * across
    h = 1e-3
    before, after = (project(k, lens, np.cos(h) * out + sign * np.sin(h) * tangent) for sign in (-1, 1))
    second = (after - 2 * project(k, lens, out) + before) / h**2
    greatest = np.nanmax(np.abs(second), axis=(0, 2, 3), initial=0.0)
    bounds: np.ndarray = 1.5 * np.maximum.accumulate(greatest)[:: (samples - 1) // count]
    return bounds
