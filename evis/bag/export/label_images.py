"""Writes depth, ids, motion and labels of a bag as images: an OpenEXR file per stamp."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError, environments
from evis.bag.export import exr
from msgs.camera import FLOWS, Depth, Ids, Labels, Motion
from msgs.header import Message

KINDS = ("Depth", "Ids", "Motion", "Labels")
_IDS = {"segmentation": "id", "semantic": "class", "forward_valid": "forward_valid", "backward_valid": "backward_valid"}


def write_folder(messages: Iterable[Message], topic: str, out: Path) -> dict[str, Any]:
    """Writes one file per message that has images, 000000.exr and so on.

    Z float32 m, +inf = sky; id, class uint32; motion.x, flow.x, forward_flow.x, ... float32, NaN = unknown;
    forward_valid, backward_valid uint32. Raises BagError.
    """
    out.mkdir(parents=True, exist_ok=True)
    count = 0
    names: dict[str, None] = {}
    for message in messages:
        channels = images(message, topic)
        if not channels:
            continue
        try:
            exr.write(out / f"{count:06d}.exr", channels, message.header.stamp_ns)
        except OSError as error:
            raise BagError(f"{error}; the {count} images before it are whole") from None
        names |= dict.fromkeys(channels)
        count += 1
    others = len(list(out.glob("*.exr"))) - count
    result: dict[str, Any] = {"images": count, "channels": sorted(names)}
    return result | ({"other_files": others} if others else {})


def images(message: Message, topic: str) -> dict[str, np.ndarray]:
    """Returns the images of a message by the channel's name, without margin. Raises BagError for environments."""
    environments.check_one(topic, environments.count(message))
    found: dict[str, np.ndarray] = {}
    if isinstance(message, Depth):
        found["Z"] = exr.cropped(message.depth, message.margin)
    elif isinstance(message, Ids):
        found["id"] = exr.cropped(message.ids, message.margin).astype(np.uint32)
    elif isinstance(message, Motion):
        found |= exr.vectors("motion", exr.cropped(message.motion, message.margin))
    elif isinstance(message, Labels):
        if message.depth is not None:
            found["Z"] = exr.cropped(message.depth, 0)
        for name, channel in _IDS.items():
            if (array := getattr(message, name)) is not None:
                found[channel] = exr.cropped(array, 0).astype(np.uint32)
        for name in FLOWS:
            if (array := getattr(message, name)) is not None:
                found |= exr.vectors(name, exr.cropped(array, 0))
    return found
