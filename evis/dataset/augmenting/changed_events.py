"""Computes the events of a window as they are after augmentation, with the labels that each of them has."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.dataset.augmenting.arrays import cast, module_of, order_of, uniforms
from evis.dataset.augmenting.augmentation import Augment, Drawn
from evis.dataset.draws import key_of, poisson
from evis.dataset.layouts.sample import EVENTS

Columns = dict[str, Any]
"""t, x, y, p, and event_instance, event_flow, event_signal where events have labels; numpy's or PyTorch's."""
_NOISE = {"event_instance": 0, "event_flow": float("nan"), "event_signal": 0}
"""Labels of an event that no light has made."""


def changed_events(
    events: Columns, augment: Augment, drawn: Drawn, t0: int, t1: int, height: int, width: int
) -> Columns:
    """Returns the events of [t0, t1) ns of a camera of height x width, changed as drawn, in order of time."""
    types = {name: events[name].dtype for name in ("x", "y", "p")}
    found = {name: cast(events[name], "int32") if name in types else events[name] for name in events}
    if augment.drop:
        found = _rows(found, uniforms(drawn.key, 0, len(found["t"]), found["t"]) >= augment.drop)
    if augment.noise:
        found = _with_noise(found, augment.noise, drawn, t0, t1, height, width)
    if drawn.reverse:
        found = {name: module_of(column).flip(column, (0,)) for name, column in found.items()}
        found["t"] = (t0 + t1 - 1) - found["t"]
        found["p"] = 1 - found["p"]
        if "event_flow" in found:
            found["event_flow"] = -found["event_flow"]
    for axis, name, size, flip in ((0, "x", width, drawn.flip_x), (1, "y", height, drawn.flip_y)):
        if flip:
            found[name] = (size - 1) - found[name]
            if "event_flow" in found:
                found["event_flow"] = mirrored(found["event_flow"], axis)
    if (drawn.height, drawn.width) != (height, width):
        x, y = found["x"] - drawn.left, found["y"] - drawn.top
        found |= {"x": x, "y": y}
        found = _rows(found, (x >= 0) & (x < drawn.width) & (y >= 0) & (y < drawn.height))
    return found | {name: cast(found[name], dtype) for name, dtype in types.items()}


def mirrored(vectors: Any, axis: int) -> Any:
    """Returns vectors [..., 2] (x, y) with one component turned round."""
    module = module_of(vectors)
    parts = [-vectors[..., i] if i == axis else vectors[..., i] for i in (0, 1)]
    return module.stack(parts, -1)


def _rows(columns: Columns, which: Any) -> Columns:
    return {name: column[which] for name, column in columns.items()}


def _with_noise(events: Columns, rate: float, drawn: Drawn, t0: int, t1: int, height: int, width: int) -> Columns:
    """Adds a Poisson process of `rate` events a second and pixel."""
    t, module = events["t"], module_of(events["t"])
    count = poisson(key_of(drawn.key, "count"), rate * height * width * (t1 - t0) * 1e-9)
    u = [uniforms(drawn.key, 1 + i, count, t) for i in range(4)]
    noise = {"t": t0 + cast(u[0] * (t1 - t0), "int64")}
    noise |= {n: cast(v * size, "int32") for n, v, size in (("x", u[1], width), ("y", u[2], height), ("p", u[3], 2))}
    for name in EVENTS:
        if name in events:
            shape = (count, *events[name].shape[1:])
            place = {} if module is np else {"device": t.device}
            noise[name] = module.full(shape, _NOISE[name], dtype=events[name].dtype, **place)
    joined = {name: module.concatenate([events[name], noise[name]]) for name in events}
    order = order_of(joined["t"])
    return {name: column[order] for name, column in joined.items()}
