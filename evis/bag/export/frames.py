"""Writes frames of a bag as one archive, frame after frame, in the form that `evis events simulate` takes."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError
from evis.bag.environments import check_one
from evis.bag.export.source import Messages
from msgs.camera import Frames


def write(messages: Messages, topic: str, out: BinaryIO) -> dict[str, Any]:
    """Writes an .npz of t (int64 [T] ns) and luminance (float32 [T, H, W]) or rgb ([T, H, W, 3]). One message is in
    memory at a time. Raises BagError.
    """
    shapes: dict[str, list[tuple[int, ...]]] = {}
    times: list[np.ndarray] = []
    for frames in _each(messages, topic):
        times.append(np.array(frames.t, np.int64))
        for name in ("luminance", "rgb"):
            image = getattr(frames, name)
            if image is not None:
                shapes.setdefault(name, []).append(image.shape[2:])
    names = [name for name, found in shapes.items() if len(found) == len(times)]
    if any(len(set(shapes[name])) > 1 for name in names):
        raise BagError(f"{topic}: the size of the frames changes; export to .jsonl")
    t = np.concatenate(times) if times else np.empty(0, np.int64)
    with zipfile.ZipFile(out, "w") as archive:
        with archive.open("t.npy", "w") as entry:
            np.lib.format.write_array(entry, t)
        for name in names:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                about = {"descr": "<f4", "fortran_order": False, "shape": (len(t), *shapes[name][0])}
                np.lib.format.write_array_header_1_0(entry, about)
                for frames in _each(messages, topic):
                    entry.write(np.ascontiguousarray(getattr(frames, name)[0], np.float32).tobytes())
    return {"frames": len(t), "arrays": {"t": [len(t)], **{n: [len(t), *shapes[n][0]] for n in names}}}


def _each(messages: Messages, topic: str) -> Iterator[Frames]:
    for message in messages():
        if not isinstance(message, Frames):
            raise BagError(f"{topic} holds {type(message).__name__} messages, no frames")
        check_one(topic, len(message.episodes))
        yield message
