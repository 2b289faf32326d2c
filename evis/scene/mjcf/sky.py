"""Makes an environment map of the skybox of a MuJoCo model: what is seen behind everything, which lights nothing
there."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.scene.images.sky import directions
from evis.scene.mjcf.textures import pixels

MAX_FACE = 512
"""Most texels along the side of a face that the map keeps apart."""


def skybox(model: Any) -> np.ndarray | None:
    """Computes the radiance float32 [h, 2h, 3] of the model's first skybox texture, as `evis.scene.images.sky` has
    maps; None without.

    As fine as the texture up to MAX_FACE; the texels of a finer one are averaged. Displayed 1 is the radiance 1, as of
    a white surface under a light of diffuse 1.
    """
    found = np.flatnonzero(np.asarray(model.tex_type) == int(mujoco.mjtTexture.mjTEXTURE_SKYBOX))
    if not len(found):
        return None
    faces = pixels(model, int(found[0]))
    block = -(-faces.shape[1] // MAX_FACE)
    if block > 1:
        width = faces.shape[1] // block
        whole = faces.reshape(6, -1, faces.shape[1], 3)[:, : width * block, : width * block]
        faces = whole.reshape(6 * width, block, width, block, 3).mean(axis=(1, 3))
    rows = max(16, 2 * faces.shape[1])
    return np.concatenate([_looked_up(faces, band) for band in np.array_split(directions(rows), rows // 16)])


def _looked_up(faces: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Nearest texels of six faces [6 w, w, 3] in world directions [..., 3]; MuJoCo's sky has y up."""
    width = faces.shape[1]
    x, y, z = toward[..., 0], toward[..., 2], -toward[..., 1]
    size = np.abs(np.stack((x, y, z)))
    axis = np.argmax(size, axis=0)
    major = np.max(size, axis=0)
    negative = np.choose(axis, (x, y, z)) < 0
    face = 2 * axis + negative
    s = np.choose(face, (-z, z, x, x, x, -x)) / major
    t = np.choose(face, (-y, -y, z, -z, -y, -y)) / major
    column, row = (np.clip((0.5 * (v + 1) * width).astype(np.int64), 0, width - 1) for v in (s, t))
    return faces[face * width + row, column]
