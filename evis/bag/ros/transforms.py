"""Packs tf2_msgs/TFMessage for thousands of transforms at once.

The layout of one TransformStamped depends on its names alone once it starts at a multiple of 8 bytes, and it ends at
one. So all sub-steps share one template of words of 8 bytes, of which a time is one and a pose seven, written as whole
arrays. Only the very first transform starts elsewhere (after the 4-byte count) and is written by itself.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from evis.bag import BagError
from evis.bag.ros.cdr import ENCAPSULATION, RANGE, CdrWriter
from evis.runtime.clock import NS

POSE_BYTES = 56
_POSE = np.arange(POSE_BYTES // 8)


def _transform(writer: CdrWriter, frame_id: str, child: str) -> None:
    writer.header(0, frame_id)
    writer.string(child)
    writer.doubles(np.zeros(7))


@lru_cache(maxsize=64)
def _template(frame_id: str, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Makes the words of one sub-step, and the places in it of the stamps [N] and the poses [N, 7]."""
    writer = CdrWriter()
    stamps, poses = [], []
    for name in names:
        stamps.append(len(writer.buffer) - 4)
        _transform(writer, frame_id, name)
        poses.append(len(writer.buffer) - 4 - POSE_BYTES)
    firsts = np.array(poses, np.int64)[:, None] // 8
    return np.frombuffer(bytes(writer.buffer[4:]), "<u8"), np.array(stamps, np.int64) // 8, firsts + _POSE


def _first(frame_id: str, name: str) -> CdrWriter:
    writer = CdrWriter()
    writer.number("I", 0)
    _transform(writer, frame_id, name)
    return writer


Group = tuple[tuple[str, ...], np.ndarray, np.ndarray]
"""Names of N bodies, sub-step times int64 [S] ns, poses float64 [S, N, 7] (p, q xyzw)."""


def pack(frame_id: str, groups: Sequence[Group]) -> bytes:
    """Packs a TFMessage with the S * N transforms of each group, group by group, sub-step by sub-step."""
    groups = [group for group in groups if group[2].shape[0] * group[2].shape[1]]
    if not groups:
        return ENCAPSULATION + bytes(4)
    blocks = [_block(frame_id, *group) for group in groups]
    names, t, pose = groups[0]
    first = _first(frame_id, names[0]).buffer
    first[4:8] = struct.pack("<I", sum(pose.shape[0] * pose.shape[1] for _, _, pose in groups))
    first[8:16] = np.array([t[0] // NS, t[0] % NS], "<u4").tobytes()
    first[-POSE_BYTES:] = pose[0, 0].astype("<f8").tobytes()
    return bytes(first) + blocks[0][_skipped(frame_id, names) :].tobytes() + b"".join(b.tobytes() for b in blocks[1:])


def _skipped(frame_id: str, names: tuple[str, ...]) -> int:
    """Counts the bytes of the first transform where it starts at a multiple of 8."""
    return 8 * int(_template(frame_id, names)[2][0, -1] + 1)


def _block(frame_id: str, names: tuple[str, ...], t: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Packs the transforms of one group, from a multiple of 8 on, uint8."""
    words, stamps, poses = _template(frame_id, names)
    data = np.tile(words, (len(pose), 1))
    times = np.stack([t // NS, t % NS], axis=1)
    if times.min() < 0 or times.max() >= 1 << 31:
        raise BagError(f"stamp {int(t.min())} ns cannot be recorded: {RANGE}")
    data[:, stamps] = np.ascontiguousarray(times, "<u4").view("<u8")
    data[:, poses] = np.ascontiguousarray(pose, "<f8").view("<u8")
    return data.reshape(-1).view(np.uint8)


def unpack(raw: memoryview, frame_id: str, groups: Sequence[tuple[tuple[str, ...], int]]) -> list[np.ndarray]:
    """Unpacks the poses float64 [S, N, 7] of each group (names, sub-steps S) of what `pack` made.

    Raises BagError where the size differs.
    """
    full = [(names, steps) for names, steps in groups if names and steps]
    sizes = [8 * len(_template(frame_id, names)[0]) * steps for names, steps in full]
    data = np.empty(sum(sizes), np.uint8)
    expected = len(ENCAPSULATION) + 4
    if full:
        names = full[0][0]
        first, skipped = len(_first(frame_id, names[0]).buffer), _skipped(frame_id, names)
        expected = first + len(data) - skipped
    if len(raw) != expected:
        what = ", ".join(f"{steps} steps of {len(names)} bodies" for names, steps in groups)
        raise BagError(f"tf2_msgs/TFMessage has {len(raw)} bytes, {what} take {expected}")
    if full:
        data[skipped:] = np.frombuffer(raw[first:], np.uint8)
        data[skipped - POSE_BYTES : skipped] = np.frombuffer(raw[first - POSE_BYTES : first], np.uint8)
    result, at = [], 0
    for names, steps in groups:
        if not (names and steps):
            result.append(np.zeros((steps, len(names), 7)))
            continue
        _, _, poses = _template(frame_id, names)
        size = sizes.pop(0)
        rows = data[at : at + size].view("<u8").reshape(steps, -1)[:, poses]
        result.append(np.ascontiguousarray(rows).view("<f8"))
        at += size
    return result
