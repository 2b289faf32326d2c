"""Packets that are decoded in place, and that grow when the host falls behind: no event is lost, doubled or moved."""

from __future__ import annotations

import itertools
import threading
import time

import numpy as np
import pytest

from evis.events import Events
from evis.events.codecs.buffer import EventBuffer, plain
from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.encoder import encoder_for
from nodes.camera.usb import stream as stream_module
from nodes.camera.usb.access import StreamEnd
from nodes.camera.usb.reader import Reader
from nodes.camera.usb.stream import PacketRule, ReadingStream

MS = 1_000_000


def sorted_events(n: int, end_ns: int, start_ns: int = 0) -> Events:
    """Random events on 100 x 90 px in whole us of (start_ns, end_ns], in an order that every wire can send."""
    rng = np.random.default_rng(8)
    t = start_ns + np.sort(rng.integers(1, (end_ns - start_ns) // 1000, n)) * 1000
    return Events.of(t, rng.integers(0, 100, n), rng.integers(0, 90, n), rng.integers(0, 2, n))


def joined(parts: list[Events]) -> list[list[int]]:
    return [np.concatenate([getattr(e, name) for e in parts]).tolist() for name in "txyp"]


def columns(events: Events) -> list[list[int]]:
    return [getattr(events, name).tolist() for name in "txyp"]


@pytest.mark.parametrize("backend", ["numpy", "warp"])
@pytest.mark.parametrize("encoding", ["evt3", "evt2", "evt21", "davis346", "dvs128"])
@pytest.mark.parametrize("size", [999, 1 << 17])
def test_decoded_in_place(encoding, backend, size):
    """One buffer per ms that begins too small: each holds what was sent in that ms, whatever memory it grew into."""
    sent = sorted_events(20_000, 10 * MS)
    data = encoder_for(encoding).encode(sent)
    decoder = decoder_for(encoding, 0, 0, backend)
    decoder.prepare()
    given: list = []

    def allocate(n: int):
        given.append(plain(n))
        for column in given[-1]:
            column[:] = 99
        return given[-1]

    buffers, cut = [EventBuffer(0, allocate)], MS
    for at in range(0, len(data), size):
        decoder.feed(data[at : at + size])
        decoder.decode_into(buffers[-1], cut)
        while decoder.at_cut:
            cut += MS
            buffers.append(EventBuffer(0, allocate))
            decoder.decode_into(buffers[-1], cut)
    assert joined([b.events() for b in buffers]) == columns(sent)
    for k, buffer in enumerate(buffers):
        t = buffer.events().t
        assert len(t) == np.count_nonzero((sent.t > k * MS) & (sent.t <= (k + 1) * MS))
    assert len(given) > len(buffers)  # they did grow


@pytest.mark.parametrize("encoding", ["evt3", "dvxplorer", "dvxplorer_mini"])
def test_preparing_changes_nothing(encoding):
    """What is decoded by a prepared decoder is what the reference decodes."""
    sent = sorted_events(2000, 10 * MS)
    data = encoder_for(encoding).encode(sent)
    prepared, reference = decoder_for(encoding, 0, 0, "warp"), decoder_for(encoding, 0, 0, "numpy")
    prepared.prepare()
    assert columns(prepared.decode(data)) == columns(reference.decode(data))
    assert prepared.counts == reference.counts and prepared.state.tolist() == reference.state.tolist()


class Burst:
    """A source that has everything at once, then nothing until `finish`, then the end."""

    def __init__(self, blocks: list[bytes]) -> None:
        self.blocks, self.given, self.over = blocks, threading.Event(), threading.Event()

    def read(self, buffer, timeout_ms: int) -> int:
        if self.blocks:
            block = self.blocks.pop(0)
            memoryview(buffer)[: len(block)] = block
            return len(block)
        self.given.set()
        self.over.wait(60)
        raise StreamEnd("over")


def readings_of(sent: Events, packet_ns: int, longest_ns: int, live: bool) -> tuple[list, ReadingStream]:
    """A stream whose bytes have all waited in the reader, for longer than any packet."""
    data = encoder_for("evt3").encode(sent)
    source = Burst([data[at : at + 4096] for at in range(0, len(data), 4096)])
    reader = Reader(source.read, lambda: None, 256, 4096)
    stream = ReadingStream(reader, decoder_for("evt3"), PacketRule(packet_ns, longest_ns, live))
    reader.start()
    assert source.given.wait(60)
    time.sleep(packet_ns / 1e9)
    source.over.set()
    readings = []
    while not stream.ended:
        reading = stream.read(1.0)
        readings += [reading] if reading is not None else []
    reader.close()
    return readings, stream


def check(readings: list, sent: Events, packet_ns: int) -> list[int]:
    """Everything arrived, in intervals that follow one another; their lengths in packets."""
    assert joined([r.events for r in readings]) == columns(sent)
    for before, after in itertools.pairwise(readings):
        assert after.t0_ns == before.stamp_ns
    for r in readings:
        assert not len(r.events) or (r.t0_ns < r.events.t[0] and r.events.t[-1] <= r.stamp_ns)
    lengths = [(r.stamp_ns - r.t0_ns) / packet_ns for r in readings]
    assert all(length == int(length) for length in lengths)
    return [int(length) for length in lengths]


def test_packets_grow_when_the_host_is_behind():
    """60 ms that waited come in packets of 5 ms, not 1 ms, until the reader is empty; the counter says how many."""
    sent = sorted_events(40_000, 60 * MS)
    readings, stream = readings_of(sent, MS, 5 * MS, True)
    lengths = check(readings, sent, MS)
    assert max(lengths) == 5 and lengths[0] == 5 and sum(lengths) == 60
    assert stream.counts["intervals_joined"] == sum(lengths) - len(lengths)
    assert not any(r.lost for r in readings)


@pytest.mark.parametrize(("longest_ns", "live"), [(MS, True), (5 * MS, False)])
def test_packets_that_must_not_grow(longest_ns, live):
    """As long as asked for, where longest says so and for a source that waits."""
    sent = sorted_events(40_000, 60 * MS)
    readings, stream = readings_of(sent, MS, longest_ns, live)
    assert check(readings, sent, MS) == [1] * 60 and not stream.counts


def test_growing_packets_stay_within_their_room(monkeypatch):
    """2000 events per ms and room for 5000: two intervals fit, a third does not."""
    monkeypatch.setattr(stream_module, "ROOMY_EVENTS", 5000)
    sent = sorted_events(120_000, 60 * MS)
    readings, _ = readings_of(sent, MS, 50 * MS, True)
    lengths = check(readings, sent, MS)
    assert max(lengths) == 2


@pytest.mark.parametrize("backend", ["numpy", "warp"])
def test_arrays_come_from_whom_was_asked(backend):
    """Readings are views of the arrays that were handed out: nothing is copied after decoding."""
    sent = sorted_events(3000, 10 * MS)
    source = Burst([encoder_for("evt3").encode(sent)])
    reader = Reader(source.read, lambda: None, 4, 1 << 16)
    given: list = []

    def allocate(n: int):
        given.append(plain(n))
        return given[-1]

    stream = ReadingStream(reader, decoder_for("evt3", 0, 0, backend), PacketRule(10 * MS), allocate)
    reader.start()
    source.over.set()
    reading = stream.read(60.0)
    reader.close()
    assert reading is not None and columns(reading.events) == columns(sent)
    last = given[-1]
    assert all(np.shares_memory(a, b) for a, b in zip(last, (getattr(reading.events, n) for n in "txyp")))


def test_a_step_back_over_a_cut_is_kept_and_counted():
    """9.999 ms after 10.002 ms: it stays where it came, in the second packet, and is counted there."""
    sent = Events.of([9_000_000, 10_002_000, 9_999_000, 10_005_000], [1, 2, 3, 4], [5, 6, 7, 8], [0, 1, 0, 1])
    source = Burst([encoder_for("evt3").encode(sent)])
    reader = Reader(source.read, lambda: None, 4, 1 << 16)
    stream = ReadingStream(reader, decoder_for("evt3"), PacketRule(10 * MS))
    reader.start()
    source.over.set()
    readings = []
    while not stream.ended:
        readings += [r for r in [stream.read(1.0)] if r is not None]
    reader.close()
    assert [r.events.t.tolist() for r in readings] == [[9_000_000], [10_002_000, 9_999_000, 10_005_000]]
    assert stream.counts == {"events_stepped_back": 1}
