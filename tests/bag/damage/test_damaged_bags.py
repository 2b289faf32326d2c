"""Flipped bits and false types in bags: what can be read is, the rest is counted, or there is one BagError."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from limited import refused_by
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from evis.bag import BagError
from evis.bag.info import describe
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket
from msgs.header import Header


def bag(path):
    """Twelve packets of events, in chunks of their own."""
    with BagWriter(path) as writer:
        for k in range(12):
            t = np.arange(40, dtype=np.int64) * 1000 + k * 50_000
            x, p = np.arange(40, dtype=np.uint16), np.ones(40, np.uint8)
            offsets = np.array([0, 40], np.int64)
            packet = EventPacket(Header(k * 50_000, k, "sim"), offsets, t=t, x=x, y=x, p=p, width=64, height=64)
            writer.write("/cam0/events", packet)
    return path.read_bytes()


def test_flipped_bits(tmp_path):
    """Anywhere in the file."""
    data = bag(tmp_path / "whole.mcap")
    path = tmp_path / "a.mcap"
    read = 0
    for seed in range(80):
        rng = np.random.default_rng(seed)
        broken = bytearray(data)
        broken[int(rng.integers(0, len(data)))] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(broken)
        try:
            describe(path)
            with BagReader(path) as reader:
                read += sum(1 for _ in reader.messages())
        except BagError as error:
            assert "\n" not in str(error)
    assert read > 80  # most flips cost no more than a message


@pytest.mark.parametrize("counted", [5, [1], "many", {"events": "x", "t_first_ns": [], "t_last_ns": None}])
def test_false_types(counted, tmp_path, monkeypatch):
    """A closing text whose counts are no counts is a damaged message, not a mistake of the program."""
    from evis.bag.ros import events

    monkeypatch.setattr(events, "summary", lambda packet: counted)
    bag(tmp_path / "a.mcap")
    monkeypatch.undo()
    about = describe(tmp_path / "a.mcap")
    assert not about["complete"] and "damaged" in about["problem"]
    json.dumps(about)


def zeros(path, count, size, log_time):
    """A bag of `count` chunks, each a few kB that unpack to `size` bytes of a picture."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1, compression=CompressionType.ZSTD, use_statistics=False)
        writer.start()
        schema = writer.register_schema("sensor_msgs/msg/Image", "ros2msg", b"")
        channel = writer.register_channel("/cam0/image", "cdr", schema)
        for k in range(count):
            writer.add_message(channel, log_time(k), bytes(size), log_time(k))
        writer.finish()


WAITED = (
    "import sys; from evis.bag.reader import BagReader; reader = BagReader(sys.argv[1]); "
    "raise ValueError(f'{sum(1 for _ in reader.messages())} {reader.skipped}')"
)


def test_chunks_that_wait_for_one_another_are_not_all_held(tmp_path):
    """Each may be unpacked alone; a later one that begins earlier kept all of them in memory."""
    path = tmp_path / "a.mcap"
    zeros(path, 12, 100 << 20, lambda k: 12 - k)
    assert path.stat().st_size < 1 << 20
    told = refused_by(WAITED, path, memory=2_000_000_000)
    assert "its chunks overlap in time and are held at once" in told and "EVIS_UNPACK_LIMIT" in told
    zeros(path, 12, 100 << 20, lambda k: k)
    assert refused_by(WAITED, path, memory=2_000_000_000) == "0 12"  # pictures of no size, one after another


def test_an_index_that_names_a_chunk_many_times(tmp_path):
    """It is read once: a file of kilobytes could ask for hours."""
    data = bag(tmp_path / "a.mcap")
    with BagReader(tmp_path / "a.mcap") as reader:
        want = sum(1 for _ in reader.messages())
    start = int.from_bytes(data[-28:-20], "little")
    summary, index = data[start:-37], b""
    at = 0
    while at < len(summary):
        length = 9 + int.from_bytes(summary[at + 1 : at + 9], "little")
        index += summary[at : at + length] if summary[at] in (Opcode.CHUNK_INDEX, Opcode.METADATA_INDEX) else b""
        at += length
    assert index
    tail = bytearray(data[-37:])
    tail[25:29] = bytes(4)  # no checksum
    (tmp_path / "a.mcap").write_bytes(data[:start] + summary + 100 * index + tail)
    with BagReader(tmp_path / "a.mcap") as reader:
        assert len(reader.scanner.layout.chunks) == len({c.at for c in reader.scanner.layout.chunks})
        assert sum(1 for _ in reader.messages()) == want


def test_a_pipe_is_no_bag(tmp_path):
    """One that nobody writes to was waited for."""
    os.mkfifo(tmp_path / "a.mcap")
    code = "import sys; from evis.bag.reader import BagReader; BagReader(sys.argv[1])"
    assert "a.mcap is no file" in refused_by(code, tmp_path / "a.mcap")
    with pytest.raises(BagError, match="is no file"):
        BagReader("/dev/zero")
