"""What a recorder keeps in memory for every chunk that it has written."""

import dataclasses
import gc
import tracemalloc

from bag_messages import scene
from mcap.opcode import Opcode
from mcap.reader import make_reader

from evis.bag.mcap.container import Container
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter

TOPICS = ("/state", "/clock", "/cam0/info", "/cam0/events", "/cam0/image", "/diagnostics")


def write_chunks(writer, first, end):
    """One chunk of all topics for each number, 100 ms apart, as the recorder of a quiet graph makes them."""
    messages = {topic: message for topic, message in scene(0).items() if topic in TOPICS}
    for k in range(first, end):
        for topic, message in messages.items():
            stamp = message.header.stamp_ns if message.header.clock == "wall" else k * 100_000_000
            header = dataclasses.replace(message.header, stamp_ns=stamp, seq=k)
            writer.write(topic, dataclasses.replace(message, header=header))
        writer.flush()


def kept_by(step, warm, count):
    """Bytes that stay allocated per call of `step`, after `warm` calls for what is allocated once only.

    The warm calls are traced too: objects that Python keeps for its next lists and dicts are counted before as after.
    """
    tracemalloc.start()
    try:
        for k in range(warm):
            step(k)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        for k in range(warm, warm + count):
            step(k)
        gc.collect()
        return (tracemalloc.get_traced_memory()[0] - before) / count
    finally:
        tracemalloc.stop()


def test_a_chunk_leaves_few_bytes_in_memory(tmp_path):
    """Ten channels: 1,000 bytes of objects for every chunk were 35 MB an hour. Packed, and not yet compressed: 111."""
    with BagWriter(tmp_path / "a.mcap", chunk_bytes=1 << 30, chunk_period_s=1e6) as writer:
        kept = kept_by(lambda k: write_chunks(writer, k, k + 1), 100, 300)
    assert kept < 300


def test_many_chunks_leave_a_megabyte_an_hour(tmp_path):
    """Blocks of the packed index are compressed: an hour has 36,000 chunks."""
    container = Container(tmp_path / "a.mcap", chunk_period_s=1e6)
    schema = container.add_schema("std_msgs/msg/String", "ros2msg", b"string data")
    channels = [container.add_channel(f"/{k}", "cdr", schema, {}) for k in range(10)]

    def step(k):
        container.add([(c, k, k * 100_000_000, [bytes(20 + (k * c) % 7)]) for c in channels])
        container.flush()

    assert kept_by(step, 700, 1200) * 36_000 < 3e6
    container.close()


def test_episodes_leave_few_bytes_in_memory(tmp_path):
    """Every reset writes a record of its own, which the index at the end names."""
    action = scene(0)["/action"]
    with BagWriter(tmp_path / "a.mcap", chunk_period_s=1e6) as writer:

        def reset(episode):
            header = dataclasses.replace(action.header, episode=episode, seq=episode, stamp_ns=episode)
            writer.write("/action", dataclasses.replace(action, header=header))

        assert kept_by(reset, 10, 300) < 200  # its chunk too
    with BagReader(tmp_path / "a.mcap") as reader:
        assert len(reader.scanner.layout.episodes) == 309  # every one but the first begins with a reset


def test_the_packed_index_says_where_everything_is(tmp_path, monkeypatch):
    """Read back by the MCAP library from several compressed blocks, every number against the bytes of the file."""
    from evis.bag.mcap import summary

    monkeypatch.setattr(summary, "_BLOCK", 300)
    path = tmp_path / "a.mcap"
    with BagWriter(path, chunk_bytes=1 << 30, chunk_period_s=1e6) as writer:
        write_chunks(writer, 0, 20)
        writer.write("/cam0/keyframe", scene(20)["/cam0/keyframe"])
    data = path.read_bytes()
    with path.open("rb") as file:
        found = make_reader(file).get_summary()
    assert len(found.chunk_indexes) == found.statistics.chunk_count == 21
    counts = {channel: 0 for channel in found.channels}
    for index in found.chunk_indexes:
        at = index.chunk_start_offset
        assert data[at] == Opcode.CHUNK
        assert int.from_bytes(data[at + 1 : at + 9], "little") + 9 == index.chunk_length
        at += index.chunk_length
        for channel, offset in index.message_index_offsets.items():
            assert offset == at and data[at] == Opcode.MESSAGE_INDEX
            assert int.from_bytes(data[at + 9 : at + 11], "little") == channel
            counts[channel] += int.from_bytes(data[at + 11 : at + 15], "little") // 16
            at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        assert at == index.chunk_start_offset + index.chunk_length + index.message_index_length
    assert counts == found.statistics.channel_message_counts
    with path.open("rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages())
    assert len(messages) == sum(counts.values()) == found.statistics.message_count
    assert max(m.log_time for _, _, m in messages) == found.statistics.message_end_time
