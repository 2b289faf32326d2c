"""Samples of single pixels between the frames of a gap."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp


@dataclass
class Further:
    """Holds samples between the frames of a gap.

    first int32 [E H W + 1]: samples of pixel q = (e H + y) W + x are first[q] .. first[q + 1] - 1, ascending in time.
    offset int32 [R]: ns after the keyframe before, in the environment's own time. value float32 [R], in colour vec3:
    linear radiance. Warp arrays on the method's device.
    """

    first: wp.array
    offset: wp.array
    value: wp.array
