"""Finds by bisection where in a file a time is reached, for files whose times go up."""

from __future__ import annotations

from collections.abc import Callable


def place_before(low: int, high: int, resolution: int, is_earlier: Callable[[int], bool]) -> int:
    """Finds a place in low .. high before the first one that is not earlier, by at most `resolution`.

    Places count rows or bytes. is_earlier: tells whether what stands at a place is earlier than the wanted time; not
    asked for `low`, which is taken to be.
    """
    while high - low > resolution:
        middle = (low + high) // 2
        low, high = (middle, high) if is_earlier(middle) else (low, middle)
    return low
