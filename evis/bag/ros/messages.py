"""Converts the five ROS 2 messages of a bag to CDR bytes and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.bag import BagError
from evis.bag.ros.cdr import CdrReader, CdrWriter

Buffers = list[bytes | bytearray | memoryview]
"""A message as pieces that follow one another; large arrays are not copied."""


def image(stamp_ns: int, frame_id: str, height: int, width: int, encoding: str, step: int, data: memoryview) -> Buffers:
    """Packs a sensor_msgs/Image of row-major pixels, little endian. `step`: bytes per row."""
    w = CdrWriter()
    w.header(stamp_ns, frame_id)
    w.number("I", height)
    w.number("I", width)
    w.string(encoding)
    w.number("B", 0)
    w.number("I", step)
    w.number("I", data.nbytes)
    return [w.buffer, data]


def text(data: bytes) -> Buffers:
    """Packs a std_msgs/String of UTF-8 bytes."""
    w = CdrWriter()
    w.number("I", len(data) + 1)
    return [w.buffer, data, b"\x00"]


def read_text(raw: memoryview) -> memoryview:
    """Reads the bytes of a std_msgs/String, without a copy."""
    return CdrReader(raw, "std_msgs/String").blob()[:-1]


@dataclass
class RosImage:
    """Holds a decoded sensor_msgs/Image; `data` is not copied."""

    stamp_ns: int
    height: int
    width: int
    encoding: str
    bigendian: bool
    step: int
    data: memoryview


def read_image(raw: memoryview) -> RosImage:
    """Reads a sensor_msgs/Image. Raises BagError where the bytes are not an Image."""
    r = CdrReader(raw, "sensor_msgs/Image")
    stamp_ns, _ = r.header()
    height, width = r.integer("I"), r.integer("I")
    return RosImage(stamp_ns, height, width, r.string(), r.integer("B") != 0, r.integer("I"), r.blob())


def camera_info(
    stamp_ns: int, frame_id: str, height: int, width: int, model: str, distortion: np.ndarray, k: np.ndarray,
    baseline: float = 0.0,
) -> Buffers:  # fmt: skip
    """Packs a sensor_msgs/CameraInfo of an unrectified camera: R = identity, P = [K | T].

    T = (-fx baseline, 0, 0) places the camera in the frame of the first one of its stereo rig, which is to its left by
    the baseline [m].
    """
    w = CdrWriter()
    w.header(stamp_ns, frame_id)
    w.number("I", height)
    w.number("I", width)
    w.string(model)
    w.number("I", len(distortion))
    w.doubles(distortion)
    w.doubles(k)
    w.doubles(np.eye(3))
    w.doubles(np.hstack([k, [[-float(k[0, 0]) * baseline if baseline else 0.0], [0.0], [0.0]]]))
    for _ in range(6):  # binning x, y; region of interest x, y, height, width: 0 = the whole image
        w.number("I", 0)
    w.number("B", 0)
    return [w.buffer]


def read_camera_info(raw: memoryview) -> tuple[int, int, int, str, np.ndarray, np.ndarray, float]:
    """Reads (stamp [ns], height, width, distortion model, coefficients, K [3,3], baseline [m])."""
    r = CdrReader(raw, "sensor_msgs/CameraInfo")
    stamp_ns, _ = r.header()
    height, width, model = r.integer("I"), r.integer("I"), r.string()
    distortion = r.doubles(r.integer("I")).copy()
    k, _, p = (r.doubles(n).reshape(3, -1).copy() for n in (9, 9, 12))
    baseline = -float(p[0, 3] / p[0, 0]) if p[0, 0] and p[0, 3] else 0.0
    return stamp_ns, height, width, model, distortion, k, baseline


def imu(stamp_ns: int, frame_id: str, angular_velocity: np.ndarray, acceleration: np.ndarray) -> Buffers:
    """Packs a sensor_msgs/Imu of one sample; its orientation is marked unknown (covariance[0] = -1, as REP 145
    asks).
    """
    w = CdrWriter()
    w.header(stamp_ns, frame_id)
    unknown = np.zeros(9)
    unknown[0] = -1.0
    w.doubles(np.array([0.0, 0.0, 0.0, 1.0]))
    w.doubles(unknown)
    w.doubles(angular_velocity)
    w.doubles(np.zeros(9))
    w.doubles(acceleration)
    w.doubles(np.zeros(9))
    return [w.buffer]


def read_imu(raw: memoryview) -> tuple[int, np.ndarray, np.ndarray]:
    """Reads (stamp [ns], angular velocity [3], acceleration [3])."""
    r = CdrReader(raw, "sensor_msgs/Imu")
    stamp_ns, _ = r.header()
    r.doubles(4 + 9)
    velocity = r.doubles(3)
    r.doubles(9)
    return stamp_ns, velocity, r.doubles(3)


@dataclass
class RosEvents:
    """Holds an event_camera_msgs/EventPacket; `events` are its undecoded bytes."""

    stamp_ns: int
    height: int
    width: int
    seq: int
    base_ns: int
    encoding: str
    events: memoryview


def event_packet(packet: RosEvents, frame_id: str) -> Buffers:
    """Packs an event_camera_msgs/EventPacket."""
    w = CdrWriter()
    w.header(packet.stamp_ns, frame_id)
    w.number("I", packet.height)
    w.number("I", packet.width)
    w.number("Q", packet.seq)
    w.number("Q", packet.base_ns)
    w.string(packet.encoding)
    w.number("B", 0)
    w.number("I", packet.events.nbytes)
    return [w.buffer, packet.events]


def read_event_packet(raw: memoryview) -> RosEvents:
    """Reads an event_camera_msgs/EventPacket. Raises BagError where the bytes are not an EventPacket, or hold
    big-endian events."""
    r = CdrReader(raw, "event_camera_msgs/EventPacket")
    stamp_ns, _ = r.header()
    height, width, seq, base = r.integer("I"), r.integer("I"), r.integer("Q"), r.integer("Q")
    encoding = r.string()
    if r.integer("B"):
        raise BagError("event_camera_msgs/EventPacket holds big-endian events, which no known camera sends")
    return RosEvents(stamp_ns, height, width, seq, base, encoding, r.blob())
