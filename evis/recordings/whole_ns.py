"""Checks limits of an interval as a caller gives them."""

from __future__ import annotations

from typing import Any

import numpy as np


def whole_ns(limit: Any) -> int | None:
    """Returns a limit [ns], None where there is none. Raises TypeError for what is no whole number."""
    if limit is None:
        return None
    if isinstance(limit, bool) or not isinstance(limit, int | np.integer):
        raise TypeError(f"times are whole ns, not {limit!r}: from 100_000_000 to 200_000_000 is from 0.1 s to 0.2 s")
    return int(limit)
