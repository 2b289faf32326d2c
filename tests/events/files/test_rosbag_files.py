"""ROS 1 and ROS 2 bags, written with the rosbags and mcap libraries and read here."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from file_cases import dvs_array_cdr, dvs_array_ros1, event_packet, mono, save, small_events
from small_files import CASES
from stream_cases import same

from evis.bag import BagError
from evis.bag.writer import BagWriter
from evis.events import Events, RecordingError, open_recording
from evis.events.codecs.prophesee.evt3 import Encoder
from msgs.camera import EventPacket
from msgs.diagnostics import Diagnostics
from msgs.header import Header
from nodes.replayer.node import ReplayerNode

rosbag1 = pytest.importorskip("rosbags.rosbag1")
PARTS = [small_events(40 + i, 300, 200, seed=i) for i in range(6)]
WHOLE = Events.concatenate(PARTS)


def ros1(path: Path, messages, compression=None, kind="dvs_msgs/msg/EventArray") -> Path:
    """messages: (topic, bytes)."""
    bag = rosbag1.Writer(path)
    if compression:
        bag.set_compression(getattr(rosbag1.Writer.CompressionFormat, compression))
    with bag as writer:
        connections = {}
        for i, (topic, data) in enumerate(messages):
            if topic not in connections:
                name = "sensor_msgs/msg/Image" if topic == "/image" else kind
                connections[topic] = writer.add_connection(topic, name, msgdef="uint8 a", md5sum="0" * 32)
            writer.write(connections[topic], 10**9 + i, data)
    return path


@pytest.mark.parametrize("compression", [None, "BZ2", "LZ4"])
@pytest.mark.parametrize("package", ["dvs_msgs", "prophesee_event_msgs"])
def test_event_arrays_of_ros1(package, compression, tmp_path):
    """Between messages of other topics, in each compression."""
    messages = [("/image", b"\0" * 100)]
    for part in PARTS:
        messages += [("/dvs/events", dvs_array_ros1(part, 300, 200)), ("/image", b"\0" * 5000)]
    with open_recording(ros1(tmp_path / "a.bag", messages, compression, f"{package}/msg/EventArray")) as recording:
        assert (recording.info.width, recording.info.height, recording.info.encoding) == (300, 200, package)
        same(recording.read(), WHOLE)


def test_a_ros1_bag_without_its_index(tmp_path):
    """As `rosbag record` leaves it when it is killed: the header's index position is 0, the index is not there."""
    path = ros1(tmp_path / "a.bag", [("/e", dvs_array_ros1(part, 300, 200)) for part in PARTS])
    data = bytearray(path.read_bytes())
    at = data.index(b"index_pos=") + 10
    position = struct.unpack_from("<Q", data, at)[0]
    data[at : at + 8] = bytes(8)
    with open_recording(save(tmp_path / "b.bag", bytes(data[:position]))) as recording:
        same(recording.read(), WHOLE)
        assert not recording.info.truncated


@pytest.mark.parametrize("cdr", [False, True])
def test_evt3_goes_on_from_message_to_message(cdr, tmp_path):
    """The decoder's state is kept; a message that is missing is counted, and words wait for the next time."""
    encoder = Encoder()
    payloads = [encoder.encode(part) for part in PARTS]
    whole = [event_packet("evt3", p, 300, 200, i, 0, cdr) for i, p in enumerate(payloads)]
    for gone in (None, 2):
        messages = [m for i, m in enumerate(whole) if i != gone]
        path = tmp_path / f"{gone}{cdr}.bag"
        if cdr:
            path = mcap(path.with_suffix(".mcap"), [("/e", m) for m in messages], "event_camera_msgs/msg/EventPacket")
        else:
            ros1(path, [("/e", m) for m in messages], kind="event_camera_msgs/msg/EventPacket")
        with open_recording(path) as recording:
            events = recording.read()
            if gone is None:
                same(events, WHOLE)
                assert not recording.counters()
            else:
                assert recording.counters()["messages_missing"] == 1
                kept = Events.concatenate([p for i, p in enumerate(PARTS) if i != gone])
                before = sum(len(p) for p in PARTS[:gone])
                np.testing.assert_array_equal(events.t[:before], kept.t[:before])
                # until the time is sent again, nothing is known
                assert 0 <= len(kept) - len(events) <= len(PARTS[gone + 1])
                np.testing.assert_array_equal(events.t[before:], kept.t[len(kept) - len(events) + before :])


def mcap(path: Path, messages, kind: str, encoding="cdr", compression="ZSTD", profile="ros2", indexed=True) -> Path:
    """An MCAP file by the mcap library."""
    from mcap.writer import CompressionType, IndexType, Writer

    with path.open("wb") as file:
        index = IndexType.ALL if indexed else IndexType.NONE
        writer = Writer(file, 2000, getattr(CompressionType, compression), index, use_chunking=indexed)
        writer.start(profile)
        channels = {}
        for i, (topic, data) in enumerate(messages):
            if topic not in channels:
                name = "sensor_msgs/msg/Image" if topic == "/image" else kind
                schema = writer.register_schema(name, "ros2msg" if encoding == "cdr" else "ros1msg", b"uint8 a")
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], 10**9 + i, data, 10**9 + i, i)
        writer.finish()
    return path


@pytest.mark.parametrize("compression", ["NONE", "LZ4", "ZSTD"])
@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_mcap_of_another_recorder(encoding, compression, tmp_path):
    """ROS 2 and ROS 1 messages in MCAP, with other topics between, in each compression."""
    make = dvs_array_cdr if encoding == "cdr" else dvs_array_ros1
    messages = [("/image", bytes(5000))]
    for part in PARTS:
        messages += [("/dvs/events", make(part, 300, 200)), ("/image", bytes(5000))]
    kind = "dvs_msgs/msg/EventArray" if encoding == "cdr" else "dvs_msgs/EventArray"
    with open_recording(mcap(tmp_path / "a.mcap", messages, kind, encoding, compression)) as recording:
        same(recording.read(), WHOLE)
        assert (recording.info.width, recording.info.height) == (300, 200) and not recording.info.warnings


def test_mcap_without_chunks_and_index(tmp_path):
    """Messages one by one in the file."""
    messages = [("/e", event_packet("mono", mono(p, 4000), 300, 200, i, 4000, True)) for i, p in enumerate(PARTS)]
    path = mcap(tmp_path / "a.mcap", messages, "event_camera_msgs/msg/EventPacket", indexed=False)
    with open_recording(path) as recording:
        same(recording.read(), WHOLE)
        assert recording.info.encoding == "mono"


def test_topics_are_chosen(tmp_path):
    """The first event topic, with a warning; the one that is asked for; a wrong name gives the right ones."""
    messages = [(f"/cam{i % 2}/events", dvs_array_ros1(part, 300, 200)) for i, part in enumerate(PARTS)]
    for path in (
        ros1(tmp_path / "a.bag", messages),
        mcap(tmp_path / "a.mcap", messages, "dvs_msgs/EventArray", encoding="ros1"),
    ):
        for number in (0, 1):
            with open_recording(path, topic=f"/cam{number}/events") as recording:
                same(recording.read(), Events.concatenate(PARTS[number::2]))
        with open_recording(path) as recording:
            assert len(recording.read()) == sum(map(len, PARTS[::2]))
            assert "/cam0/events, /cam1/events" in recording.info.warnings[0]
        with pytest.raises(RecordingError, match="no events on '/cam7'; they are on /cam0/events, /cam1/events"):
            open_recording(path, topic="/cam7")


def test_damaged_messages_are_left_out_alone(tmp_path):
    """A message that claims more events than it has, and an empty one."""
    messages = [dvs_array_ros1(part, 300, 200) for part in PARTS]
    at = messages[1].index(struct.pack("<III", 200, 300, len(PARTS[1]))) + 8
    messages[1] = messages[1][:at] + struct.pack("<I", 2**31) + messages[1][at + 4 :]
    messages[3] = b""
    with open_recording(ros1(tmp_path / "a.bag", [("/e", m) for m in messages])) as recording:
        kept = Events.concatenate([p for i, p in enumerate(PARTS) if i not in (1, 3)])
        same(recording.read(), kept)
        assert recording.counters() == {"messages_damaged": 2}


def test_a_damaged_chunk_is_left_out_alone(tmp_path):
    """Of a ROS 1 bag with a chunk for each message."""
    bag = rosbag1.Writer(tmp_path / "a.bag")
    bag.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
    bag.chunk_threshold = 1
    with bag as writer:
        connection = writer.add_connection("/e", "dvs_msgs/msg/EventArray", msgdef="uint8 a", md5sum="0" * 32)
        for i, part in enumerate(PARTS):
            writer.write(connection, 10**9 + i, dvs_array_ros1(part, 300, 200))
    data = bytearray((tmp_path / "a.bag").read_bytes())
    starts = [i for i in range(len(data)) if data[i : i + 4] == b"BZh9"]
    assert len(starts) == 6
    data[starts[2] + 60 : starts[2] + 90] = bytes(30)
    with open_recording(save(tmp_path / "b.bag", bytes(data))) as recording:
        same(recording.read(), Events.concatenate([p for i, p in enumerate(PARTS) if i != 2]))
        assert recording.counters() == {"chunks_damaged": 1}


def test_an_unknown_encoding_is_named(tmp_path):
    """One line with the encoding and those that are known."""
    message = event_packet("mor\nse", b"...", 300, 200, 0, 0, False)
    path = ros1(tmp_path / "a.bag", [("/e", message)], kind="event_camera_msgs/msg/EventPacket")
    with pytest.raises(RecordingError, match=r"a.bag: .*'mor\?se'.*evt3"), open_recording(path) as recording:
        recording.read()


def test_a_bag_of_evis(tmp_path):
    """What EVIS records itself: exact to the ns, the first of several cameras or the one that is asked for."""
    with BagWriter(tmp_path / "a.mcap") as bag:
        for i, part in enumerate(PARTS):
            for topic in ("/cam0/events", "/cam1/events"):
                t = part.t + i * 10**9 + 123
                offsets = np.array([0, len(part)], np.int64)
                packet = EventPacket(Header(i * 10**9 + 10**8, i, "sim", 0), offsets, t=t, x=part.x, y=part.y, p=part.p)
                packet.width, packet.height, packet.t0_ns = 300, 200, i * 10**9
                bag.write(topic, packet)
    with open_recording(tmp_path / "a.mcap", topic="/cam1/events") as recording:
        events = recording.read()
        assert (recording.info.width, recording.info.height, recording.info.format) == (300, 200, "mcap")
    np.testing.assert_array_equal(events.t, np.concatenate([p.t + i * 10**9 + 123 for i, p in enumerate(PARTS)]))
    np.testing.assert_array_equal(events.x, WHOLE.x)


def test_bags_without_events(tmp_path):
    """A bag of ours says which topics it has, and that it has none at all; a foreign one refuses a topic."""
    with BagWriter(tmp_path / "empty.mcap"):
        pass
    with pytest.raises(RecordingError, match=r"a bag without events and without any other topic$"):
        open_recording(tmp_path / "empty.mcap")
    with BagWriter(tmp_path / "other.mcap") as bag:
        bag.write("/diagnostics", Diagnostics(Header(1, 0, "wall"), "n"))
    with pytest.raises(RecordingError, match=r"a bag without events; its topics are /diagnostics$"):
        open_recording(tmp_path / "other.mcap")
    images = [("/image", b"\0" * 8)]
    for path in (ros1(tmp_path / "a.bag", images), mcap(tmp_path / "a.mcap", images, "")):
        with pytest.raises(RecordingError, match=r"no events on '/x', nor on any other topic$"):
            open_recording(path, topic="/x")


def test_a_bag_of_another_recorder_is_not_replayed_as_nothing(tmp_path):
    """It has none of our topics: the error says what plays its events."""
    path = save(tmp_path / "a.mcap", CASES["mcap"][0](tmp_path))
    with pytest.raises(BagError, match=r"a.mcap holds no topics of EVIS; .*evis launch camera.yaml file:=.*a.mcap"):
        ReplayerNode.dynamic_outputs({"bag": str(path)})
