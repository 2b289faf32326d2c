"""Texels around a map of the sky, against those that angles lead to."""

import numpy as np
import pytest

from nodes.renderer.lights.sky import surrounded


@pytest.mark.parametrize(("h", "w"), [(2, 2), (3, 5), (4, 8), (5, 7)])
def test_beyond_each_side_lies_what_is_seen_there(h, w):
    """A texel over a pole is the one of the same row half way around, and columns go on where they began."""
    level = np.arange(h * w * 3, dtype=np.float64).reshape(h, w, 3)
    found = surrounded(level)
    assert found.shape == (h + 2, w + 2, 3)
    for j in range(-1, h + 1):
        for k in range(w + 2):
            i = k - w // 2 - 1
            over = j < 0 or j >= h
            row = -1 - j if j < 0 else 2 * h - 1 - j if j >= h else j
            assert (found[j + 1, k] == level[row, (i + over * (w // 2)) % w]).all()
