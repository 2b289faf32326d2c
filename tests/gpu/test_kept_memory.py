"""Memory of a GPU that freed arrays had: kept for the next ones, and counted as free."""

from __future__ import annotations

import pytest
import warp as wp

from evis.gpu.devices import KEPT, device_named
from evis.gpu.room import free_memory

pytestmark = pytest.mark.gpu
BYTES = 1 << 30


def test_what_an_array_had_is_kept_and_free() -> None:
    device = device_named("cuda")
    assert wp.get_mempool_release_threshold(device) == int(KEPT * device.total_memory)
    wp.synchronize_device(device)
    before = free_memory(device)
    assert before is not None
    array = wp.zeros(BYTES, dtype=wp.uint8, device=device)
    wp.synchronize_device(device)
    during = free_memory(device)
    assert during is not None
    assert before - during == pytest.approx(BYTES, rel=0.1)
    del array
    wp.synchronize_device(device)
    after = free_memory(device)
    assert after is not None
    # The driver has not taken it back, and yet it may be had.
    assert after - device.free_memory >= BYTES
    assert after == pytest.approx(before, abs=0.1 * BYTES)


def test_another_setting_of_the_process_stays() -> None:
    device = device_named("cuda")
    kept = wp.get_mempool_release_threshold(device)
    try:
        wp.set_mempool_release_threshold(device, BYTES)
        assert device_named("cuda") is device
        assert wp.get_mempool_release_threshold(device) == BYTES
    finally:
        wp.set_mempool_release_threshold(device, kept)
