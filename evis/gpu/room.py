"""Measures how much memory is left on a device, before it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from evis.gpu.driver import kept_memory

MEMINFO = Path("/proc/meminfo")
CGROUP = Path("/sys/fs/cgroup")
_LIMITS = (("memory.max", "memory.current"), ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"))
"""Of a container, what it may have and what it has, in both versions of control groups."""


def free_memory(device: Any) -> int | None:
    """Gives the bytes that may still be had on a Warp device; None where nothing tells."""
    return int(device.free_memory) + kept_memory(device) if device.is_cuda else free_host_memory()


def free_host_memory() -> int | None:
    """Gives the bytes that the system can give without swapping, and no more than the limit of a container leaves; None
    where nothing tells.
    """
    return min((*_available(), *_left_in_container()), default=None)


def _available() -> Iterator[int]:
    try:
        known = dict(line.split(":", 1) for line in MEMINFO.read_text().splitlines() if ":" in line)
        yield int(known["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        return


def _left_in_container() -> Iterator[int]:
    for limit, used in _LIMITS:
        try:
            # "max" is no number: there is none.
            most, now = (int((CGROUP / name).read_text()) for name in (limit, used))
            # What the system may drop counts as used, too.
            cached = _inactive((CGROUP / limit).parent / "memory.stat")
        except (OSError, ValueError):
            continue
        yield max(most - now + cached, 0)


def _inactive(stat: Path) -> int:
    """Counts the bytes of files that the system keeps in memory until it is needed."""
    rows = (line.split() for line in stat.read_text().splitlines())
    return next((int(value) for name, value in rows if name in ("inactive_file", "total_inactive_file")), 0)
