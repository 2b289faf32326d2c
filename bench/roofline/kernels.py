"""Compares each kernel of a run with the peak rates of its device, by its bytes, its operations and its time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from bench.roofline.ceilings import Ceilings

HASH = re.compile(r"_[0-9a-f]{8}$")
"""What Warp puts after a kernel's name."""
LEAST_SHARE = 0.01
"""Of the time of all kernels: those that take less have no row."""
NEAR = 0.4
"""Share of the roof above which the roof is what limits a kernel."""
HIDDEN_SHARE = 0.01
"""Calls of code that cannot be counted, over the operations that are, above which the figures tell too little."""


@dataclass
class Kernel:
    """Adds up what the kernels of one name do in a gap: calls, seconds, bytes and operations.

    counted: whether the bytes and operations are known. native: calls of code that cannot be counted.
    """

    calls: float = 0.0
    seconds: float = 0.0
    bytes: float = 0.0
    operations: float = 0.0
    counted: bool = False
    native: float = 0.0


def kernels_of(timed: Mapping[str, tuple[float, float]], counted: Mapping[str, Mapping[str, Any]]) -> dict[str, Kernel]:
    """Joins the times and the counts of a run's kernels by their names, the longest first.

    Args:
        timed: symbol -> calls and milliseconds of a gap.
        counted: symbol -> name, calls, and bytes, operations and native calls of all of these calls.
    """
    found: dict[str, Kernel] = {}
    for symbol, (calls, ms) in timed.items():
        count = counted.get(symbol)
        kernel = found.setdefault(short(count["name"] if count else symbol), Kernel())
        kernel.calls += calls
        kernel.seconds += ms / 1e3
        if count and count["calls"]:
            kernel.counted = True
            kernel.native += calls * count["native"] / count["calls"]
            kernel.bytes += calls * count["bytes"] / count["calls"]
            kernel.operations += calls * count["operations"] / count["calls"]
    return dict(sorted(found.items(), key=lambda item: -item[1].seconds))


def short(name: str) -> str:
    """Shortens a kernel's name to its last part, and that of a kernel of another library to a few words."""
    last = name.split("::")[-1].replace("__locals__", ".").split(".")[-1].strip("_")
    return HASH.sub("", last)[:44]


def roof_s(kernel: Kernel, ceilings: Ceilings) -> tuple[float, float]:
    """Gives the least times [s] that the kernel's bytes, from caches, and its operations take."""
    return kernel.bytes / ceilings.cache, kernel.operations / ceilings.operations


def rows(run: str, kernels: Mapping[str, Kernel], ceilings: Ceilings) -> list[dict[str, Any]]:
    """Makes a row for each kernel that takes a hundredth of the time or more."""
    whole = sum(kernel.seconds for kernel in kernels.values())
    return [
        {"run": run, "kernel": name, "calls a gap": round(kernel.calls, 2), "us a gap": round(1e6 * kernel.seconds, 1),
         "share": f"{100 * kernel.seconds / whole:.0f} %"} | (_against(kernel, ceilings) if kernel.counted else {})
        for name, kernel in kernels.items() if kernel.seconds >= LEAST_SHARE * whole
    ]  # fmt: skip


def _against(kernel: Kernel, ceilings: Ceilings) -> dict[str, Any]:
    """Rates, and shares of the ceilings."""
    by_bytes, by_operations = roof_s(kernel, ceilings)
    reached = max(by_bytes, by_operations) / kernel.seconds
    nearest = "bytes" if by_bytes > by_operations else "operations"
    hidden = kernel.native > HIDDEN_SHARE * kernel.operations
    limit = "native code, not counted" if hidden else nearest if reached >= NEAR else "neither"
    return {
        "MB": round(kernel.bytes / 1e6, 2),
        "Mop": round(kernel.operations / 1e6, 2),
        "op/byte": round(kernel.operations / kernel.bytes, 2) if kernel.bytes else None,
        "GB/s": round(kernel.bytes / kernel.seconds / 1e9, 1),
        "of the memory's": f"{100 * kernel.bytes / kernel.seconds / ceilings.memory:.0f} %",
        "Gop/s": round(kernel.operations / kernel.seconds / 1e9, 1),
        "of the roof": f"{100 * reached:.0f} %",
        "limit": limit,
    }
