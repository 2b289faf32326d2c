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


def mask_of(coded: dict[str, Any]) -> np.ndarray:
    """Returns the mask [H, W] of run lengths."""
    counts = np.array(coded["counts"], np.int64)
    flat = np.repeat(np.arange(len(counts)) % 2 == 1, counts)
    height, width = coded["size"]
    return flat.reshape(width, height).T
