"""Bags before independent readers: the MCAP library, mcap-ros2-support and rosbags."""

import json

import numpy as np
import pytest
from bag_messages import scene
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from evis.bag import BagError
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter, describe_run

KEYFRAMES = 6


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "a.mcap"
    with BagWriter(path, describe_run("nodes: {}", {"physics": {"seed": 3}}, seed=3), chunk_bytes=4000) as writer:
        for k in range(KEYFRAMES):
            for topic, message in scene(k).items():
                writer.write(topic, message)
    return path


def sent(topic):
    return [scene(k)[topic] for k in range(KEYFRAMES)]


IMAGES = {
    "/cam0/keyframe": ("radiance", "32FC3"),
    "/cam0/depth": ("depth", "32FC1"),
    "/cam0/motion": ("motion", "32FC2"),
    "/cam0/ids": ("ids", "32SC1"),
    "/cam0/normal": ("normal", "32FC3"),
    "/cam0/image": ("data", "rgb8"),
}


def check_image(image, message, field, encoding):
    array = getattr(message, field)
    array = array[0] if field != "data" else array
    assert image.encoding == encoding and (image.height, image.width) == array.shape[:2]
    assert image.step * image.height == array.nbytes and bytes(image.data) == array.tobytes()
    assert image.header.stamp.sec * 10**9 + image.header.stamp.nanosec == message.header.stamp_ns


def check_events(packets, messages):
    for packet, message in zip(packets, messages, strict=True):
        assert (packet.encoding, packet.width, packet.height) == ("mono", message.width, message.height)
        words = np.frombuffer(bytes(packet.events), "<u8")
        assert [int(w & 0xFFFFFFFF) + packet.time_base for w in words] == message.t.tolist()
        assert [int(w) >> 32 & 0xFFFF for w in words] == message.x.tolist()
        assert [int(w) >> 48 & 0x7FFF for w in words] == message.y.tolist()
        assert [int(w) >> 63 for w in words] == message.p.tolist()


def check_transforms(message, state):
    """The bodies that move at every sub-step, then the others once, at the stamp."""
    pose, last = state.rows()[0][0], len(state.t) - 1
    expected = [(step, body) for step in range(last + 1) for body in state.moving.tolist()]
    expected += [(last, body) for body in range(pose.shape[1]) if body not in state.moving]
    for transform, (step, body) in zip(message.transforms, expected, strict=True):
        assert transform.header.frame_id == "world" and transform.child_frame_id == state.names[body]
        assert transform.header.stamp.sec * 10**9 + transform.header.stamp.nanosec == state.t[step]
        p, q = transform.transform.translation, transform.transform.rotation
        assert [p.x, p.y, p.z, q.x, q.y, q.z, q.w] == pose[step, body].tolist()


def test_mcap_ros2_support(bag):
    with open(bag, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {}
        names = [*IMAGES, "/cam0/events", "/state", "/cam0/info", "/cam0/imu", "/cam0/labels/flow"]
        for _, channel, record, message in reader.iter_decoded_messages(names):
            assert record.log_time == record.publish_time
            found.setdefault(channel.topic, []).append(message)
    for topic, (field, encoding) in IMAGES.items():
        for image, message in zip(found[topic], sent(topic), strict=True):
            check_image(image, message, field, encoding)
    check_events(found["/cam0/events"], sent("/cam0/events"))
    for message, state in zip(found["/state"], sent("/state"), strict=True):
        check_transforms(message, state)
    for flow, labels in zip(found["/cam0/labels/flow"], sent("/cam0/labels"), strict=True):
        check_image(flow, labels, "flow", "32FC2")
    info = found["/cam0/info"][0]
    assert list(info.k) == (np.eye(3) * 3).ravel().tolist() and list(info.d) == [0.1, -0.2, 0.0, 0.0, 0.0]
    samples = [(t, *a) for m in sent("/cam0/imu") for t, a in zip(m.t.tolist(), m.acceleration.tolist())]
    got = [(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, m.linear_acceleration) for m in found["/cam0/imu"]]
    assert [(t, a.x, a.y, a.z) for t, a in got] == samples


def test_rosbags(bag):
    with AnyReader([bag], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        found = {}
        chosen = [c for c in reader.connections if c.topic in (*IMAGES, "/cam0/events", "/state")]
        for connection, _, raw in reader.messages(chosen):
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    for topic, (field, encoding) in IMAGES.items():
        for image, message in zip(found[topic], sent(topic), strict=True):
            check_image(image, message, field, encoding)
    check_events(found["/cam0/events"], sent("/cam0/events"))
    for message, state in zip(found["/state"], sent("/state"), strict=True):
        check_transforms(message, state)


def test_profile_metadata_and_counts(bag):
    with open(bag, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        tables = {m.name: m.metadata for m in reader.iter_metadata()}
        assert tables["launch"] == {"text": "nodes: {}"} and json.loads(tables["parameters"]["physics"]) == {"seed": 3}
        assert tables["evis"]["seed"] == "3" and tables["evis"]["version.numpy"] == np.__version__
        summary = reader.get_summary()
        counts = {}
        for _, channel, _ in reader.iter_messages():
            counts[channel.id] = counts.get(channel.id, 0) + 1
        assert counts == summary.statistics.channel_message_counts
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 5


def test_every_record_is_valid_in_file_order(bag):
    """Schemas come before channels and channels before messages, with all checksums right."""
    with open(bag, "rb") as file:
        names = [type(r).__name__ for r in StreamReader(file, validate_crcs=True).records]
    assert names[0] == "Header" and names[-1] == "Footer"
    assert names.count("Message") > 100 and names.index("Schema") < names.index("Channel") < names.index("Message")


def test_json_texts_follow_their_schemas(bag):
    kinds = {"integer": int, "number": (int, float), "string": str, "object": dict, "array": list, "boolean": bool}
    checked = 0
    with open(bag, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        described = {m.name: json.loads(m.metadata["schema"]) for m in reader.iter_metadata() if "schema" in m.metadata}
        for schema, channel, _, message in reader.iter_decoded_messages():
            assert schema.encoding == "ros2msg" and channel.message_encoding == "cdr"
            if schema.name != "std_msgs/msg/String":
                continue
            body = json.loads(message.data)
            for name, value in described[f"jsonschema.{channel.metadata['evis.message']}"]["properties"].items():
                if name in body:
                    assert isinstance(body[name], kinds[value["type"]]), (channel.topic, name)
                    checked += 1
    assert checked > 300


def test_bags_of_other_programs(tmp_path):
    """A bag by rosbags' writer, with camera messages only, read as ours."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg

    from evis.bag.ros.schemas import DEFINITIONS

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(
        get_types_from_msg(DEFINITIONS["event_camera_msgs/msg/EventPacket"], "event_camera_msgs/msg/EventPacket")
    )
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](3, 5), "x")
    pixels = np.arange(12, dtype=np.uint16)
    image = store.types["sensor_msgs/msg/Image"](header, 3, 4, "mono16", 0, 8, pixels.view(np.uint8))
    deep = store.types["sensor_msgs/msg/Image"](header, 2, 2, "bgr16", 0, 12, pixels.view(np.uint8))
    words = np.array([9, 1 << 63 | 2 << 48 | 1 << 32 | 4], np.uint64)
    mono = store.types["event_camera_msgs/msg/EventPacket"](
        header, 260, 346, 7, 100, "mono", False, words.view(np.uint8)
    )
    raw = store.types["event_camera_msgs/msg/EventPacket"](header, 260, 346, 8, 0, "evt3", False, words.view(np.uint8))
    text = store.types["std_msgs/msg/String"]("hello")
    with Writer(tmp_path / "ros", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, message in (
            ("/c/image", image),
            ("/d/image", deep),
            ("/c/events", mono),
            ("/d/events", raw),
            ("/text", text),
        ):
            connection = writer.add_connection(topic, message.__msgtype__, typestore=store)
            writer.write(connection, 3_000_000_005, store.serialize_cdr(message, message.__msgtype__))
    with BagReader(next((tmp_path / "ros").glob("*.mcap"))) as reader:
        found = dict(reader.messages())
        assert reader.topics == {
            "/c/image": "Image",
            "/d/image": "Image",
            "/c/events": "EventPacket",
            "/d/events": "EventPacket",
        }
        assert not reader.skipped
    assert found["/c/image"].encoding == "mono16" and found["/c/image"].data.ravel().tolist() == pixels.tolist()
    assert found["/d/image"].encoding == "bgr16" and np.array_equal(found["/d/image"].data[:], pixels.reshape(2, 2, 3))
    packet = found["/c/events"]
    assert [packet.t.tolist(), packet.x.tolist(), packet.y.tolist(), packet.p.tolist()] == [
        [109, 104],
        [0, 1],
        [0, 2],
        [0, 1],
    ]
    assert found["/d/events"].encoding == "evt3" and found["/d/events"].raw.tobytes() == words.tobytes()


@pytest.mark.parametrize(("names", "there"), [(["a_0.mcap", "metadata.yaml"], "a_0.mcap"), ([], "none")])
def test_a_folder_is_told_with_what_to_name(tmp_path, names, there):
    """ROS 2 keeps a bag as a folder."""
    for name in names:
        (tmp_path / name).touch()
    with pytest.raises(BagError, match=f"is a folder; name the .mcap in it .it holds {there}."):
        BagReader(tmp_path)
