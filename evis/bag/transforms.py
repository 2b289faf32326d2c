"""tf2_msgs/TFMessage for thousands of transforms at once.

The layout of one TransformStamped depends on its names alone once it starts at a multiple of 8 bytes, and it ends at
one. So all sub-steps share one template of bytes, into which times and poses are written as whole arrays. Only the very
first transform starts elsewhere (after the 4-byte count) and is written by itself.
"""

from __future__ import annotations

import struct
from functools import lru_cache

import numpy as np

from evis.bag import BagError
from evis.bag.cdr import ENCAPSULATION, CdrWriter

POSE_BYTES = 56


def _transform(writer: CdrWriter, frame_id: str, child: str) -> None:
    writer.header(0, frame_id)
    writer.string(child)
    writer.doubles(np.zeros(7))


@lru_cache(maxsize=64)
def _template(frame_id: str, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(bytes of one sub-step from a multiple of 8 on, offsets of the stamps, offsets of the poses), one per body."""
    writer = CdrWriter()
    stamps, poses = [], []
    for name in names:
        stamps.append(len(writer.buffer) - 4)
        _transform(writer, frame_id, name)
        poses.append(len(writer.buffer) - 4 - POSE_BYTES)
    return np.frombuffer(bytes(writer.buffer[4:]), np.uint8), np.array(stamps, np.int64), np.array(poses, np.int64)


def _first(frame_id: str, name: str) -> CdrWriter:
    writer = CdrWriter()
    writer.number("I", 0)
    _transform(writer, frame_id, name)
    return writer


def pack(frame_id: str, names: tuple[str, ...], t: np.ndarray, pose: np.ndarray) -> bytes:
    """TFMessage with S * N transforms, sub-step by sub-step. t int64 [S] ns, pose float64 [S,N,7] (p, q xyzw)."""
    steps, bodies = pose.shape[:2]
    if not steps * bodies:
        return ENCAPSULATION + bytes(4)
    block, stamps, poses = _template(frame_id, names)
    data = np.tile(block, (steps, 1))
    times = np.stack([t // 1_000_000_000, t % 1_000_000_000], axis=1)
    if times.min() < 0 or times.max() >= 1 << 31:
        raise BagError(f"stamp {int(t.min())} ns cannot be recorded: a bag's times go from 0 to 2^31 s")
    raw_times = np.ascontiguousarray(times, "<u4").view(np.uint8)
    data[:, stamps[:, None] + np.arange(8)] = raw_times[:, None, :]
    raw_poses = np.ascontiguousarray(pose, "<f8").view(np.uint8).reshape(steps, bodies, POSE_BYTES)
    data[:, poses[:, None] + np.arange(POSE_BYTES)] = raw_poses
    first = _first(frame_id, names[0]).buffer
    first[4:8] = struct.pack("<I", steps * bodies)
    first[8:16] = raw_times[0].tobytes()
    first[-POSE_BYTES:] = raw_poses[0, 0].tobytes()
    return bytes(first) + data.reshape(-1)[int(poses[0]) + POSE_BYTES :].tobytes()


def unpack(raw: memoryview, frame_id: str, names: tuple[str, ...], steps: int) -> np.ndarray:
    """The poses float64 [S,N,7] of what `pack` made with the same names. Raises BagError where the size differs."""
    bodies = len(names)
    if not steps * bodies:
        return np.zeros((steps, bodies, 7))
    block, _, poses = _template(frame_id, names)
    first = len(_first(frame_id, names[0]).buffer)
    skipped = int(poses[0]) + POSE_BYTES
    expected = first + steps * len(block) - skipped
    if len(raw) != expected:
        raise BagError(f"tf2_msgs/TFMessage has {len(raw)} bytes, {steps} steps of {bodies} bodies take {expected}")
    data = np.empty(steps * len(block), np.uint8)
    data[skipped:] = np.frombuffer(raw[first:], np.uint8)
    data[skipped - POSE_BYTES : skipped] = np.frombuffer(raw[first - POSE_BYTES : first], np.uint8)
    picked = data.reshape(steps, -1)[:, poses[:, None] + np.arange(POSE_BYTES)]
    return np.ascontiguousarray(picked).view("<f8").reshape(steps, bodies, 7)
