"""Builds the mipmaps of a scene's textures on the device."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Scene
from nodes.renderer.textures.texture_kernels import Textures


def pyramid(texture: np.ndarray) -> Iterator[np.ndarray]:
    """Gives the texture and its halvings down to one texel: float32 [h, w, 3], each the exact mean over its texel's
    area."""
    yield np.asarray(texture, np.float32)
    level = np.asarray(texture, np.float64)
    while level.shape[0] > 1 or level.shape[1] > 1:
        level = halve(halve(level, 0), 1)
        yield level.astype(np.float32)


def halve(level: np.ndarray, axis: int) -> np.ndarray:
    """Gives half as many texels along an axis, rounded down, at least 1; each the mean over the area that it covers."""
    count = level.shape[axis]
    if count == 1:
        return level
    moved = np.moveaxis(level, axis, 0)
    if count % 2 == 0:
        half = (moved[0::2] + moved[1::2]) / 2
    else:
        # Texel i of n covers [i, i + 1) (2 n + 1) / n: parts of two old ones and the whole of one between them.
        n = count // 2
        i = np.arange(n).reshape(-1, *(1,) * (moved.ndim - 1))
        half = ((n - i) * moved[0:-2:2] + n * moved[1:-1:2] + (i + 1) * moved[2::2]) / count
    return np.moveaxis(half, 0, axis)


def pack(scene: Scene, put: Any) -> tuple[Textures, bool]:
    """Gives the textures, and whether any instance shows one. put: as Visibility.put.

    Raises ValueError naming the material of a texture that is not finite [h, w, 3].
    """
    shown = {i.material for i in scene.instances if i.mesh.uv is not None}
    texels, levels, places, start = [np.zeros((0, 4), np.float32)], [(0, 0, 0)], [], 0
    for index, material in enumerate(scene.materials):
        if material.texture is None:
            places.append((0, 0))
            continue
        texture = np.asarray(material.texture, np.float32)
        if texture.ndim != 3 or texture.shape[2] != 3 or not texture.size:
            what = f"it is {list(texture.shape)}"
        elif not np.isfinite(texture).all():
            row, column = np.argwhere(~np.isfinite(texture).all(-1))[0]
            what = f"texel [{row}, {column}] is {texture[row, column].tolist()}"
        else:
            what = ""
        if what:
            raise ValueError(
                f"scene {scene.name}: texture of material '{material.name}' must be finite [h, w, 3], {what}"
            )
        if index not in shown:
            places.append((0, 0))
            continue
        places.append((len(levels), 0))
        for level in pyramid(texture):
            levels.append((start, level.shape[1], level.shape[0]))
            texels.append(np.pad(level.reshape(-1, 3), ((0, 0), (0, 1))))
            start += level.shape[0] * level.shape[1]
        places[-1] = (places[-1][0], len(levels) - places[-1][0])
    # A mesh without texture coordinates has its material's plain albedo.
    place = [places[i.material] if i.mesh.uv is not None else (0, 0) for i in scene.instances]
    packed = Textures()
    packed.texels, packed.levels = put(np.concatenate(texels), wp.vec4), put(np.array(levels), wp.vec3i)
    packed.place = put(np.array(place, np.int32).reshape(-1, 2), wp.vec2i)
    return packed, any(count for _, count in place)
