"""What a camera sees of known_motion.yaml, in float64 and in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SCENE = str(Path(__file__).with_name("known_motion.yaml"))
START, VELOCITY = np.array([-0.35, 2.0, 1.16]), np.array([4.0, 1.5, -2.0])
HALF = np.array([0.25, 0.2])
WALL, CAR = 1, 2
"""Semantic ids of its things."""


def place(t_ns: int) -> np.ndarray:
    """The card's middle in the camera's frame (x right, y down, z ahead), m."""
    x, y, z = START + VELOCITY * t_ns * 1e-9
    return np.array([x, 1.0 - z, y])


def edges(t_ns: int, width: int, height: int) -> np.ndarray:
    """Left, top, right and bottom edge of the card's image, px."""
    middle, f = place(t_ns), 1.25 * height
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    return np.concatenate([f * (middle[:2] + s * HALF) / middle[2] + centre for s in (-1, 1)])


def box(t_ns: int, width: int, height: int) -> np.ndarray:
    """First and last column and row whose pixels' centres lie on the card: x0, y0, x1, y1."""
    found = edges(t_ns, width, height)
    return np.concatenate((np.ceil(found[:2]), np.floor(found[2:])))


def flow(t_ns: int, to_ns: int, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each pixel's point is at the other time, px [H, W, 2], the wall at rest; and which pixels see the card."""
    y, x = np.mgrid[:height, :width].astype(float)
    f, centre = 1.25 * height, np.array([(width - 1) / 2, (height - 1) / 2])
    rays = np.stack(((x - centre[0]) / f, (y - centre[1]) / f, np.ones_like(x)), -1)
    points = rays * place(t_ns)[2] + (place(to_ns) - place(t_ns))
    there = f * points[..., :2] / points[..., 2:] + centre
    left, top, right, bottom = edges(t_ns, width, height)
    card = (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
    return np.where(card[..., None], there - np.stack((x, y), -1), 0.0), card
