"""Payloads of event_camera_msgs: real bags, and words written by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from stream_cases import sha256_us

from evis.events import Events
from evis.events.codecs.decoder import decoder_for

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])


@BOTH
def test_evt3_messages_of_a_real_bag(backend, truth, recording_path):
    """517 messages through one decoder that keeps its state: the recording's published sums."""
    rosbags = pytest.importorskip("rosbags.highlevel")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    name = "ros/event_camera_py_test_events_1.bag"
    known = truth[name]
    store = get_typestore(Stores.ROS1_NOETIC)
    fields = "std_msgs/Header header\nuint32 height\nuint32 width\nuint64 seq\nuint64 time_base\nstring encoding\n"
    definition = fields + "bool is_bigendian\nuint8[] events\n"
    store.register(get_types_from_msg(definition, "event_camera_msgs/msg/EventPacket"))
    decoder = decoder_for("evt3", 640, 480, backend)
    parts = []
    with rosbags.AnyReader([recording_path(name)], default_typestore=store) as bag:
        for connection, _, raw in bag.messages():
            packet = bag.deserialize(raw, connection.msgtype)
            parts.append(decoder.decode_packet(packet.events.tobytes(), packet.time_base))
    events = Events.concatenate(parts)
    assert (len(parts), len(events), sha256_us(events)) == (known["messages"], known["n"], known["sha256"])
    assert int((events.triggers.t // 1000).sum()) == known["sum_t_triggers"]


def test_mono_messages_of_a_real_bag(truth, recording_path):
    """The recording's published sums, times in ns."""
    import sqlite3

    name = "ros/codecs_mono_cd_0.db3"
    known, decoder, parts = truth[name], decoder_for("mono", 640, 480), []
    database = sqlite3.connect(f"file:{recording_path(name)}?mode=ro&immutable=1", uri=True)
    for (raw,) in database.execute("select data from messages order by timestamp"):
        # CDR: the header's text is 4-aligned, the 8-byte fields from the first byte after the encapsulation on
        text = struct.unpack_from("<I", raw, 12)[0]
        at = 16 + text + -text % 4 + 8
        at += -(at - 4) % 8
        base, size = struct.unpack_from("<Q", raw, at + 8)[0], struct.unpack_from("<I", raw, at + 16)[0]
        assert raw[at + 20 : at + 20 + size] == b"mono\0"
        at += 20 + size + 1
        at += -(at - 4) % 4
        length = struct.unpack_from("<I", raw, at)[0]
        parts.append(decoder.decode_packet(raw[at + 4 : at + 4 + length], base))
    events = Events.concatenate(parts)
    sums = [int(getattr(events, k).sum(dtype=np.int64)) for k in "txyp"]
    assert (len(parts), len(events)) == (known["messages"], known["n"])
    assert sums == [known["sum_t"], known["sum_x"], known["sum_y"], known["n_on"]]


def test_libcaer_turns_and_invalid_events():
    """Times fall by half their range: a turn. They step back a little: kept. Invalid events are dropped and counted."""
    us = [0x7FFFFFF0, 0x7FFFFFFF, 5, 3, 9]
    head = [1 | 2 | 7 << 2 | 9 << 17] * 4 + [2]
    data = b"".join(struct.pack("<Ii", h, t) for h, t in zip(head, us))
    decoder = decoder_for("libcaer", 640, 480)
    base = 1_700_000_000_000_000_123
    events = decoder.decode_packet(data, base)
    expected = [0x7FFFFFF0, 0x7FFFFFFF, (1 << 31) + 5, (1 << 31) + 3]
    assert events.t.tolist() == [base + 1000 * t for t in expected]
    assert (set(events.x.tolist()), set(events.y.tolist()), set(events.p.tolist())) == ({9}, {7}, {1})
    assert decoder.counts == {"invalid": 1}
    # the next message starts anew
    assert decoder.decode_packet(data[:8], base).t.tolist() == [base + 1000 * 0x7FFFFFF0]


@BOTH
def test_libcaer_cmp_words(backend):
    """Vectors move their base by 8; the base of the times counts in whole us; x stays until the next one."""
    words = [0x0001, 0x1002, 0x2005, 0x3807, 0x4864, 0x5081, 0x5001, 0x6000, 0x2006, 0x3001]
    decoder = decoder_for("libcaer_cmp", 640, 480, backend)
    events = decoder.decode_packet(np.array(words, "<u2").tobytes(), 5_999)
    assert events.t.tolist() == [(5 + 4096 + 2) * 1000] * 5
    assert (events.x.tolist(), events.y.tolist()) == ([5, 5, 5, 5, 6], [7, 100, 107, 108, 1])
    assert events.p.tolist() == [1, 1, 1, 1, 0]
    assert decoder.counts == {"unknown": 1}


@pytest.mark.parametrize("encoding", ["libcaer", "libcaer_cmp", "mono", "trigger"])
def test_messages_stand_alone(encoding):
    """Half a word at the end of one does not shift the next; what is left must be decoded first; bases are checked."""
    decoder = decoder_for(encoding, 640, 480)
    whole = bytes(range(16)) * 3
    expected = decoder.decode_packet(whole, 5)
    decoder.decode_packet(whole[:-1], 5)
    again = decoder.decode_packet(whole, 5)
    np.testing.assert_array_equal(again.t, expected.t)
    assert decoder.counts["cut_words"] == 1
    with pytest.raises(ValueError, match="time base"):
        decoder.feed_packet(whole, -1)
    with pytest.raises(ValueError, match="time base"):
        decoder.feed_packet(whole, 1 << 63)
    decoder.feed_packet(b"\x00\x30\x81\xff" * 8, 1_000_000)
    decoder.decode_until(0)
    with pytest.raises(ValueError, match="rest of a message"):
        decoder.feed_packet(whole, 5)
