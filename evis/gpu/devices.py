"""Finds devices by name."""

from __future__ import annotations

from typing import Any

import warp as wp

from evis.warp_start import start_warp


def device_named(name: str) -> Any:
    """Gives the Warp device of a name (`cpu`, `cuda`, `cuda:1`). Raises ValueError naming those there are."""
    start_warp()
    try:
        if name.startswith("cuda") and not wp.is_cuda_available():
            raise ValueError(name)
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ", ".join(str(d) for d in wp.get_devices())
        raise ValueError(f"there is no device '{name}' here; there is {known}") from None
