"""Integrates what a GGX surface reflects of a uniform sky: tables, computed once in float64."""

from __future__ import annotations

from functools import cache

import numpy as np

from evis.scene.model import Material

LEAST_ALPHA = 1e-3
"""Smoothest surface: a lobe of a tenth of a degree stands for a mirror."""

COSINES, ROUGHNESSES = 32, 32


def is_plain(material: Material) -> bool:
    """Tells whether a material has no gloss: fully rough and not metallic; it is Lambert's."""
    return material.roughness >= 1 and material.metallic == 0


def alpha_of(material: Material) -> float:
    """Gives alpha = roughness^2 of a GGX material, -1 for a plain one."""
    return -1.0 if is_plain(material) else max(float(material.roughness) ** 2, LEAST_ALPHA)


@cache
def directional_albedo() -> np.ndarray:
    """Gives float64 [ROUGHNESSES, COSINES, 2]: rows of equal roughness 0 ... 1, columns of cosine (j / (COSINES -
    1))^2.

    (a, b): a surface reflects f0 a + b of a uniform sky from its specular lobe (Karis, Real Shading in Unreal Engine 4,
    2013, here with height-correlated masking). The rest reaches what lies below the lobe.
    """
    cosine = np.linspace(0, 1, COSINES) ** 2
    cosine[0] = 1e-4
    alpha = np.maximum(np.linspace(0, 1, ROUGHNESSES) ** 2, LEAST_ALPHA)
    # Midpoints; u1 is denser towards 1, where a narrow lobe's outskirts are. Both halves of the azimuth are alike.
    u0, x = (g.ravel() for g in np.meshgrid((np.arange(16) + 0.5) / 16, (np.arange(32) + 0.5) / 32))
    u1, share = 1 - x**3, 3 * x**2
    nv, a = cosine[None, :, None], alpha[:, None, None]
    v = np.stack(np.broadcast_arrays(np.sqrt(1 - nv**2), 0 * nv, nv), -1)
    stretched = np.stack(np.broadcast_arrays(a * v[..., 0], 0 * a, v[..., 2]), -1)
    stretched /= np.linalg.norm(stretched, axis=-1, keepdims=True)
    z = (1 - u1) * (1 + stretched[..., 2]) - stretched[..., 2]
    r, phi = np.sqrt(np.maximum(1 - z * z, 0)), np.pi * u0
    x, y, z = r * np.cos(phi) + stretched[..., 0], r * np.sin(phi), z + stretched[..., 2]
    h = np.stack([a * x, a * y, z], -1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    vh = (h * v).sum(-1)
    nl = 2 * vh * h[..., 2] - nv
    up = nl > 0
    nl = np.where(up, nl, 1.0)
    # BRDF times cosine over the density of the sample: G2 / G1.
    below = nl * np.sqrt(nv**2 * (1 - a * a) + a * a) + nv * np.sqrt(nl**2 * (1 - a * a) + a * a)
    weight = np.where(up, nl * (nv + np.sqrt(a * a + (1 - a * a) * nv**2)) / below, 0.0)
    schlick = np.clip(1 - vh, 0, 1) ** 5
    weight = weight * (share / share.mean())
    return np.stack([((1 - schlick) * weight).mean(-1), (schlick * weight).mean(-1)], -1)
