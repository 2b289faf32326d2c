"""Holds samples of single pixels between the frames of a gap, and tells which cameras have none."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.scene.model import Camera
from evis.scene.sampling import LONGEST_GAP_NS, too_far_apart
from nodes.renderer import parameters

if TYPE_CHECKING:
    import warp as wp


def by_frames_alone(camera: Camera, params: Mapping[str, Any]) -> str:
    """Says why the pixels of a camera go by frames alone although there is a tolerance of time; "" where they do
    not."""
    if parameters.by_paths(params):
        why = "their light comes by paths (bounces, sky_occlusion)"
    elif too_far_apart(rate := params.get("keyframe_rate") or 0.0):
        why = (
            f"keyframes are {1 / rate:.4g} s apart, and pixels are looked at between those less than "
            f"{LONGEST_GAP_NS * 1e-9:.4g} s apart (keyframe_rate)"
        )
    else:
        return ""
    return f"time_tolerance changes nothing: all {camera.width}x{camera.height} pixels go by frames alone, for {why}"


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

    def arrays(self, on_device: bool) -> tuple[Any, Any, Any]:
        """Gives first, offset and value, float32 [R] or [R, 3]; on_device: as Warp arrays, where colours are vec3."""
        if on_device:
            return self.first, self.offset, self.value
        return self.first.numpy(), self.offset.numpy(), self.value.numpy()


class Parting:
    """Divides the samples of E environments into those of each, one gap after the other."""

    def __init__(self, envs: int, device: Any) -> None:
        import warp as wp

        from evis.gpu.host_copies import HostCopies

        self._begins: wp.array = wp.zeros(envs, dtype=wp.int32, device=device)
        self._copies = HostCopies(self._begins)

    def of(self, further: Further) -> Callable[[], list[Further | None]]:
        """Divides samples behind what a GPU does; what this returns waits for that alone, and gives those of each
        environment, None where there are none."""
        import warp as wp

        from nodes.interpolator.refine.samples.sort_kernels import begin_at_zero

        envs, device = self._begins.size, self._begins.device
        pixels = (further.first.size - 1) // envs
        firsts: wp.array = wp.empty((envs, pixels + 1), dtype=wp.int32, device=device)
        wp.launch(begin_at_zero, firsts.shape, [further.first], [firsts, self._begins], device=device)
        begins = self._copies.take()

        def each() -> list[Further | None]:
            edges = [*begins().tolist(), further.offset.size]
            return [
                Further(firsts[e], further.offset[start:end], further.value[start:end]) if end > start else None
                for e, (start, end) in enumerate(pairwise(edges))
            ]

        return each


def none_of(pixels: int, colour: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gives first, offset and value of pixels without samples."""
    return np.zeros(pixels + 1, np.int32), np.zeros(0, np.int32), np.zeros((0, 3) if colour else 0, np.float32)


def joined(
    parts: Sequence[tuple[np.ndarray, np.ndarray, Further | None]], envs: int, pixels: int, device: Any
) -> Further | None:
    """Joins the samples of several groups of environments to those of all E, on a device; None without any.

    Args:
        parts: of each group its environments int [n], their rows within the group int [n], and its samples.
        envs: E.
        pixels: of an environment.
        device: where the result lies.
    """
    import warp as wp

    lists: list[tuple[np.ndarray, np.ndarray, np.ndarray] | None] = [None] * envs
    for mine, rows, found in parts:
        if found is not None:
            first, offset, value = found.arrays(False)
            for env, row in zip(mine.tolist(), rows.tolist()):
                begins = first[row * pixels : (row + 1) * pixels + 1]
                own = slice(int(begins[0]), int(begins[-1]))
                lists[env] = np.diff(begins), offset[own], value[own]
    some = [one for one in lists if one is not None]
    if not some:
        return None
    counts = [np.zeros(pixels, np.int64) if one is None else one[0] for one in lists]
    first = np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int32)
    offset, value = (np.concatenate([one[k] for one in some]) for k in (1, 2))
    pixel: Any = wp.vec3 if value.ndim == 2 else wp.float32
    return Further(
        wp.array(first, dtype=wp.int32, device=device),
        wp.array(offset, dtype=wp.int32, device=device),
        wp.array(value, dtype=pixel, device=device),
    )
