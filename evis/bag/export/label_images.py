"""Depth, ids, motion and labels of a bag as images: an OpenEXR file per stamp, or 16 bit PNG of depth and ids."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError, environments
from evis.bag.export import exr
from evis.bag.export.png import encoded
from evis.files.whole_file import whole_file
from msgs.camera import Depth, Ids, Labels, Motion
from msgs.header import Message

MILLIMETRES = 1000.0
KINDS = ("Depth", "Ids", "Motion", "Labels")
_FLOWS = ("flow", "forward_flow", "backward_flow")
_IDS = {"segmentation": "id", "semantic": "class", "forward_valid": "forward_valid", "backward_valid": "backward_valid"}


def write_folder(messages: Iterable[Message], topic: str, out: Path, as_png: bool) -> dict[str, Any]:
    """Writes one file per message that has images, 000000.exr (or .png) and so on.

    EXR: Z float32 m, +inf = sky; id, class uint32; motion.x, flow.x, forward_flow.x, ... float32, NaN = unknown;
    forward_valid, backward_valid uint32. PNG, 16 bit: of depth whole millimetres, 0 = sky or from 65.536 m on (the
    latter counted as `too_far`); of ids the ids. Raises BagError.
    """
    out.mkdir(parents=True, exist_ok=True)
    ending, save = (".png", _save_png) if as_png else (".exr", _save_exr)
    count = too_far = 0
    names: dict[str, None] = {}
    for message in messages:
        channels = images(message, topic)
        if not channels:
            continue
        try:
            too_far += save(out / f"{count:06d}{ending}", channels, message.header.stamp_ns, topic)
        except OSError as error:
            raise BagError(f"{error}; the {count} images before it are whole") from None
        names |= dict.fromkeys(channels)
        count += 1
    others = len(list(out.glob(f"*{ending}"))) - count
    result: dict[str, Any] = {"images": count, "channels": sorted(names)}
    return result | ({"too_far": too_far} if too_far else {}) | ({"other_files": others} if others else {})


def images(message: Message, topic: str) -> dict[str, np.ndarray]:
    """Returns the images of a message by the channel's name, without margin. Raises BagError for environments."""
    if environments.count(message) > 1:
        raise BagError(f"{topic} has several environments; name one of them: /env0{topic}")
    found: dict[str, np.ndarray] = {}
    if isinstance(message, Depth):
        found["Z"] = _cropped(message.depth, message.margin)
    elif isinstance(message, Ids):
        found["id"] = _cropped(message.ids, message.margin).astype(np.uint32)
    elif isinstance(message, Motion):
        found |= _vectors("motion", _cropped(message.motion, message.margin))
    elif isinstance(message, Labels):
        if message.depth is not None:
            found["Z"] = _cropped(message.depth, 0)
        for name, channel in _IDS.items():
            if (array := getattr(message, name)) is not None:
                found[channel] = _cropped(array, 0).astype(np.uint32)
        for name in _FLOWS:
            if (array := getattr(message, name)) is not None:
                found |= _vectors(name, _cropped(array, 0))
    return found


def _cropped(array: Any, margin: int) -> np.ndarray:
    """The one environment's image; a copy, as the writer of EXR ignores strides."""
    image = np.asarray(array)[0]
    return np.ascontiguousarray(image[margin : image.shape[0] - margin, margin : image.shape[1] - margin])


def _vectors(name: str, array: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}.{axis}": np.ascontiguousarray(array[..., k]) for k, axis in enumerate("xy")}


def _save_exr(path: Path, channels: dict[str, np.ndarray], stamp_ns: int, topic: str) -> int:
    exr.write(path, channels, stamp_ns)
    return 0


def _save_png(path: Path, channels: dict[str, np.ndarray], stamp_ns: int, topic: str) -> int:
    """Returns how many pixels are too far away."""
    coders: dict[str, Callable[[np.ndarray], tuple[np.ndarray, int]]] = {"Z": _in_millimetres, "id": _as_ids}
    if len(channels) != 1 or next(iter(channels)) not in coders:
        there = ", ".join(channels)
        raise BagError(f"{topic} has {there}: PNG is for depth or ids alone; leave --png out for EXR")
    ((name, image),) = channels.items()
    codes, too_far = coders[name](image)
    with whole_file(path) as partial:
        partial.write_bytes(encoded(codes[..., None], "mono16"))
    return too_far


def _in_millimetres(depth: np.ndarray) -> tuple[np.ndarray, int]:
    whole = np.rint(depth.astype(np.float64) * MILLIMETRES)
    fits = whole < 1 << 16
    return np.where(fits, whole, 0).astype(np.uint16), int((~fits & np.isfinite(whole)).sum())


def _as_ids(ids: np.ndarray) -> tuple[np.ndarray, int]:
    if ids.size and int(ids.max()) >= 1 << 16:
        raise BagError(f"id {int(ids.max())} does not fit 16 bit; leave --png out for EXR")
    return ids.astype(np.uint16), 0
