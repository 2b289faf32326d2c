"""Meshes, lights and the sky of the scenes that Mitsuba 3 has rendered, and where its values are."""

from pathlib import Path

import numpy as np
from light_scenes import lamp

from evis.scene.model import Camera, Mesh

REFERENCE = Path(__file__).parent / "reference"


def view():
    return Camera("cam0", 24, 16, np.array([[20.0, 0, 11.5], [0, 20.0, 7.5], [0, 0, 1]]))


def rectangle(centre, half_u, half_v):
    c, u, v = (np.array(a, float) for a in (centre, half_u, half_v))
    points = np.array([c - u - v, c + u - v, c + u + v, c - u + v], np.float32)
    return Mesh(points, np.array([(0, 1, 2), (0, 2, 3)], np.int32))


def cube(half):
    """Six faces about the origin."""
    axes = half * np.eye(3)
    meshes = [rectangle(s * axes[k], axes[k - 2], axes[k - 1]) for k in range(3) for s in (-1, 1)]
    faces = np.concatenate([m.faces + 4 * k for k, m in enumerate(meshes)])
    return Mesh(np.concatenate([m.vertices for m in meshes]), faces)


def light(centre, half_u, half_v, radiance):
    area = lamp(centre, half_u, half_v)
    area.colour = np.array(radiance)
    return area


def sky():
    """The function of make_reference.py on this map's directions."""
    h, w = 256, 512
    theta, phi = np.meshgrid((np.arange(h) + 0.5) / h * np.pi, (np.arange(w) + 0.5) / w * 2 * np.pi, indexing="ij")
    d = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    lobe = np.exp(12 * (d @ (np.array([2.0, -2.0, -1.0]) / 3) - 1))
    plain = np.stack([0.5 + 0.3 * d[..., 0], 0.5 - 0.3 * d[..., 1], 0.6 + 0.4 * d[..., 1] * d[..., 2]], -1)
    return (plain + lobe[..., None] * [4.0, 3.0, 2.0]).astype(np.float32)
