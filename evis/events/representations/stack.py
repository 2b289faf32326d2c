"""Counts events: in one image, or in a stack of images of consecutive slices."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.events.representations.columns import (
    NEVER,
    POLARITIES,
    TYPES,
    Columns,
    Representation,
    check_choice,
    check_positive,
)
from evis.events.representations.sum_kernels import stack_kernel

BY = ("time", "count")

for _types in TYPES:
    wp.overload(stack_kernel, _types)


def event_stack(
    events: Any,
    bins: int,
    *,
    by: str = "time",
    window: tuple[Any, Any] | None = None,
    polarity: str = "signed",
    height: int | None = None,
    width: int | None = None,
) -> Representation:
    """Counts the events of each of B slices of equal length, or of equal number (L. Wang et al., CVPR 2019, sec. 3.1).

    Args:
        events: anything with attributes or items t [n, int64 ns], x, y, p; with env_offsets [E + 1] a batch.
        bins: B.
        by: time, slice floor(B (t - t0) / (t1 - t0)), t1 itself in the last; or count, slice floor(B i / n) for event i
            of the n of the environment.
        window: (t0, t1) in ns, both included, each one or int64 [E]; None = first and last event of the environment.
            Not with by=count, which goes over all events.
        polarity: signed (OFF counts -1), split ([2 B, H, W], the OFF events' slices first), or merged (OFF counts 1).
        height, width: of the array; None = what the events say.

    Returns:
        values int32 [B, H, W] or [E, B, H, W], and the counts of events outside. Raises ValueError.
    """
    check_positive("bins", bins)
    check_choice("by", by, BY)
    if by == "count" and window is not None:
        raise ValueError("by=count goes over all events; cut them to the window first")
    columns = Columns(events, height, width)
    values = _count_events(columns, bins, by, window, polarity)
    return columns.result(values, tuple(values.shape[1:]))


def count_image(
    events: Any,
    *,
    window: tuple[Any, Any] | None = None,
    polarity: str = "split",
    height: int | None = None,
    width: int | None = None,
) -> Representation:
    """Counts the events of each pixel.

    Args:
        events: anything with attributes or items t [n, int64 ns], x, y, p; with env_offsets [E + 1] a batch.
        window: (t0, t1) in ns, both included, each one or int64 [E]; None = all events.
        polarity: split ([2, H, W], OFF first), signed (ON minus OFF, [H, W]), or merged (all, [H, W]).
        height, width: of the array; None = what the events say.

    Returns:
        values int32 [2, H, W] or [H, W], in a batch with E before, and the counts of events outside. Raises ValueError.
    """
    columns = Columns(events, height, width)
    always = (np.full(columns.envs, NEVER), np.full(columns.envs, -NEVER))
    values = _count_events(columns, 1, "count", always if window is None else window, polarity)
    shape = tuple(values.shape[1:])
    return columns.result(values, shape if polarity == "split" else shape[1:])


def _count_events(columns: Columns, bins: int, by: str, window: tuple[Any, Any] | None, polarity: str) -> Any:
    """Counts events into int32 [E, C, H, W]."""
    check_choice("polarity", polarity, POLARITIES)
    shape = (columns.envs, 2 * bins if polarity == "split" else bins, columns.height, columns.width)
    values: Any = wp.zeros(shape, dtype=wp.int32, device=columns.device)
    inputs = [*columns.per_event, columns.window(window), POLARITIES.index(polarity), bins, BY.index(by)]
    wp.launch(stack_kernel, columns.count, inputs=inputs, outputs=[values, columns.outside], device=columns.device)
    return values
