"""Reads the frames of a gap at the ends of its coarse intervals."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def light_at_start(
    image: wp.array3d(dtype=Any),
    frames: wp.array3d(dtype=Any),
    coarse: int,
    margin: int,
    env: int,
    k: int,
    y: int,
    x: int,
):
    """Reads a pixel (y, x) of the frame at which coarse interval k of an environment begins.

    image: of keyframe A, at which the first one does, with its margin. frames: [E coarse, h, w].
    """
    if k == 0:
        return image[env, y + margin, x + margin]
    return frames[env * coarse + k - 1, y, x]
