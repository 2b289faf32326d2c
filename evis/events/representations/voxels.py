"""Computes the voxel grid: events in bins of time, each shared between the two bins nearest to it."""

from __future__ import annotations

from typing import Any

import warp as wp

from evis.events.representations.columns import (
    POLARITIES,
    TYPES,
    Columns,
    Representation,
    check_choice,
    check_flag,
    check_positive,
)
from evis.events.representations.sum_kernels import (
    normalise_kernel,
    row_moments_kernel,
    spread_kernel,
    voxel_kernel,
    weights_kernel,
)

for _types in TYPES:
    wp.overload(voxel_kernel, _types)


def voxel_grid(
    events: Any,
    bins: int,
    *,
    window: tuple[Any, Any] | None = None,
    polarity: str = "signed",
    normalise: bool = False,
    height: int | None = None,
    width: int | None = None,
) -> Representation:
    """Computes a voxel grid, linear in time: V(b, y, x) = sum of p max(0, 1 - |b - t*|), t* = (B - 1)(t - t0) / (t1 -
    t0).

    From A. Z. Zhu et al., CVPR 2019, eqs. (1) and (2). As it stands with `normalise=True` this is the input of E2VID
    (H. Rebecq et al., TPAMI 2021): signed, from the first event to the last, the voxels that are not 0 brought to mean
    0 and standard deviation 1 (of the population).

    Args:
        events: anything with attributes or items t [n, int64 ns], x, y, p; with env_offsets [E + 1] a batch.
        bins: B.
        window: (t0, t1) in ns, both included, each one or int64 [E]; None = first and last event of the environment.
        polarity: signed (OFF counts -1), split ([2 B, H, W], the OFF events' bins first), or merged (OFF counts 1).
        normalise: as E2VID does; per environment.
        height, width: of the array; None = what the events say.

    Returns:
        values float32 [B, H, W] or [E, B, H, W], and the counts of events outside. Raises ValueError.
    """
    check_positive("bins", bins)
    check_choice("polarity", polarity, POLARITIES)
    check_flag("normalise", normalise)
    columns = Columns(events, height, width)
    channels = 2 * bins if polarity == "split" else bins
    shape = (channels, columns.height, columns.width)
    device, envs = columns.device, columns.envs
    voxels: Any = wp.zeros((envs, *shape), dtype=wp.int64, device=device)
    values: Any = wp.empty((envs, *shape), dtype=wp.float32, device=device)
    inputs = [*columns.per_event, columns.window(window), POLARITIES.index(polarity), bins]
    wp.launch(voxel_kernel, columns.count, inputs=inputs, outputs=[voxels, columns.outside], device=device)
    wp.launch(weights_kernel, voxels.size, inputs=[voxels.flatten()], outputs=[values.flatten()], device=device)
    if normalise:
        _normalise(values.reshape((envs, channels * columns.height, columns.width)))
    return columns.result(values, shape)


def _normalise(values: Any) -> None:
    """Normalises, in place, values [E, rows, W]."""
    envs, rows, _ = values.shape
    moments: Any = wp.empty((envs, rows, 3), dtype=wp.float64, device=values.device)
    spread: Any = wp.empty((envs, 2), dtype=wp.float64, device=values.device)
    wp.launch(row_moments_kernel, (envs, rows), inputs=[values], outputs=[moments], device=values.device)
    wp.launch(spread_kernel, envs, inputs=[moments], outputs=[spread], device=values.device)
    wp.launch(normalise_kernel, values.shape, inputs=[spread], outputs=[values], device=values.device)
