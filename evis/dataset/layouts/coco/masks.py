"""Encodes COCO's run lengths of masks, not compressed."""

from __future__ import annotations

from typing import Any

import numpy as np


def run_lengths(mask: np.ndarray) -> dict[str, Any]:
    """Returns COCO's uncompressed run lengths of a mask [H, W]: by columns, the first run is of 0."""
    flat = np.concatenate([[0], mask.T.reshape(-1).astype(np.int8), [0]])
    edges = np.flatnonzero(np.diff(flat))
    bounds = np.concatenate([[0], edges, [] if len(edges) and edges[-1] == mask.size else [mask.size]]).astype(np.int64)
    return {"size": list(mask.shape), "counts": np.diff(bounds).tolist()}


def mask_of(coded: dict[str, Any], shape: tuple[int, int]) -> np.ndarray:
    """Returns the mask of run lengths, which must be of this shape [H, W]. Raises ValueError."""
    counts = np.array(coded["counts"], np.int64)
    height, width = shape
    if tuple(coded["size"]) != shape or (counts < 0).any() or sum(counts.tolist()) != height * width:
        raise ValueError(f"a mask is not of {width} x {height} pixels")
    return np.repeat(np.arange(len(counts)) % 2 == 1, counts).reshape(width, height).T
