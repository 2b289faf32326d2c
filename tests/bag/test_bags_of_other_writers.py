"""Bags of the MCAP library's writer: every part of the summary that the specification lets a writer leave out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader
from mcap.writer import IndexType, Writer

import evis
from evis.bag.info import describe
from evis.bag.mcap import scan
from evis.bag.reader import BagReader
from evis.bag.ros import messages as ros
from evis.bag.ros import schemas

PACKETS, EVENTS = 20, 100


def write(path: Path, **left_out: Any) -> np.ndarray:
    """Writes packets of event_camera_msgs, a few to a chunk; returns the times of all events [ns]."""
    times = []
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=2000, **left_out)
        writer.start(profile="ros2", library="another recorder")
        definition = schemas.DEFINITIONS[schemas.EVENT_PACKET].encode()
        channel = writer.register_channel(
            "/camera/events", "cdr", writer.register_schema(schemas.EVENT_PACKET, "ros2msg", definition)
        )
        for k in range(PACKETS):
            base = 10**9 + k * 10**7
            words = np.arange(EVENTS, dtype="<u8") * 1000 | np.uint64(5 << 32 | 6 << 48 | 1 << 63)  # x 5, y 6, ON
            packet = ros.RosEvents(base, 64, 64, k, base, "mono", words.view(np.uint8).data)
            writer.add_message(channel, base, b"".join(map(bytes, ros.event_packet(packet, "camera"))), base, k)
            times.append(base + np.arange(EVENTS) * 1000)
        writer.finish()
    return np.concatenate(times)


SUMMARIES: dict[str, dict[str, Any]] = {
    "whole": {},
    "no_channels": {"repeat_channels": False},
    "no_schemas": {"repeat_schemas": False},
    "neither": {"repeat_channels": False, "repeat_schemas": False},
    "neither_nor_statistics": {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
    "no_index": {"index_types": IndexType.NONE},
    "no_index_nor_statistics": {"index_types": IndexType.NONE, "use_statistics": False},
    "no_chunks": {"use_chunking": False},
    "no_chunks_nor_statistics": {"use_chunking": False, "use_statistics": False},
    "nothing": {
        "repeat_channels": False, "repeat_schemas": False, "use_statistics": False, "index_types": IndexType.NONE,
        "use_summary_offsets": False,
    },
}  # fmt: skip


@pytest.mark.parametrize("left_out", SUMMARIES.values(), ids=SUMMARIES)
def test_a_summary_may_leave_out_any_part(left_out: dict[str, Any], tmp_path: Path) -> None:
    """Such a bag was taken for one without topics or messages, or for a torn one, and nothing was said."""
    path = tmp_path / "a.mcap"
    times = write(path, **left_out)
    with path.open("rb") as file:  # by the library, which does not read the summary then
        assert sum(1 for _ in NonSeekingReader(file).iter_messages()) == PACKETS
    with BagReader(path) as reader:
        assert np.concatenate([packet.t for _, packet in reader.messages()]).tolist() == times.tolist()
        assert (reader.problem, reader.skipped) == ("", 0)
    assert evis.open(path).numpy()["t"].tolist() == times.tolist()
    about = describe(path)
    assert about["complete"] and about["topics"]["/camera/events"]["events"] == len(times)


def test_an_index_without_one_of_the_chunks(tmp_path: Path) -> None:
    """Its summary has no checksum: the chunk's messages were missing, and nothing was said."""
    path = tmp_path / "a.mcap"
    times = write(path, enable_crcs=False)
    data = bytearray(path.read_bytes())
    at, entries = int.from_bytes(data[-28:-20], "little"), []
    while at < len(data) - 8:
        entries += [at] if data[at] == Opcode.CHUNK_INDEX else []
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    data[entries[2]] = 0x88  # a record of a kind that is not known is passed over
    path.write_bytes(data)
    with BagReader(path) as reader:
        assert sum(len(packet.t) for _, packet in reader.messages()) == len(times)
        assert reader.problem == "its index is missing or damaged"


def test_a_file_without_chunks_is_read_by_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was read as one, of 2 GB at most: of a larger file there was nothing."""
    path = tmp_path / "a.mcap"
    times = write(path, use_chunking=False)
    monkeypatch.setattr(scan, "_MOST_OF_RUN", 3000)
    monkeypatch.setattr(scan, "MAX_CHUNK", 3000)
    with BagReader(path) as reader:
        assert [packet.t.tolist() for _, packet in reader.messages()] == times.reshape(PACKETS, EVENTS).tolist()
        assert reader.skipped == 0


def test_tables_of_metadata_that_the_summary_does_not_name(tmp_path: Path) -> None:
    """The launch file and the seed of a bag that another tool had written anew were not found."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, index_types=IndexType.ALL & ~IndexType.METADATA)
        writer.start(library="another tool")
        writer.add_metadata("evis", {"seed": "7"})
        writer.finish()
    with BagReader(path) as reader:
        assert reader.metadata == {"evis": {"seed": "7"}} and not reader.problem
