"""Writes keyframes of a bag, with the depth, motion and ids of their stamps, as a folder of OpenEXR files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.bag.export import exr
from evis.bag.export.source import Source, by_stamp
from msgs.camera import Depth, Ids, Keyframe, Motion
from msgs.header import Message

BESIDE_KEYFRAME = ("depth", "motion", "ids")
HALF_MAX = 65504.0
"""Largest finite half; OpenEXR makes infinity of what is larger, without a word."""


def write_folder(source: Source, out: Path, half: bool) -> dict[str, Any]:
    """Writes one file per keyframe, 000000.exr and so on, of several environments in folders env0, env1, ...

    half: R, G, B as 16-bit floats, clamped and counted. `other_files` counts EXR files of another export. Raises
    BagError.
    """
    camera = source.name.rsplit("/", 1)[0]
    topics = [source.name, *(t for n in BESIDE_KEYFRAME if (t := f"{camera}/{n}") in source.reader.topics)]
    out.mkdir(parents=True, exist_ok=True)
    count = clamped = written = 0
    names: set[str] = set()
    for group in by_stamp(source.reader, topics):
        keyframe = group.get(Keyframe)
        if not isinstance(keyframe, Keyframe):
            continue
        envs = range(len(keyframe.image)) if source.env is None else [source.env]
        for e in envs:
            arrays, high = channels(group, e, half)
            folder = out / f"env{e}" if len(envs) > 1 else out
            folder.mkdir(exist_ok=True)
            try:
                exr.write(folder / f"{count:06d}.exr", arrays, keyframe.header.stamp_ns)
            except OSError as error:
                done = f"the {count} keyframes before it are whole" if count else "it is the first"
                raise BagError(f"{error}; {done}") from None
            clamped += high
            written += 1
            names |= {n for c in arrays for n in (("R", "G", "B") if c == "RGB" else (c,))}
        count += 1
    result = {"keyframes": count, "channels": sorted(names), **({"clamped": clamped} if half else {})}
    if others := len(list(out.rglob("*.exr"))) - written:
        result["other_files"] = others
    return result


def channels(group: dict[type[Message], Message], env: int, half: bool) -> tuple[dict[str, np.ndarray], int]:
    """Returns (channel -> array [H,W(,3)] without margin, radiance values clamped to the range of half).

    R, G, B (as `RGB`), or Y of a keyframe without colour, in the recorded precision or half; Z and motion.x, motion.y
    float32; id uint32.
    """
    keyframe = group[Keyframe]
    assert isinstance(keyframe, Keyframe)
    light = exr.cropped(keyframe.image, keyframe.margin, env)
    clamped = 0
    if half and light.dtype != np.float16:
        clamped = int((np.abs(light) > HALF_MAX).sum())
        light = np.clip(light, -HALF_MAX, HALF_MAX).astype(np.float16)
    result = {"Y" if keyframe.radiance is None else "RGB": light}
    depth, motion, ids = group.get(Depth), group.get(Motion), group.get(Ids)
    if isinstance(depth, Depth):
        result["Z"] = exr.cropped(depth.depth, depth.margin, env)
    if isinstance(motion, Motion):
        result |= exr.vectors("motion", exr.cropped(motion.motion, motion.margin, env))
    if isinstance(ids, Ids):
        result["id"] = exr.cropped(ids.ids, ids.margin, env).astype(np.uint32)
    return result, clamped
