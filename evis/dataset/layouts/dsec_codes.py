"""DSEC's numbers in PNG files, and its object detections: https://dsec.ifi.uzh.ch/data-format."""

from __future__ import annotations

import numpy as np

FLOW_SCALE, FLOW_ZERO = 128.0, 1 << 15
DISPARITY_SCALE = 256.0
TRACK = np.dtype(
    [
        ("t", "<u8"), ("x", "<f8"), ("y", "<f8"), ("h", "<f8"), ("w", "<f8"), ("class_id", "u1"),
        ("class_confidence", "<f8"), ("track_id", "<u4"),
    ]
)  # fmt: skip
"""A row of tracks.npy: t us; x, y the upper left corner, h, w px."""


def flow_to_codes(flow: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Returns uint16 [H, W, 3] of displacements [H, W, 2] px: 128 x + 2^15, 128 y + 2^15, and 1 where it is valid.

    What is not finite or does not fit, below -256 px or from 256 px on, is not valid.
    """
    with np.errstate(invalid="ignore"):
        codes = np.rint(flow * np.float32(FLOW_SCALE)) + np.float32(FLOW_ZERO)  # a power of two: exact in float32 too
        inside = (codes >= 0) & (codes < 1 << 16)
    known = (valid > 0) & inside[..., 0] & inside[..., 1]
    codes[~known] = FLOW_ZERO
    out = np.empty((*known.shape, 3), np.uint16)
    out[..., :2], out[..., 2] = codes, known
    return out


def codes_to_flow(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns displacements float32 [H, W, 2] px, NaN where not valid, and uint8 [H, W], 1 where valid."""
    valid = codes[..., 2] == 1
    flow = (codes[..., :2].astype(np.float64) - FLOW_ZERO) / FLOW_SCALE
    return np.where(valid[..., None], flow, np.nan).astype(np.float32), valid.astype(np.uint8)


def disparity_to_codes(depth: np.ndarray, focal_baseline: float) -> np.ndarray:
    """Returns uint16 [H, W], disparity times 256, 0 = unknown, of depths [H, W] m.

    focal_baseline: product of focal length and baseline [px m].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        codes = np.rint(focal_baseline / depth.astype(np.float64) * DISPARITY_SCALE)
    return np.where((codes > 0) & (codes < 1 << 16), codes, 0).astype(np.uint16)


def codes_to_disparity(codes: np.ndarray) -> np.ndarray:
    """Returns disparities float32 [H, W] px, NaN where unknown."""
    return np.where(codes > 0, codes / DISPARITY_SCALE, np.nan).astype(np.float32)


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
    """Returns what `tracks` was made of: stamps `t` ns, `offsets`, `box`, `box_id`, and `class_id`."""
    t, first = np.unique(rows["t"], return_index=True)
    box = np.stack((rows["x"], rows["y"], rows["x"] + rows["w"] - 1, rows["y"] + rows["h"] - 1), -1)
    return {
        "t": t.astype(np.int64) * 1000,
        "offsets": np.append(first, len(rows)).astype(np.int64),
        "box": box.astype(np.float32),
        "box_id": rows["track_id"].astype(np.int32),
        "class_id": rows["class_id"],
    }
