"""Writes DSEC-Det's object detections, rows of tracks.npy (uzh-rpg/dsec-det, src/dsec_det/label.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.dataset.layouts.npz.growing_npy import GrowingNpy

_BLOCK = 1 << 16
"""Rows that are gone over at once."""
TRACK = np.dtype(
    [
        ("t", "<u8"), ("x", "<f8"), ("y", "<f8"), ("h", "<f8"), ("w", "<f8"), ("class_id", "u1"),
        ("class_confidence", "<f8"), ("track_id", "<u8"),
    ]
)  # fmt: skip
"""A row of tracks.npy: t us, in the clock of the images; x, y the upper left corner, h, w px, not rectified."""


def tracks(stamp_us: int, boxes: np.ndarray, ids: np.ndarray, semantic: np.ndarray | None) -> np.ndarray:
    """Returns rows of tracks.npy for boxes [B, 4] x0 y0 x1 y1 px, inclusive, of instances [B].

    class_id counts the classes of CameraInfo from 0, without the background; it is 0 where there are none.
    """
    rows = np.zeros(len(boxes), TRACK)
    rows["t"], rows["track_id"], rows["class_confidence"] = stamp_us, ids, 1.0
    rows["x"], rows["y"] = boxes[:, 0], boxes[:, 1]
    rows["w"], rows["h"] = boxes[:, 2] - boxes[:, 0] + 1, boxes[:, 3] - boxes[:, 1] + 1
    if semantic is not None:
        rows["class_id"] = np.asarray(semantic)[ids] - 1
    return rows


def boxes_of(rows: np.ndarray) -> dict[str, np.ndarray]:
    """Reads the boxes of `tracks` back: stamps `t` ns, `offsets`, `box`, `box_id`, and `class_id`."""
    t, first = np.unique(rows["t"], return_index=True)
    box = np.stack((rows["x"], rows["y"], rows["x"] + rows["w"] - 1, rows["y"] + rows["h"] - 1), -1)
    return {
        "t": t.astype(np.int64) * 1000,
        "offsets": np.append(first, len(rows)).astype(np.int64),
        "box": box.astype(np.float32),
        "box_id": rows["track_id"].astype(np.int32),
        "class_id": rows["class_id"],
    }


def keep_stamps(path: Path, stamps_us: np.ndarray) -> tuple[int, int]:
    """Leaves in a tracks.npy the rows of some stamps; of none of them, it stays as it is.

    stamps_us: int64 [T] ascending. Returns how many stamps the file had, and how many of them are among these.
    """
    rows = np.load(path, mmap_mode="r")
    there = np.unique(rows["t"]).astype(np.int64)
    kept = np.intersect1d(there, stamps_us)
    if 0 < len(kept) < len(there):
        part = path.with_name(f".{path.name}.part")
        fewer = GrowingNpy(part, (), TRACK)
        for first in range(0, len(rows), _BLOCK):
            block = rows[first : first + _BLOCK]
            fewer.append(block[np.isin(block["t"].astype(np.int64), kept)])
        fewer.close()
        part.replace(path)
    return len(there), len(kept)
