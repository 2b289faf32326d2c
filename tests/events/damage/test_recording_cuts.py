"""Files cut anywhere: all events before the cut, and it is said that the file is cut."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from file_cases import event_packet, mono, save, small_events
from small_files import CASES, EVENTS, ros1_bag

from evis.events import Events, RecordingError, open_recording

RECORD = {"dat": 8, "aedat2": 8, "nmnist": 5}
"""Formats whose number of events before a cut is a division."""


ENDED = {"aedat4", "aedat4 lz4", "aedat4 zstd", "npz", "npz packed", "zip", "text gzip"}
"""Formats that tell where they end, so that nothing is missing."""
SILENT = {"dat": 91, "nmnist": 91, "aedat2": 170, "es": 200, "text": 180, "csv": 180, "raw evt21": 91, "raw evt4": 172}
"""Cuts of a prefix that nobody can tell from an end: between records, lines, or lines of an AEDAT 2 header."""


@pytest.mark.parametrize("name", CASES)
def test_every_prefix(name, tmp_path):
    """The events of a prefix are the first ones of all, never fewer than those of a shorter prefix; the whole has all.

    A prefix that is not the whole says that it is cut, unless it ends exactly between two of the format's units.
    """
    make, suffix = CASES[name]
    data = make(tmp_path)
    most = silent = 0
    cuts = sorted({*range(1, len(data), max(len(data) // 160, 1)), *range(len(data) - 20, len(data) + 1)})
    for cut in cuts:
        try:
            with open_recording(save(tmp_path / f"a{suffix}", data[:cut]), size=(34, 34)) as recording:
                events = recording.read()
                info = recording.info
        except RecordingError as error:
            assert f"a{suffix}" in str(error) and "\n" not in str(error)
            assert most == 0, f"{cut}: {error}"
            continue
        n = len(events)
        for column in "txyp":
            np.testing.assert_array_equal(getattr(events, column), getattr(EVENTS, column)[:n], err_msg=f"cut {cut}")
        assert n >= most, f"cut {cut} of {len(data)}"
        if name in RECORD and most:
            start = len(data) - RECORD[name] * 90
            assert n == (cut - start) // RECORD[name]
        most = max(most, n)
        silent += not info.truncated and n < 90
    assert most == 90
    assert silent <= SILENT.get(name, 12)


@pytest.mark.parametrize("name", CASES)
def test_pages_that_were_never_written_hold_no_event(name, tmp_path):
    """After a loss of power a file ends with zeros: no events of pixel (0, 0); what lies before is read."""
    make, suffix = CASES[name]
    with open_recording(save(tmp_path / f"a{suffix}", make(tmp_path) + bytes(9000)), size=(34, 34)) as recording:
        events = recording.read()
        told = recording.info.truncated or recording.info.warnings or recording.counters()
    for column in "txyp":
        np.testing.assert_array_equal(getattr(events, column), getattr(EVENTS, column))
    assert told or name in ENDED


def test_a_cut_message_gives_its_first_events(tmp_path):
    """Half a message of an uncompressed ROS 1 bag is half its events."""
    data = ros1_bag()(tmp_path)
    last = data.rindex(struct.pack("<HH", int(EVENTS.x[75]), int(EVENTS.y[75])))
    with open_recording(save(tmp_path / "a.bag", data[:last])) as recording:
        assert len(recording.read()) == 75 and recording.info.truncated


def test_db3_cut_at_every_page(tmp_path):
    """SQLite: the rows on the pages that are left."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    text = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    store.register(
        get_types_from_msg(text + "bool is_bigendian\nuint8[] events\n", "event_camera_msgs/msg/EventPacket")
    )
    parts = [small_events(60, seed=i) for i in range(20)]
    with rosbag2.Writer(tmp_path / "bag", version=8) as writer:
        connection = writer.add_connection("/e", "event_camera_msgs/msg/EventPacket", typestore=store)
        for i, part in enumerate(parts):
            writer.write(connection, 1000 + i, event_packet("mono", mono(part, 1000), 34, 34, i, 1000, True))
    (path,) = (tmp_path / "bag").glob("*.db3")
    data, whole = path.read_bytes(), Events.concatenate(parts)
    with open_recording(tmp_path / "bag") as recording:  # ROS 2 names a bag by its folder
        np.testing.assert_array_equal(recording.read().t, whole.t)
    page, most = int.from_bytes(data[16:18], "big"), 0
    for cut in range(page, len(data), page):
        try:
            with open_recording(save(tmp_path / "a.db3", data[:cut])) as recording:
                events = recording.read()
                assert recording.info.truncated
        except RecordingError as error:
            assert "cut" in str(error) and most == 0
            continue
        np.testing.assert_array_equal(events.t, whole.t[: len(events)])
        assert len(events) >= most
        most = len(events)
    assert most > 60
