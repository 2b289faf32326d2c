"""Sorts keys by time, and unpacks them into columns, on a CPU or by Warp's radix sort."""

from __future__ import annotations

import numpy as np
import warp as wp

from nodes.event_sensor.cpu import order_kernels
from nodes.event_sensor.model.keys import KEY_BITS, KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor

COUNTING_SORT_FROM = 8192
"""Events from which the counting sort beats numpy's sort."""
DIGIT_BITS = 8
"""Of a digit: as many places as the nearest cache can follow."""


def sort_keys(keys: wp.array, spare: wp.array, count: int, layout: KeyLayout, span_ns: int) -> np.ndarray:
    """Returns the first `count` keys in ascending order, on the host. `keys` and `spare` are overwritten.

    On a CPU the kernel emits each environment's events in the order of y, x, channel and time, so that a stable sort by
    time and environment alone is the whole order; on a GPU the order of emission is arbitrary and all bits are sorted.
    """
    if wp.get_device(keys.device).is_cuda:
        values = wp.empty(2 * count, dtype=wp.int32, device=keys.device)
        wp.utils.radix_sort_pairs(keys, values, count)
        return keys[:count].numpy() if count else np.zeros(0, np.int64)
    if count < COUNTING_SORT_FROM:
        return np.sort(keys.numpy()[:count])
    environments = KEY_BITS - layout.env
    for start, bits in ((layout.t, span_ns.bit_length()), (layout.env, environments)):
        passes = -(-bits // DIGIT_BITS)
        for shift in range(start, start + bits, -(-bits // max(passes, 1)) or 1):
            digit = min(-(-bits // passes), start + bits - shift)
            wp.launch(order_kernels.radix_pass, 1, [count, shift, digit, keys], [spare], device="cpu")
            keys, spare = spare, keys
    return keys.numpy()[:count]


def env_offsets(keys: np.ndarray, layout: KeyLayout, envs: int) -> np.ndarray:
    """Returns int64 [E + 1] where each environment's events start in the sorted keys."""
    firsts = np.arange(envs, dtype=np.int64) << layout.env if envs > 1 else np.zeros(1, np.int64)
    return np.append(np.searchsorted(keys, firsts), len(keys)).astype(np.int64)


def unpack(keys: np.ndarray, sensor: Sensor, t_base: int, out: dict[str, np.ndarray]) -> None:
    """Writes sorted keys to the columns t, x, y, p and, where `out` has it, c."""
    if len(keys):
        columns: list[wp.array] = [wp.array(out[name], copy=False, device="cpu") for name in ("t", "x", "y", "p")]
        source: wp.array = wp.array(keys, copy=False, device="cpu")
        wp.launch(order_kernels.unpack, 1, [sensor, t_base, source], columns, device="cpu")
        if "c" in out:
            out["c"][:] = (keys >> 1) & 3
