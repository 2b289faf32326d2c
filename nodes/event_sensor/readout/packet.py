"""The order of events: 63-bit keys that sort to environment, time, row, column, and their way back to columns.

A key holds, from the top: environment, t - t_base [ns], y, x, colour channel (2 bits), polarity (1 bit). Columns take
bits(W - 1), rows bits(H - 1), environments bits(E - 1); the rest is for time: 42 bits (73 minutes) for one environment
of 346x260, at least 28 bits (268 ms) ever. A message that is longer is refused, nothing wraps.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import warp as wp

from nodes.event_sensor.cpu import order_kernels
from nodes.event_sensor.message_limit import REMEDY, longest_step
from nodes.event_sensor.model import pixel_kernels

KEY_BITS = 63
COUNTING_SORT_FROM = 8192
"""Events from which the counting sort beats numpy's sort."""
DIGIT_BITS = 8
"""Of a digit: as many places as the nearest cache can follow."""


@dataclass(frozen=True)
class KeyLayout:
    """Where each field of a key starts."""

    x: int
    y: int
    t: int
    env: int

    @staticmethod
    def of(height: int, width: int, envs: int) -> KeyLayout:
        """Layout for images of this size. Raises ValueError when no useful room for time is left."""
        x = 3
        y = x + (width - 1).bit_length()
        t = y + (height - 1).bit_length()
        env = KEY_BITS - (envs - 1).bit_length()
        if env - t < 28:
            raise ValueError(f"{envs} environments of {width}x{height} pixels are too many for one event sensor")
        return KeyLayout(x, y, t, env)

    def check_span(self, t_base: int, t: np.ndarray) -> None:
        """Raise ValueError when a message from t_base [ns] with frames at t [ns] is too long for the key."""
        bits = self.env - self.t
        span_ns = int(t[-1]) - t_base
        if span_ns >> bits:
            raise ValueError(
                f"a message of {span_ns} ns is too long for the event sensor: at this image size and number of "
                f"environments it takes up to {(1 << bits) - 1} ns; its longest step is {longest_step(t_base, t)}: "
                f"{REMEDY}"
            )


@dataclass
class Events:
    """Events sorted by environment, t, y, x. t int64 [n] ns; x, y uint16 [n]; p uint8 [n], 1 = ON; c uint8 [n] or None.

    env_offsets int64 [E + 1]: events of environment e are [offsets[e], offsets[e + 1]).
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    c: np.ndarray | None
    env_offsets: np.ndarray


def sort_keys(keys: wp.array, spare: wp.array, count: int, layout: KeyLayout, span_ns: int) -> np.ndarray:
    """The first `count` keys in ascending order, on the host. `keys` and `spare` are overwritten.

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
    """int64 [E + 1] where each environment's events start in the sorted keys."""
    firsts = np.arange(envs, dtype=np.int64) << layout.env if envs > 1 else np.zeros(1, np.int64)
    return np.append(np.searchsorted(keys, firsts), len(keys)).astype(np.int64)


def unpack(keys: np.ndarray, sensor: pixel_kernels.Sensor, t_base: int, out: dict[str, np.ndarray]) -> None:
    """Write sorted keys to the columns t, x, y, p and, where `out` has it, c."""
    if len(keys):
        columns: list[wp.array] = [wp.array(out[name], copy=False, device="cpu") for name in ("t", "x", "y", "p")]
        source: wp.array = wp.array(keys, copy=False, device="cpu")
        wp.launch(order_kernels.unpack, 1, [sensor, t_base, source], columns, device="cpu")
        if "c" in out:
            out["c"][:] = (keys >> 1) & 3


def merged(
    a: tuple[dict[str, np.ndarray], np.ndarray], b: tuple[dict[str, np.ndarray], np.ndarray], envs: int
) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns and offsets of two packets, the second being later in every environment."""
    parts = [(columns, slice(offsets[e], offsets[e + 1])) for e in range(envs) for columns, offsets in (a, b)]
    columns = {name: np.concatenate([c[name][s] for c, s in parts]) for name in a[0]}
    return columns, a[1] + b[1]


def parted(
    columns: dict[str, np.ndarray], offsets: np.ndarray, end: int
) -> tuple[tuple[dict[str, np.ndarray], np.ndarray], tuple[dict[str, np.ndarray], np.ndarray]]:
    """Columns and offsets of the events up to `end` [ns] and of the later ones."""
    early = columns["t"] <= end
    counts = [np.count_nonzero(early[a:b]) for a, b in itertools.pairwise(offsets)]
    before = np.append(0, np.cumsum(counts)).astype(np.int64)
    return (
        ({name: c[early] for name, c in columns.items()}, before),
        ({name: c[~early] for name, c in columns.items()}, offsets - before),
    )
