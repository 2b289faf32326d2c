"""Makes bodies with a hole and bodies with dents, by code as `shapes` are: what hides parts of itself."""

from __future__ import annotations

from functools import partial

import numpy as np

from evis.scene.mesh.normals import crease_normals
from evis.scene.mesh.shapes import grid, round_mesh, sagitta
from evis.scene.model import Mesh

WAVES = 24
"""Waves that dent a rock."""


def torus(radius: float, tube: float, finer: int = 1) -> Mesh:
    """Makes a ring about z of 48 x `finer` sides and 12 x `finer` around its tube, smooth normals, the texture once
    around both ways.

    radius: of the circle in the tube's middle [m]. tube: radius of the tube, less than `radius`. Raises ValueError.
    """
    if not tube < radius:
        raise ValueError(f"the tube's radius is {tube:g} m; it must be less than the ring's, {radius:g} m")
    u, v = np.meshgrid(np.linspace(0, 1, 48 * finer + 1), np.linspace(0, 1, 12 * finer + 1))
    out = radius - tube * np.cos(2 * np.pi * v)
    points = np.stack((out * np.cos(2 * np.pi * u), out * np.sin(2 * np.pi * u), -tube * np.sin(2 * np.pi * v)), -1)
    error = max((radius + tube) * sagitta(48 * finer), tube * sagitta(12 * finer))
    return round_mesh(_smooth(points, np.stack((u, v), -1)), error, partial(torus, radius, tube), radius + tube)


def rock(radius: float, rough: float, seed: int) -> Mesh:
    """Makes a lump of 1472 triangles, smooth normals, that a sphere of `radius` [m] encloses.

    rough: 0 = that sphere; 1 = dents that reach its middle. seed: decides where they are.
    """
    u, v = np.meshgrid(np.linspace(0, 1, 49), np.linspace(0, 1, 17))
    angle = np.pi * (v - 0.5)
    around = np.stack((np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), np.zeros_like(u)), -1)
    direction = np.cos(angle)[..., None] * around + np.sin(angle)[..., None] * np.array([0.0, 0.0, 1.0])
    direction[:, -1] = direction[:, 0]  # the seam is one line, whatever rounding says
    direction[0], direction[-1] = [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]
    random = np.random.Generator(np.random.Philox(key=[seed, 3]))
    wave = random.standard_normal((WAVES, 3)) * 2.2
    phase = random.random(WAVES) * 2 * np.pi
    height = np.sin(direction @ wave.T + phase).sum(axis=-1)
    dent = (height.max() - height) / max(float(np.ptp(height)), 1e-12)
    return _smooth(direction * radius * (1.0 - 0.999 * rough * dent)[..., None], np.stack((u, v), -1))


def _smooth(points: np.ndarray, uv: np.ndarray) -> Mesh:
    mesh = grid(points, uv)
    mesh.normals = crease_normals(mesh.vertices, mesh.faces, np.pi)
    return mesh
