"""Divides environments or cameras among shares."""

from __future__ import annotations

MOST = 16
"""Shares that there may be."""


def bounds(count: int, shares: int) -> list[slice]:
    """Divides `count` items into neighbouring runs, whose lengths differ by one at most; the longer ones first.

    Raises ValueError unless each share gets one.
    """
    if not 1 <= shares <= count:
        raise ValueError(f"{count} cannot be dealt out in {shares} shares, each of one at least")
    each, longer = divmod(count, shares)
    ends = [each * (k + 1) + min(k + 1, longer) for k in range(shares)]
    return [slice(first, end) for first, end in zip([0, *ends], ends)]
