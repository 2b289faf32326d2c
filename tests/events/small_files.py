"""One small file of each format, the same events in all of them: for cutting and for damaging."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from file_cases import (
    aedat2_davis,
    aedat3,
    dvs_array_cdr,
    dvs_array_ros1,
    event_packet,
    mono,
    nmnist,
    small_events,
    text_zip,
)

from evis.events import open_writer
from evis.events.codecs.prophesee.evt3 import Encoder

EVENTS = small_events(90)


def written(suffix, encoding=""):
    def make(folder):
        with open_writer(folder / f"whole{suffix}", 34, 34, encoding) as writer:
            for a in range(0, 90, 30):
                writer.write(EVENTS[a : a + 30])
        return (folder / f"whole{suffix}").read_bytes()

    return make


def ros1_bag(compression=None):
    def make(folder):
        rosbag1 = pytest.importorskip("rosbags.rosbag1")
        bag = rosbag1.Writer(folder / "whole.bag")
        if compression:
            bag.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression))
        with bag as writer:
            connection = writer.add_connection(
                "/dvs/events", "dvs_msgs/msg/EventArray", msgdef="uint8 a", md5sum="0" * 32
            )
            for i, a in enumerate(range(0, 90, 30)):
                writer.write(connection, 1000 + i, dvs_array_ros1(EVENTS[a : a + 30], 34, 34))
        return (folder / "whole.bag").read_bytes()

    return make


def mcap_bag(compression):
    def make(folder):
        from mcap.writer import CompressionType, Writer

        with (folder / "whole.mcap").open("wb") as file:
            writer = Writer(file, chunk_size=600, compression=getattr(CompressionType, compression))
            writer.start("ros2")
            schema = writer.register_schema("dvs_msgs/msg/EventArray", "ros2msg", b"uint8 a")
            channel = writer.register_channel("/dvs/events", "cdr", schema)
            for i, a in enumerate(range(0, 90, 30)):
                writer.add_message(channel, 1000 + i, dvs_array_cdr(EVENTS[a : a + 30], 34, 34), 1000 + i, i)
            writer.finish()
        return (folder / "whole.mcap").read_bytes()

    return make


def packets_bag(folder):
    """EVT3 that goes on from message to message."""
    rosbag1 = pytest.importorskip("rosbags.rosbag1")
    encoder = Encoder()
    with rosbag1.Writer(folder / "packets.bag") as writer:
        connection = writer.add_connection("/e", "event_camera_msgs/msg/EventPacket", msgdef="uint8 a", md5sum="0" * 32)
        for i, a in enumerate(range(0, 90, 30)):
            payload = encoder.encode(EVENTS[a : a + 30])
            writer.write(connection, 1000 + i, event_packet("evt3", payload, 34, 34, i, 0, False))
    return (folder / "packets.bag").read_bytes()


def db3_bag(folder):
    """Two `mono` messages."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    text = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    store.register(
        get_types_from_msg(text + "bool is_bigendian\nuint8[] events\n", "event_camera_msgs/msg/EventPacket")
    )
    with rosbag2.Writer(folder / "bag", version=8) as writer:
        connection = writer.add_connection("/e", "event_camera_msgs/msg/EventPacket", typestore=store)
        for i, a in enumerate((0, 45)):
            payload = mono(EVENTS[a : a + 45], 1000)
            writer.write(connection, 1000 + i, event_packet("mono", payload, 34, 34, i, 1000, True))
    (path,) = (folder / "bag").glob("*.db3")
    return path.read_bytes()


def numpy_archive(folder):
    """Compressed by numpy, which writes the arrays in the order of their names."""
    np.savez_compressed(folder / "whole.npz", t=EVENTS.t, x=EVENTS.x, y=EVENTS.y, p=EVENTS.p, width=34, height=34)
    return (folder / "whole.npz").read_bytes()


def table(folder):
    """An event a row."""
    np.save(folder / "whole.npy", np.stack([EVENTS.t // 1000, EVENTS.x, EVENTS.y, EVENTS.p], 1))
    return (folder / "whole.npy").read_bytes()


def table_archive(folder):
    """The same, compressed."""
    np.savez_compressed(folder / "table.npz", np.load(folder / "whole.npy") if table(folder) else None)
    return (folder / "table.npz").read_bytes()


CASES = {
    "dat": (written(".dat"), ".dat"), "es": (written(".es"), ".es"), "text": (written(".txt"), ".txt"),
    "csv": (written(".csv"), ".csv"), "aedat4": (written(".aedat4", "none"), ".aedat4"),
    "aedat4 lz4": (written(".aedat4", "lz4"), ".aedat4"), "aedat4 zstd": (written(".aedat4"), ".aedat4"),
    "aedat2": (lambda _: aedat2_davis(EVENTS), ".aedat"), "aedat3": (lambda _: aedat3(EVENTS, 30), ".aedat"),
    "nmnist": (lambda _: nmnist(EVENTS), ".bin"), "raw evt21": (written(".raw", "evt21"), ".raw"),
    "bag": (ros1_bag(), ".bag"), "bag bz2": (ros1_bag("BZ2"), ".bag"), "bag lz4": (ros1_bag("LZ4"), ".bag"),
    "bag packets": (packets_bag, ".bag"), "mcap": (mcap_bag("NONE"), ".mcap"), "mcap zstd": (mcap_bag("ZSTD"), ".mcap"),
    "mcap lz4": (mcap_bag("LZ4"), ".mcap"), "npz": (written(".npz"), ".npz"), "npz packed": (numpy_archive, ".npz"),
    "zip": (lambda _: text_zip(EVENTS), ".zip"), "npy": (table, ".npy"), "npz rows": (table_archive, ".npz"),
    "raw evt4": (written(".raw", "evt4"), ".raw"),
    "text gzip": (lambda folder: gzip.compress(written(".txt")(folder), mtime=0), ".txt.gz"),
}  # fmt: skip
OTHERS = {
    "raw evt2": (written(".raw", "evt2"), ".raw"), "raw evt3": (written(".raw", "evt3"), ".raw"),
    "db3": (db3_bag, ".db3"),
    "hdf5 ecf": (written(".h5", "ecf"), ".h5"), "hdf5 plain": (written(".h5", "plain"), ".h5"),
}  # fmt: skip
"""Formats whose cuts are tested elsewhere."""
