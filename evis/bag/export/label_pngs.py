"""Writes depth, ids and flow of a bag as 16 bit PNG, with their stamps in times.txt."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.bag.export.flow_codes import flow_to_codes
from evis.bag.export.label_images import images
from evis.bag.export.png import encoded
from evis.files.whole_file import whole_file
from evis.media.frames.folder import TIMES
from msgs.camera import FLOWS, Labels
from msgs.header import Message

MILLIMETRES = 1000.0
_KINDS = {"Z": "depth", "id": "segmentation", "class": "semantic"}
"""Channels that are an image of their own, and what they are called in labels."""


def write_folders(messages: Iterable[Message], topic: str, out: Path) -> dict[str, Any]:
    """Writes 000000.png and so on, and times.txt with `name t_ns` lines; of labels a folder for each kind.

    depth: whole millimetres, 0 = sky or from 65.536 m on (the latter counted as `too_far`). segmentation, semantic:
    the ids. flow, forward_flow, backward_flow, motion: see `flow_to_codes`, in the units of the label; what is valid
    but does not fit is counted as `too_fast`. Raises BagError.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines: dict[Path, list[str]] = {}
    counts = {"too_far": 0, "too_fast": 0}
    done = 0
    for message in messages:
        for kind, (codes, reason, unfit) in _encode_channels(images(message, topic)).items():
            folder = out / kind if isinstance(message, Labels) else out
            name = f"{len(lines.setdefault(folder, [])):06d}.png"
            try:
                folder.mkdir(exist_ok=True)
                with whole_file(folder / name) as partial:
                    partial.write_bytes(encoded(codes, ""))
            except OSError as error:
                raise BagError(f"{error}; the {done} images before it are whole") from None
            lines[folder].append(f"{name} {message.header.stamp_ns}\n")
            done += 1
            counts[reason] += unfit
    for folder, told in lines.items():
        with whole_file(folder / TIMES) as partial:
            partial.write_text("".join(told))
    others = sum(len(list(folder.glob("*.png"))) - len(told) for folder, told in lines.items())
    found = {"images": done, "folders": sorted(folder.name for folder in lines if folder != out)}
    return {**found, **{name: n for name, n in counts.items() if n}, **({"other_files": others} if others else {})}


def _encode_channels(channels: dict[str, np.ndarray]) -> dict[str, tuple[np.ndarray, str, int]]:
    """Encodes channels: kind -> (codes uint16 [H, W, C], why some did not fit, number of those pixels)."""
    found: dict[str, tuple[np.ndarray, str, int]] = {}
    for channel, kind in _KINDS.items():
        if channel in channels:
            codes, unfit = (_in_millimetres if kind == "depth" else _as_ids)(channels[channel])
            found[kind] = codes[..., None], "too_far", unfit
    for kind in (*FLOWS, "motion"):
        if f"{kind}.x" in channels:
            flow = np.stack([channels[f"{kind}.{axis}"] for axis in "xy"], -1)
            known = channels.get(f"{kind.removesuffix('_flow')}_valid", np.ones(flow.shape[:2]))
            codes = flow_to_codes(flow, known)
            lost = (known > 0) & np.isfinite(flow).all(-1) & (codes[..., 2] == 0)
            found[kind] = codes, "too_fast", int(lost.sum())
    return found


def _in_millimetres(depth: np.ndarray) -> tuple[np.ndarray, int]:
    whole = np.rint(depth.astype(np.float64) * MILLIMETRES)
    fits = whole < 1 << 16
    return np.where(fits, whole, 0).astype(np.uint16), int((~fits & np.isfinite(whole)).sum())


def _as_ids(ids: np.ndarray) -> tuple[np.ndarray, int]:
    if ids.size and int(ids.max()) >= 1 << 16:
        raise BagError(f"id {int(ids.max())} does not fit 16 bit; leave --png out for EXR")
    return ids.astype(np.uint16), 0
