"""Holds further samples of single pixels between the frames of a message, which resolve time where the light changes.

ln I is taken to be a straight line between neighbouring samples of a pixel, whether of frames or further ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.input.arrays import on_device
from nodes.event_sensor.input.batch import SampleLists, Size
from nodes.event_sensor.input.limit import MOST_NUMBERED

LONGEST = (1 << 31) - 1
"""Longest time that a message with further samples may cover [ns]: their offsets are int32."""


@dataclass
class Further:
    """Holds further samples of E x H x W pixels: numpy, Warp, or what has __cuda_array_interface__ as `value`.

    Pixel (y, x) of environment e, q = (e H + y) W + x, has the entries first[q] to first[q + 1] - 1, ascending in time.

    first: int32 [E H W + 1]. offset: int32 [R] ns after the stamp before the message's first frame (after that frame
    itself where all episodes begin with it); none of a pixel's is at the stamp of a frame, none before the first frame
    of its episode. value: float32 [R], in colour [R, 3], linear as the frames.
    """

    first: Any
    offset: Any
    value: Any

    @classmethod
    def of_pixels(cls, shape: tuple[int, ...], y: Any, x: Any, offset: Any, value: Any, env: Any = 0) -> Further:
        """Sorts samples that are in any order.

        Args:
            shape: (H, W) or (E, H, W) of the sensor.
            y, x, env: pixel of each sample, whole numbers [R]; env may be left out where E is 1.
            offset: int [R] ns, as of the class.
            value: float [R], in colour [R, 3].

        Raises ValueError for a pixel that is not there, and for numbers that are not whole, too large or too few.
        """
        size = (1, *shape)[-3:]
        given = np.broadcast_arrays(*np.atleast_1d(env, y, x, offset))
        value = np.atleast_1d(np.asarray(value, np.float32))
        for name, at in zip(("offset", "x", "y", "env"), given[::-1]):
            if at.ndim != 1 or (at.size and at.dtype.kind not in "iu"):
                raise ValueError(f"further samples have {name} of {at.dtype} {at.shape}, expected integers in one row")
        times = given[3]
        if len(value) != times.size:
            raise ValueError(f"further samples have {times.size} offsets and {len(value)} values; each has one")
        if times.size and not -LONGEST <= times.min() <= times.max() <= LONGEST:
            far = max(times.min(), times.max(), key=abs)
            raise ValueError(
                f"further samples have an offset of {far} ns; give frames in between, {LONGEST} is the most"
            )
        for name, at, length in zip(("environment", "y", "x"), given, size):
            if at.size and not 0 <= at.min() <= at.max() < length:
                raise ValueError(f"further samples have {name} {at.min()} to {at.max()}; there are 0 to {length - 1}")
        q = np.ravel_multi_index([np.asarray(a, np.int64) for a in given[:3]], size)
        order = np.lexsort((times, q))
        counts = np.bincount(q, minlength=int(np.prod(size)))
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        return cls(first, times[order].astype(np.int32), value[order])

    def of(self, envs: slice, total: int) -> Further:
        """Gives the samples of neighbouring environments; total: E of this object."""
        first = self.first.numpy() if isinstance(self.first, wp.array) else np.asarray(self.first)
        pixels = (len(first) - 1) // total
        first = first[envs.start * pixels : envs.stop * pixels + 1]
        own = slice(int(first[0]), int(first[-1]))
        return Further(first - first[:1], self.offset[own], self.value[own])

    def without(self, left_out: np.ndarray) -> Further:
        """Gives the samples without those of the environments left_out, bool [E]."""
        if not left_out.any():
            return self
        first, offset, value = (
            a.numpy() if isinstance(a, wp.array) else np.asarray(a) for a in (self.first, self.offset, self.value)
        )
        counts, kept = np.diff(first), np.repeat(~left_out, (len(first) - 1) // len(left_out))
        mine = np.repeat(kept, counts)
        first = np.concatenate([[0], np.cumsum(np.where(kept, counts, 0))]).astype(np.int32)
        return Further(first, offset[mine], value[mine])

    def none(self) -> Further:
        """Gives an object of as many pixels without any samples."""
        return Further(np.zeros(len(self.first), np.int32), self.offset[:0], self.value[:0])

    @classmethod
    def in_a_row(cls, parts: Sequence[Further], later: Sequence[int], device: Any) -> Further:
        """Joins the samples of messages that follow one another.

        Args:
            parts: of each message, of the same pixels.
            later: time from the start of the first one to that of each [ns].
            device: where the result lies.

        Raises ValueError for lengths that do not go together.
        """
        from nodes.event_sensor.input.further_kernels import add_counts, append_samples

        lists = []
        for part in parts:
            starts, offsets = (_whole(getattr(part, name), name, device) for name in ("first", "offset"))
            lists.append((starts, offsets, on_device(part.value, device)))
        pixels = lists[0][0].size - 1
        total = sum(offset.size for _, offset, _ in lists)
        shared = max((value.size // offset.size for _, offset, value in lists if offset.size), default=1)
        for first, offset, value in lists:
            if first.size != pixels + 1 or value.size != shared * offset.size:
                raise ValueError(
                    f"further samples of messages in a row have {first.size} entries in first, {offset.size} offsets "
                    f"and {value.size} values, expected {pixels + 1}, and {shared} values for each offset"
                )
        with wp.ScopedDevice(device):
            first = wp.zeros(pixels + 1, dtype=wp.int32)
            for starts, *_ in lists:
                wp.launch(add_counts, pixels, [starts, 1], [first])
            wp.utils.array_scan(first, first, inclusive=True)
            taken = wp.clone(first)
            offset, value = wp.empty(total, dtype=wp.int32), wp.empty(total * shared, dtype=wp.float32)
            for (starts, offsets, values), after in zip(lists, later):
                given = [starts, offsets, values, shared, after, taken]
                wp.launch(append_samples, offsets.size, given, [offset, value])
                wp.launch(add_counts, pixels, [starts, 0], [taken])
        return cls(first, offset, value if shared == 1 else value.reshape((total, shared)))

    def on(self, size: Size, device: Any) -> SampleLists:
        """Gives the samples on a sensor's device. Raises ValueError for lengths and types that do not fit."""
        pixels, shared = size.envs * size.pixels // size.channels, size.channels
        first, offset = (_whole(getattr(self, name), name, device) for name in ("first", "offset"))
        value = on_device(self.value, device).flatten()
        if first.size != pixels + 1:
            raise ValueError(f"further samples have {first.size} entries in first, {pixels} pixels take {pixels + 1}")
        if value.size != offset.size * shared:
            raise ValueError(
                f"further samples have {offset.size} offsets and {value.size} values, expected {offset.size * shared}"
            )
        if value.size > MOST_NUMBERED:
            raise ValueError(f"event sensor got {value.size} further samples in one message, 2^31 are too many")
        return SampleLists(first, offset, value, shared)


def checked(
    lists: SampleLists, size: Size, t: np.ndarray, t_base: int, fresh: np.ndarray, told: wp.array | None = None
) -> SampleLists:
    """Gives the lists with what `problem` needs to tell whether they ascend, and stay within the message.

    t: int64 [K] ns, stamps of the frames. t_base: [ns], where offsets are 0. fresh: bool [E], environments that begin
    an episode with the first frame. told: int64 [1] in pinned memory, on a GPU.
    """
    from nodes.event_sensor.input.further_kernels import FINE, check_lists

    device = lists.first.device
    stamps: wp.array = wp.array(np.asarray(t - t_base, np.int64), device=device)
    begins: wp.array = wp.array(np.asarray(fresh, np.int32), device=device)
    found: wp.array = wp.full(1, FINE, dtype=wp.int64, device=device)
    pixels = size.pixels // size.channels
    threads = (size.envs, pixels if wp.get_device(device).is_cuda else 1)
    each = 1 if wp.get_device(device).is_cuda else pixels
    wp.launch(
        check_lists, threads, [lists.first, lists.offset, stamps, begins, pixels, each], [found], device=device
    )  # fmt: skip
    if told is not None:
        wp.copy(told, found)
    return replace(lists, found=found, told=found if told is None else told)


def problem(lists: SampleLists, size: Size) -> str:
    """Says what is wrong with lists that were `checked`, "" where nothing is; on a GPU it must have been waited for."""
    from nodes.event_sensor.input.further_kernels import FINE, REASONS

    assert lists.told is not None
    worst = int(lists.told.numpy()[0])
    if worst == FINE:
        return ""
    pixel, reason = divmod(worst, len(REASONS))
    env, inner = divmod(pixel, size.pixels // size.channels)
    y, x = divmod(inner, size.width)
    return f"further samples of pixel x {x}, y {y} of environment {env} {REASONS[reason]}"


def _whole(values: Any, name: str, device: Any) -> wp.array:
    """Gives whole numbers as int32 [n] on the device. Raises ValueError."""
    if isinstance(values, wp.array):
        if values.dtype is not wp.int32:
            raise ValueError(f"further samples have {name} of {values.dtype.__name__}, expected int32")
        return (values if values.device == device else values.to(device)).flatten()
    whole = np.asarray(values)
    if whole.dtype.kind not in "iu" or whole.ndim != 1:
        raise ValueError(f"further samples have {name} of {whole.dtype} {whole.shape}, expected int32 in one row")
    if whole.size and (whole.min() < -MOST_NUMBERED or whole.max() > MOST_NUMBERED):
        raise ValueError(f"further samples have {name} up to {whole.max()}, expected int32")
    return wp.array(np.ascontiguousarray(whole, np.int32), dtype=wp.int32, device=device, copy=False)
