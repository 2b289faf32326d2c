"""Finds devices by name."""

from __future__ import annotations

from typing import Any

import warp as wp

from evis.warp_start import start_warp

KEPT = 0.25
"""Part of a GPU's memory up to which what arrays had is kept for the next ones. By CUDA's own setting, none, the driver
takes it back whenever the host waits for the GPU, and maps as much again for the next gap."""


def device_named(name: str) -> Any:
    """Gives the Warp device of a name (`cpu`, `cuda`, `cuda:1`). Raises ValueError naming those there are."""
    start_warp()
    try:
        if name.startswith("cuda") and not wp.is_cuda_available():
            raise ValueError(name)
        device = wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ", ".join(str(d) for d in wp.get_devices())
        raise ValueError(f"there is no device '{name}' here; there is {known}") from None
    # Who has set it to something else in this process has reasons.
    if device.is_cuda and device.is_mempool_supported and not wp.get_mempool_release_threshold(device):
        wp.set_mempool_release_threshold(device, KEPT)
    return device
