"""Computes the labels of a window as they are after augmentation."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.dataset.augmenting.arrays import cast, module_of
from evis.dataset.augmenting.augmentation import Drawn
from evis.dataset.augmenting.changed_events import mirrored
from msgs.camera import FLOWS, Labels
from msgs.fields import array_specs

IMAGES = frozenset(name for name, spec in array_specs(Labels).items() if spec.dims[:3] == ("E", "H", "W")) | {
    "disparity",
    "image",
}
"""Labels with a value for each pixel, [H, W, ...]; disparity and images are no part of the message."""
VECTORS = frozenset(FLOWS)
RATES = frozenset(("flow", "velocity", "qvel"))
"""Labels that change their sign where time runs backwards."""
_HALF = 0.5
"""A flow is valid up to half a pixel beyond the outermost centres."""

LabelArrays = dict[str, Any]
"""Arrays by the names of msgs' Labels, without the axis of stamps; numpy's or PyTorch's."""


def reversed_labels(labels: LabelArrays, t0: int, t1: int) -> LabelArrays:
    """Returns labels of a window [t0, t1) ns whose time runs backwards, made of those at its start.

    Flow from the end of an interval to its start becomes flow from start to end, as it is.
    """
    found = {}
    for name, array in labels.items():
        way, _, what = name.partition("_")
        other = {"forward": "backward", "backward": "forward"}.get(way)
        if other is not None and what in ("flow", "valid"):
            found[f"{other}_{what}"] = array
        elif name == "flow_t":
            found[name] = (t0 + t1) - module_of(array).flip(array, (0,))
        else:
            found[name] = -array if name in RATES else array
    return found


def placed_labels(labels: LabelArrays, drawn: Drawn, height: int, width: int) -> LabelArrays:
    """Returns the labels of a window that is mirrored and cropped as drawn."""
    found = dict(labels)
    for axis, size, flip in ((0, width, drawn.flip_x), (1, height, drawn.flip_y)):
        if flip:
            found |= _flipped(found, axis, size)
    if (drawn.height, drawn.width) != (height, width):
        found |= _cropped(found, drawn)
    return found


def _flipped(labels: LabelArrays, axis: int, size: int) -> LabelArrays:
    """axis: 0 = x, 1 = y."""
    found = {}
    for name, array in labels.items():
        if name in IMAGES:
            array = module_of(array).flip(array, (1 - axis,))
            found[name] = mirrored(array, axis) if name in VECTORS else array
    if "box" in labels:
        box = labels["box"]
        sides = [box[:, i] for i in range(4)]
        sides[axis], sides[axis + 2] = (size - 1) - box[:, axis + 2], (size - 1) - box[:, axis]
        found["box"] = module_of(box).stack(sides, -1)
    return found


def _cropped(labels: LabelArrays, drawn: Drawn) -> LabelArrays:
    rows, columns = slice(drawn.top, drawn.top + drawn.height), slice(drawn.left, drawn.left + drawn.width)
    found = {name: array[rows, columns] for name, array in labels.items() if name in IMAGES}
    for way in ("forward", "backward"):
        if f"{way}_flow" in found and f"{way}_valid" in found:
            found[f"{way}_valid"] = _still_inside(found[f"{way}_flow"], found[f"{way}_valid"])
    if "box" in labels:
        found |= _cropped_boxes(labels, drawn)
    return found


def _still_inside(flow: Any, valid: Any) -> Any:
    """Valid where the point lies in the crop at the other end too."""
    module = module_of(flow)
    height, width = flow.shape[:2]
    place = {} if isinstance(flow, np.ndarray) else {"device": flow.device}
    x = module.arange(width, **place) + flow[..., 0]
    y = module.arange(height, **place)[:, None] + flow[..., 1]
    inside = (x >= -_HALF) & (x <= width - 1 + _HALF) & (y >= -_HALF) & (y <= height - 1 + _HALF)
    return valid * cast(inside, valid.dtype)


def _cropped_boxes(labels: LabelArrays, drawn: Drawn) -> LabelArrays:
    """Boxes x0, y0, x1, y1, both ends in them, cut at the borders; those of which nothing is left are not there."""
    box = labels["box"]
    module = module_of(box)
    x0, x1 = (module.clip(box[:, i] - drawn.left, 0, drawn.width - 1) for i in (0, 2))
    y0, y1 = (module.clip(box[:, i] - drawn.top, 0, drawn.height - 1) for i in (1, 3))
    seen = (box[:, 2] >= drawn.left) & (box[:, 0] <= drawn.left + drawn.width - 1)
    seen &= (box[:, 3] >= drawn.top) & (box[:, 1] <= drawn.top + drawn.height - 1)
    others: LabelArrays = {name: labels[name][seen] for name in ("box_id", "class_id") if name in labels}
    return {"box": module.stack((x0, y0, x1, y1), -1)[seen], **others}
