"""Maps messages to the ROS 2 messages that they become, and back.

A message of one environment is recorded as parts (ROS messages, for all who read ROS) followed by one closing JSON
text with everything that they do not hold. Types that ROS has no message for are the closing text alone, on the topic
itself; for the others it is on `<topic>/meta`.

The JSON travels in std_msgs/String: rosbag2 plays no file with a second serialization format in it, and rosbags opens
none with a schema that is not of ROS. Its JSON Schema is in the bag's metadata.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.bag import BagError
from evis.bag.ros import events, images, jsonform, lenses, schemas, states
from evis.bag.ros import messages as ros
from evis.bag.ros.messages import Buffers
from evis.bag.threads import ALONE, Threads
from msgs.camera import CameraInfo, EventPacket, Image, Imu
from msgs.fields import array_specs
from msgs.header import Header, Message
from msgs.world import WorldState

if TYPE_CHECKING:
    from evis.events.codecs.prophesee.evt3 import Encoder

META = "/meta"
"""Suffix of the topic of the closing message."""
ROS_TYPES = {
    **dict.fromkeys(["Keyframe", "Depth", "Motion", "Ids", "Normal", "Image", "Frames", "Samples"], schemas.IMAGE),
    "CameraInfo": schemas.CAMERA_INFO,
    "EventPacket": schemas.EVENT_PACKET,
    "Imu": schemas.IMU,
    "WorldState": schemas.TF,
}
"""Message -> ROS type on its topic; the others are JSON text there."""
FOREIGN = {
    schemas.EVENT_PACKET: "EventPacket", schemas.IMAGE: "Image", schemas.IMU: "Imu", schemas.CAMERA_INFO: "CameraInfo",
}  # fmt: skip
"""ROS type -> message, for bags that another program recorded."""
UNCOMPRESSED = ("Keyframe", "Frames", "Samples")
"""HDR radiance is noise to a compressor: it costs time and saves little."""


@dataclass
class RosPart:
    """Holds one ROS message of the several that a message of the bus becomes.

    `name`: which part of the message; `suffix`: added to the topic.
    """

    name: str
    ros_type: str
    suffix: str
    stamp_ns: int
    buffers: Buffers


def frame_of(topic: str) -> str:
    """Names the ROS frame of a camera's topic: the camera's name."""
    segments = topic.strip("/").split("/")
    return segments[-2] if len(segments) > 1 else states.WORLD


def encode(
    message: Message, topic: str, encoder: Encoder | None = None, threads: Threads = ALONE, **extra: Any
) -> tuple[list[RosPart], bytes]:
    """Encodes parts and closing JSON of a message of one environment. threads: share large ones. `extra`: further keys
    of the JSON, beginning with `_`.
    """
    frame, stamp = frame_of(topic), message.header.stamp_ns
    parts: list[RosPart] = []
    done: tuple[str, ...] = ()
    if type(message).__name__ in images.PARTS:
        parts, extra["_images"] = _image_parts(message, frame)
        done = tuple(extra["_images"])
    elif isinstance(message, EventPacket):
        packets, done = events.pack(message, frame, encoder, threads)
        beside = "/decoded" if message.raw is not None else ""  # of the sensor's own bytes
        parts = [
            RosPart(name, schemas.EVENT_PACKET, beside if name == "mono" else "", stamp, packed)
            for name, packed in packets
        ]
        extra["_events"] = events.summary(message)
    elif isinstance(message, WorldState) and states.whole(message):
        parts = [RosPart("pose", schemas.TF, "", stamp, [states.pack(message)])]
        extra["_steps"], extra["_bodies"] = len(message.t), message.end_pose.shape[1]
        done = states.PACKED
    elif isinstance(message, Imu):
        parts = [
            RosPart("sample", schemas.IMU, "", max(int(t), 0), ros.imu(max(int(t), 0), frame, w, a))
            for t, w, a in zip(message.t, message.angular_velocity, message.acceleration)
        ]
        done = ("acceleration", "angular_velocity")
    elif isinstance(message, CameraInfo):
        model, d = lenses.to_ros(message.distortion_model, np.asarray(message.distortion))
        size, k = (message.height, message.width), np.asarray(message.k)
        info = ros.camera_info(stamp, frame, *size, model, d, k, message.baseline)
        parts = [RosPart("info", schemas.CAMERA_INFO, "", stamp, info)]
    return parts, jsonform.dump(message, done, **extra)


def _image_parts(message: Message, frame: str) -> tuple[list[RosPart], dict[str, list[Any]]]:
    """Packs the images of a message: its parts, and field -> [dtype, shape] of each."""
    encoding = message.encoding if isinstance(message, Image) else ""
    stamp = message.header.stamp_ns
    parts, shapes = [], {}
    for field, suffix in images.PARTS[type(message).__name__].items():
        if (array := getattr(message, field)) is not None:
            array = np.asarray(array)
            parts.append(
                RosPart(field, schemas.IMAGE, suffix, stamp, images.pack(array, field, encoding, stamp, frame))
            )
            shapes[field] = [array.dtype.name, list(array.shape)]
    return parts, shapes


def decode(kind: str, parts: dict[str, list[memoryview]], body: dict[str, Any]) -> Message:
    """Decodes the message of `encode`'s parts (name -> bytes, in order) and parsed JSON. Raises BagError."""
    message_type = Message.TYPES.get(kind)
    if message_type is None:
        raise BagError(f"the bag holds messages of type {kind!r:.40}, which this release does not know")
    specs = array_specs(message_type)
    arrays: dict[str, np.ndarray] = {}
    try:
        if kind in images.PARTS:
            for field, (dtype, shape) in body.get("_images", {}).items():
                arrays[field] = images.unpack(_one(parts, field), dtype, shape, specs[field].dtypes)
        elif kind == "EventPacket":
            counted = body.get("_events", {})
            arrays = events.unpack(parts, counted.get("t_first_ns", 0))
            packed = len(arrays.get("t", ()))
            if counted.get("events", packed) != packed and not {"t", "t_base64"} & set(body):
                raise BagError(f"{packed} of a packet's {counted['events']} events are there")
            arrays = {n: a for n, a in arrays.items() if n not in body and f"{n}_base64" not in body}
        elif kind == "WorldState":
            arrays = states.unpack(_one(parts, "pose") if "_steps" in body else None, body)
        elif kind == "Imu":
            samples = [ros.read_imu(raw) for raw in parts.get("sample", [])]
            arrays["angular_velocity"] = np.array([s[1] for s in samples], np.float64).reshape(-1, 3)
            arrays["acceleration"] = np.array([s[2] for s in samples], np.float64).reshape(-1, 3)
    except (KeyError, TypeError, ValueError, AttributeError, MemoryError, OverflowError) as error:
        raise BagError(f"{kind}: {error}") from None
    return jsonform.load(message_type, body, arrays)


def _one(parts: dict[str, list[memoryview]], name: str) -> memoryview:
    found = parts.get(name, [])
    if len(found) != 1:
        raise BagError(f"{name} is there {len(found)} times, not once")
    return found[0]


def decode_foreign(ros_type: str, raw: memoryview, sequence: int) -> Message:
    """Decodes a ROS message that another program recorded. Raises BagError."""
    if ros_type == schemas.EVENT_PACKET:
        return events.foreign(raw)
    if ros_type == schemas.IMAGE:
        pixels, picture = images.foreign(raw)
        if pixels.dtype.name not in array_specs(Image)["data"].dtypes:
            raise BagError(f"images of encoding '{picture.encoding}' are not supported")
        return Image(Header(picture.stamp_ns, sequence, "ros"), pixels, picture.encoding)
    if ros_type == schemas.IMU:
        stamp, velocity, acceleration = ros.read_imu(raw)
        t = np.array([stamp], np.int64)
        return Imu(Header(stamp, sequence, "ros"), t, acceleration.reshape(1, 3), velocity.reshape(1, 3))
    if ros_type == schemas.CAMERA_INFO:
        stamp, height, width, model, distortion, k, baseline = ros.read_camera_info(raw)
        model, distortion = lenses.from_ros(model, distortion)
        about: dict[str, Any] = {"width": width, "height": height, "distortion_model": model, "baseline": baseline}
        return CameraInfo(Header(stamp, sequence, "ros"), k, distortion, clock="ros", **about)
    raise BagError(f"messages of type {ros_type} are not supported")
