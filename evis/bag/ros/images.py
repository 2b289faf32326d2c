"""Describes which array fields are recorded as sensor_msgs/Image, and how."""

from __future__ import annotations

import numpy as np

from evis.bag import BagError
from evis.bag.ros import messages
from evis.bag.ros.messages import Buffers

PARTS: dict[str, dict[str, str]] = {
    "Keyframe": {"radiance": "", "luminance": ""},
    "Depth": {"depth": ""},
    "Motion": {"motion": ""},
    "Ids": {"ids": ""},
    "Normal": {"normal": ""},
    "Image": {"data": ""},
    "Frames": {"luminance": "", "rgb": "/rgb"},
    "Samples": {"luminance": "", "rgb": "/rgb"},
    "Labels": {"flow": "/flow", "depth": "/depth", "segmentation": "/segmentation", "semantic": "/semantic"},
}
"""Message -> array field -> what is added to the topic's name."""
CHANNELS = {"radiance": 3, "motion": 2, "normal": 3, "rgb": 3, "flow": 2}
"""Channels of the fields whose last axis is one; the others have none (`data` of Image: as it is)."""
DTYPES = {
    "32F": "float32", "16F": "float16", "64F": "float64", "8U": "uint8", "16U": "uint16", "32S": "int32", "16S": "int16"
}  # fmt: skip
NAMED = {"rgb8": ("uint8", 3), "bgr8": ("uint8", 3), "rgba8": ("uint8", 4), "bgra8": ("uint8", 4),
         "rgb16": ("uint16", 3), "bgr16": ("uint16", 3), "rgba16": ("uint16", 4), "bgra16": ("uint16", 4),
         "mono8": ("uint8", 1), "mono16": ("uint16", 1)}  # fmt: skip


def pack(array: np.ndarray, field: str, encoding: str, stamp_ns: int, frame_id: str) -> Buffers:
    """Packs an image array [1,H,W(,C)], [1,K,H,W(,C)] (the K frames below each other) or, for Image, [H,W,C].

    float16 radiance is `16FC3`, a name that ROS lacks: the only one that says what the bytes are.
    """
    array = np.ascontiguousarray(array)
    channels = array.shape[-1] if field == "data" else CHANNELS.get(field, 1)
    width = array.shape[-2] if field == "data" or field in CHANNELS else array.shape[-1]
    row = width * channels
    height = array.size // row if row else 0
    if not encoding:
        kind = {v: k for k, v in DTYPES.items()}[array.dtype.name]
        encoding = f"{kind}C{channels}"
    flat = array.reshape(-1).view(np.uint8).data
    return messages.image(stamp_ns, frame_id, height, width, encoding, row * array.itemsize, flat)


def unpack(raw: memoryview, dtype: str, shape: list[int], allowed: tuple[str, ...]) -> np.ndarray:
    """Unpacks the array of `pack`, a read-only view of `raw`. Raises BagError where size or dtype do not fit."""
    picture = messages.read_image(raw)
    if dtype not in allowed:
        raise BagError(f"an image of dtype {dtype!r:.40} was announced, {' or '.join(allowed)} is declared")
    try:
        return np.frombuffer(picture.data, dtype).reshape(shape)
    except (TypeError, ValueError) as error:
        raise BagError(f"an image of {dtype} {shape!r:.60} was announced: {error}") from None


def foreign(raw: memoryview) -> tuple[np.ndarray, messages.RosImage]:
    """Reads a sensor_msgs/Image of any origin as [H,W,C]. Raises BagError for encodings that are not plain pixels."""
    picture = messages.read_image(raw)
    if picture.encoding in NAMED:
        dtype, channels = NAMED[picture.encoding]
    else:
        kind, _, count = picture.encoding.partition("C")
        if kind not in DTYPES or not count.isdigit() or not int(count):
            raise BagError(f"images of encoding '{picture.encoding:.40}' are not supported")
        dtype, channels = DTYPES[kind], int(count)
    wire = np.dtype(dtype).newbyteorder(">" if picture.bigendian else "<")
    row = picture.width * channels * wire.itemsize
    if picture.step < row or len(picture.data) < picture.step * picture.height:
        what = f"an image of {picture.width} x {picture.height} {picture.encoding}"
        raise BagError(f"{what} has {len(picture.data)} bytes")
    rows = np.frombuffer(picture.data, np.uint8)[: picture.step * picture.height].reshape(picture.height, -1)
    pixels = np.ascontiguousarray(rows[:, :row]).view(wire).astype(dtype)
    return pixels.reshape(picture.height, picture.width, channels), picture
