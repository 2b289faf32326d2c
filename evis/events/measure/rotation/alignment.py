"""Estimates turning and sliding of an image within a short window, from its events alone.

Events of the window are warped to its middle by a rotation and a translation; the blurred image of the warped events
pulls each event towards where they are dense (mean shift: s^2 grad I / I). The motion that best explains the pulls is
found by least squares, and again with a finer blur. The translation is free, so that neither an error of the pivot nor
a hub that gives way bends the speed. Where the border of the view cuts a pattern, the cut stands still and would hold
the motion back: only events count whose place is in view throughout the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.events.measure.rotation.plane import Plane

SIGMAS = (4.0, 3.0, 2.0, 2.0, 1.5, 1.5)
"""Blur of each improvement [px]."""
EVENTS = 1500
_MARGIN = 12
_STIFFNESS = 0.002
"""Holds the translation where the events say nothing about it, as along a straight edge."""
_OVERSTEP = 1.2
"""The pull of a Gaussian cloud is half of what would bring it together, that of a thin line all of it."""
_HOME = 0.6
"""Pulls shorter than this [px] say where an event is to stay, along an edge too; of longer ones only the way counts."""
_SIDE = 128


def align(
    tau: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, half_s: float, omega: float
) -> tuple[float, float]:
    """Finds the speed [rad/s, positive from x to y], starting from `omega`, and the share of events that were gathered.

    tau: float [n, s] within +-half_s of the middle; x, y: in the plane of the rotation, from its pivot [px]; p 0 or 1.
    NaN with fewer than 40 events.
    """
    if len(tau) < 40:
        return float("nan"), 0.0
    part = slice(None, None, max(1, -(-len(tau) // EVENTS)))
    tau, x, y, p = tau[part], x[part], y[part], p[part].astype(np.int64)
    scale = max(1.0, max(np.ptp(x), np.ptp(y)) / _SIDE)
    corner = np.array([x.min(), y.min()])
    x, y = x / scale, y / scale
    shape = tuple(int(np.ptp(v)) + 2 * _MARGIN + 2 for v in (y, x))
    window = _Window(tau, x, y, p, _weights(tau, half_s), _MARGIN - corner / scale, shape)
    motion = np.array([omega, 0.0, 0.0])
    for sigma in SIGMAS:
        motion, gathered = _improve(window, motion, sigma)
    return float(motion[0]), gathered


def in_view(
    tau: np.ndarray, u: np.ndarray, v: np.ndarray, half_s: float, omega: float, plane: Plane, view: np.ndarray
) -> np.ndarray:
    """Tells which events [n] turn about the pivot at `omega` [rad/s] for the whole window without leaving the view.

    tau: float [n, s] within +-half_s; u, v: in the plane, from the pivot [px]; view: [4, px] least and greatest x,
    least and greatest y of the image.
    """
    keep = np.ones(len(tau), bool)
    for end in half_s * np.linspace(-1, 1, 5):
        cos, sin = np.cos(omega * (end - tau)), np.sin(omega * (end - tau))
        x, y = plane.to_image(cos * u - sin * v, sin * u + cos * v)
        keep &= (x >= view[0]) & (x <= view[1]) & (y >= view[2]) & (y <= view[3])
    return keep


def _weights(tau: np.ndarray, half_s: float) -> np.ndarray:
    """Computes a cosine taper in time, the same for busy and quiet parts of the window; the sum is 1."""
    part = ((tau + half_s) * (8 / half_s)).astype(np.int64).clip(0, 15)
    counts = np.bincount(part, minlength=16)
    weight = np.cos(np.pi / 2 * tau / half_s) ** 2 / (counts[part] + 0.2 * counts.mean() + 1)
    return weight / weight.sum()


@dataclass(frozen=True)
class _Window:
    """Holds the events of a window on the grid of its image.

    tau: float [n, s]; x, y: float [n, pixels of the image] from the pivot; p: int64 [n]; weight: float [n], sum 1.
    origin: place of the pivot in the image (x, y). shape: of the image.
    """

    tau: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    weight: np.ndarray
    origin: np.ndarray
    shape: tuple[int, ...]


@dataclass(frozen=True)
class _Pulls:
    """Holds, for the events inside the image, their warped places u, v, and the pull towards where events are dense.

    inside: bool [n], which events these are. cos, sin: of the angle by which each was turned.
    """

    inside: np.ndarray
    u: np.ndarray
    v: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    x: np.ndarray
    y: np.ndarray


def _improve(window: _Window, motion: np.ndarray, sigma: float) -> tuple[np.ndarray, float]:
    """Moves a motion (speed [rad/s], velocity x, y) to where it explains the pulls best, by least squares.

    Returns it with the share of events that are gathered.
    """
    pulls = _pulls(window, motion, sigma)
    if pulls is None:
        return motion, 0.0
    tau, weight = window.tau[pulls.inside], window.weight[pulls.inside]
    u, v, cos, sin = pulls.u, pulls.v, pulls.cos, pulls.sin
    length_2 = pulls.x**2 + pulls.y**2
    # how each of the three parameters moves an event
    by_x = np.stack([tau * v, -tau * cos, -tau * sin], 1)
    by_y = np.stack([-tau * u, tau * sin, -tau * cos], 1)
    along = by_x * pulls.x[:, None] + by_y * pulls.y[:, None]
    share = (weight / (length_2 + _HOME**2))[:, None]
    normal = along.T @ (along * share) + _HOME**2 * (by_x.T @ (by_x * share) + by_y.T @ (by_y * share))
    right = weight @ along
    stiffness = _STIFFNESS * normal[0, 0] / 400
    normal[1, 1] += stiffness
    normal[2, 2] += stiffness
    right[1:] -= stiffness * motion[1:]
    step = np.linalg.solve(normal + 1e-15 * np.eye(3), right)
    return motion + _OVERSTEP * step, float(weight[length_2 < (0.5 * sigma) ** 2].sum())


def _pulls(window: _Window, motion: np.ndarray, sigma: float) -> _Pulls | None:
    """Warps the events by a motion and computes their pulls sigma^2 grad I / I; None where few are in the image."""
    tau = window.tau
    cos, sin = np.cos(motion[0] * tau), np.sin(motion[0] * tau)
    dx, dy = window.x - motion[1] * tau, window.y - motion[2] * tau
    u, v = cos * dx + sin * dy, cos * dy - sin * dx
    column, row = u + window.origin[0], v + window.origin[1]
    height, width = window.shape
    i, j = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    inside = (i >= 1) & (j >= 1) & (i < height - 2) & (j < width - 2)
    if inside.sum() < 20:
        return None
    i, j = i[inside], j[inside]
    fi, fj = row[inside] - i, column[inside] - j
    base = (window.p[inside] * height + i) * width + j
    corners = ((0, (1 - fi) * (1 - fj)), (1, (1 - fi) * fj), (width, fi * (1 - fj)), (width + 1, fi * fj))
    image, weight = np.zeros(2 * height * width), window.weight[inside]
    for offset, share in corners:
        image += np.bincount(base + offset, weight * share, len(image))
    blurred = _blur(image.reshape(2, height, width), sigma)
    slope_x, slope_y = np.zeros_like(blurred), np.zeros_like(blurred)
    slope_x[:, :, 1:-1] = (blurred[:, :, 2:] - blurred[:, :, :-2]) / 2
    slope_y[:, 1:-1] = (blurred[:, 2:] - blurred[:, :-2]) / 2

    def at(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(-1)
        return sum(flat[base + offset] * share for offset, share in corners)  # type: ignore[return-value]

    density = at(blurred) + 1e-12
    pull_x, pull_y = sigma**2 * at(slope_x) / density, sigma**2 * at(slope_y) / density
    return _Pulls(inside, u[inside], v[inside], cos[inside], sin[inside], pull_x, pull_y)


def _blur(image: np.ndarray, sigma: float) -> np.ndarray:
    radius = round(3 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    for axis in (1, 2):
        widths = [(0, 0)] * 3
        widths[axis] = (radius, radius)
        padded = np.pad(image, widths)
        length = image.shape[axis]
        cut = [slice(None)] * 3
        total = np.zeros_like(image)
        for k, share in enumerate(kernel):
            cut[axis] = slice(k, k + length)
            total += share * padded[tuple(cut)]
        image = total
    return image
