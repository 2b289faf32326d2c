"""The GGX lobe of the glTF 2.0 formulas in float64, and what it gives back of a uniform sky."""

import numpy as np


def lobe(f0, roughness, n, v, l):
    """Specular BRDF [..., 3] of glTF 2.0, appendix B, in float64, for unit vectors [..., 3]."""
    alpha = roughness**2
    h = v + l
    h = h / np.linalg.norm(h, axis=-1, keepdims=True)
    nl, nv, nh, vh = ((a * b).sum(-1) for a, b in ((n, l), (n, v), (n, h), (v, h)))
    f = f0 + (1 - f0) * ((1 - vh) ** 5)[..., None]
    d = alpha**2 / (np.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    smith = lambda a, b: a * np.sqrt(b**2 * (1 - alpha**2) + alpha**2)
    mask = 0.5 / (smith(nl, nv) + smith(nv, nl))
    return f * (d * mask)[..., None]


def reflected(f0, roughness, mu):
    """What the lobe gives back of a uniform sky at cosines mu [N]: midpoints over half the hemisphere of l, float64.

    The polar angle is sampled about the mirror's direction, in tangents, so that a narrow lobe is resolved.
    """
    x, p = np.meshgrid((np.arange(1500) + 0.5) / 1500, (np.arange(120) + 0.5) / 120 * np.pi, indexing="ij")
    n, total = np.array([0.0, 0, 1]), []
    for m in np.atleast_1d(mu):
        # l about the mirrored view: angle t in [0, pi], dense where small.
        t = np.pi * x**3
        solid = np.sin(t) * 3 * np.pi * x**2 / 1500 * (np.pi / 120) * 2
        sine = np.sqrt(1 - m * m)
        axis, side = np.array([-sine, 0, m]), np.array([m, 0, sine])
        l = np.cos(t)[..., None] * axis + np.sin(t)[..., None] * (
            np.cos(p)[..., None] * side + np.sin(p)[..., None] * np.array([0.0, 1, 0])
        )
        up = l[..., 2] > 1e-9
        value = lobe(np.full(3, f0), roughness, n, np.array([sine, 0, m]), l[up])[..., 0]
        total.append((value * l[up][..., 2] * solid[up]).sum())
    return np.array(total)
