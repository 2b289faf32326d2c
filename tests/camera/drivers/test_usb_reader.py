"""The reader thread and what is made of its chunks: overflow, gaps, the turn of the counter, the clocks."""

from __future__ import annotations

import errno
import itertools
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import usb.core

from evis.events import Events
from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.encoder import encoder_for
from nodes.camera.usb import reader as reader_module
from nodes.camera.usb import stream as stream_module
from nodes.camera.usb.access import StreamEnd
from nodes.camera.usb.clock import ClockMap
from nodes.camera.usb.reader import Reader
from nodes.camera.usb.stream import PacketRule, ReadingStream

MS = 1_000_000


class Source:
    """Gives numbered blocks, as many as `allow` lets it; then the end."""

    def __init__(self, blocks: list[bytes]) -> None:
        self.blocks, self.gate, self.taken = blocks, threading.Semaphore(0), 0
        self.done = threading.Event()

    def read(self, buffer, timeout_ms: int) -> int:
        self.gate.acquire()
        if self.taken == len(self.blocks):
            self.done.set()
            raise StreamEnd("over")
        block = self.blocks[self.taken]
        self.taken += 1
        memoryview(buffer)[: len(block)] = block
        return len(block)

    def allow(self, count: int) -> None:
        for _ in range(count):
            self.gate.release()


def all_chunks(reader: Reader) -> list:
    chunks = []
    with pytest.raises(StreamEnd):
        while True:
            chunk = reader.get(60.0)
            assert chunk is not None
            chunks.append((bytes(chunk.data), chunk.lost, chunk.gap))
            reader.give_back(chunk)
    reader.close()
    return chunks


def test_every_byte_arrives_or_is_counted():
    """Four buffers, nobody takes: blocks 5 to 10 are thrown away, counted, and the next good one says so."""
    source = Source([bytes([k]) * 1000 for k in range(20)])
    reader = Reader(source.read, lambda: None, 4, 1000)
    reader.start()
    source.allow(10)
    while source.taken < 10:
        pass
    first = reader.get(60.0)  # one buffer is free again
    assert first is not None and bytes(first.data) == bytes(1000)
    source.gate.acquire(blocking=False)
    reader.give_back(first)
    source.allow(11)
    chunks = all_chunks(reader)
    got = [c[0][0] for c in chunks]
    lost = sum(c[1] for c in chunks)
    assert got == sorted(got) and {len(c[0]) for c in chunks} == {1000}
    # what is thrown away at the very end has no chunk after it that could say so; the counter has it
    assert 1000 * (len(got) + 1) + reader.counts["bytes_lost"] == 20_000
    assert (
        lost <= reader.counts["bytes_lost"]
        and reader.counts["buffers_overflowed"] * 1000 == reader.counts["bytes_lost"]
    )
    after = next(c for c in chunks if c[1])
    assert after[2] and after[1] >= 6000


def test_a_source_that_can_wait_loses_nothing():
    """With wait_when_full nothing is read while all buffers are full."""
    source = Source([bytes([k]) * 1000 for k in range(50)])
    reader = Reader(source.read, lambda: None, 4, 1000, wait_when_full=True)
    reader.start()
    source.allow(60)
    chunks = all_chunks(reader)
    assert [c[0][0] for c in chunks] == list(range(50)) and not reader.counts


def test_many_short_reads_do_not_use_up_the_buffers():
    """2000 reads of 10 bytes wait in a reader of four buffers of 10 kB without loss."""
    source = Source([(k % 251).to_bytes(1, "little") * 10 for k in range(2000)])
    reader = Reader(source.read, lambda: None, 4, 10_000)
    reader.start()
    source.allow(2001)
    assert source.done.wait(60)
    chunks = all_chunks(reader)
    assert len(chunks) == 2000 and [c[0][0] for c in chunks] == [k % 251 for k in range(2000)]


def test_short_reads_that_wait_come_together():
    """Up to an eighth of a buffer, and not beyond a read behind which something is missing, nor past a full one."""
    sizes = [100] * 12 + [5000] + [100] * 5
    source = Source([bytes([k]) * size for k, size in enumerate(sizes)])
    stalled = 4

    def read(buffer, timeout_ms):
        if source.taken == stalled and not reader.counts:
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        return source.read(buffer, timeout_ms)

    reader = Reader(read, lambda: None, 4, 8000)
    source.allow(len(sizes) + 1)
    reader.start()
    assert source.done.wait(60)
    got = []
    for _ in range(4):
        chunk = reader.get(60.0, joined=True)
        got.append((bytes(chunk.data), chunk.gap))
        reader.give_back(chunk)
    assert [(sorted(set(data)), gap) for data, gap in got] == [
        ([0, 1, 2, 3], False), (list(range(4, 12)), True), ([12], False), (list(range(13, 18)), False)
    ]  # fmt: skip
    assert b"".join(data for data, _ in got) == b"".join(source.blocks)
    reader.close()


def stream_of(blocks: list[bytes], encoding: str, overflow_before: set[int]) -> list:
    """Readings of a stream some of whose blocks are marked as following a loss."""

    class Marked(Reader):
        def get(self, timeout_s, joined=False):
            chunk = super().get(timeout_s)  # one block each, so that `count` counts these
            if chunk is not None and self.count in overflow_before:
                chunk.lost, chunk.gap = 77, True
            self.count += chunk is not None
            return chunk

    source = Source(blocks)
    reader = Marked(source.read, lambda: None, 64, 1 << 16, wait_when_full=True)
    reader.count = 0
    stream = ReadingStream(reader, decoder_for(encoding), PacketRule(10 * MS))
    reader.start()
    source.allow(len(blocks) + 1)
    readings = []
    while not stream.ended:
        reading = stream.read(1.0)
        readings += [reading] if reading is not None else []
    reader.close()
    return readings


@pytest.mark.parametrize("encoding", ["evt3", "evt2", "davis346", "dvs128"])
def test_times_go_on_after_a_gap(encoding):
    """Blocks 4 and 5 of 20 are lost: the rest keep their times (EVT3 in its second turn of 16.8 s), the loss is marked.

    The iniVation wires count wraps, so time lost in a gap is found again only where the host's clock runs along; here
    the gap is shorter than half a wrap.
    """
    start = 17_000_000_000 if encoding.startswith("evt") else 200_000_000
    step = 10 * MS if encoding.startswith("evt") else 3 * MS // 2
    t = start + np.arange(2000) * (step // 100)
    sent = Events.of(t // 1000 * 1000, np.arange(2000) % 100, np.arange(2000) % 90, np.arange(2000) % 2)
    encoder = encoder_for(encoding)
    first = encoder.encode(Events.of([1_000_000], [1], [1], [1]))
    blocks = [first] + [encoder.encode(sent[100 * k : 100 * k + 100]) for k in range(20)]
    kept = blocks[:5] + blocks[7:]
    readings = stream_of(kept, encoding, {5})
    got = np.concatenate([r.events.t for r in readings])[1:]
    missing = set(sent.t.tolist()) - set(got.tolist())
    assert set(got.tolist()) <= set(sent.t.tolist())
    # two blocks are gone; the decoder waits for the next time word, at most one TIME_HIGH period (4.1 ms) of EVT3
    assert 200 <= len(missing) <= 200 + 60
    assert [r.lost for r in readings if r.lost] == [77]


def test_clock_offset_and_drift():
    """Device 40 ppm slow, delays of 0.1 to 3 ms: drift within 2 ppm, offset within 0.05 ms of the least delay."""
    rng = np.random.default_rng(3)
    clock = ClockMap()
    for k in range(30_000):
        device = k * MS
        host = 5_000_000_000 + round(device * (1 + 40e-6)) + 100_000 + round(float(rng.exponential(0.4e6)))
        clock.add(host, device)
    assert abs(clock.drift_ppm - 40) < 2
    newest = 30_000 * MS
    true_offset = 5_000_000_000 + round(newest * 40e-6) + 100_000
    assert abs(clock.offset_ns - true_offset) < 50_000
    assert abs(clock.to_device(newest + true_offset) - newest) < 50_000


def test_no_drift_is_stated_too_early():
    """Two seconds do not tell a drift from a delay."""
    clock = ClockMap()
    assert not clock.known and clock.offset_ns == 0
    for k in range(200):
        clock.add(10**9 + k * 10 * MS + (k % 7) * 100_000, k * 10 * MS)
    assert clock.known and clock.drift_ppm == 0 and clock.offset_ns == 10**9


def test_a_quiet_interval_is_closed_by_the_hosts_clock(monkeypatch):
    """One burst and then silence: its packet comes within a moment and not with the next burst; empty ones follow.

    The host's clock goes on by 1 ms whenever somebody looks at it.
    """
    ticks = itertools.count(5_000_000_000, MS)
    clock = SimpleNamespace(monotonic=lambda: next(ticks) / 1e9, monotonic_ns=lambda: next(ticks))
    for module in (reader_module, stream_module):
        monkeypatch.setattr(module, "time", clock)
    source = Source([encoder_for("evt3").encode(Events.of([3 * MS, 4 * MS], [1, 2], [1, 2], [1, 0]))])
    reader = Reader(source.read, lambda: None, 4, 1 << 16)
    stream = ReadingStream(reader, decoder_for("evt3"), PacketRule(10 * MS, live=True))
    reader.start()
    source.allow(1)
    readings = []
    while len(readings) < 3:
        reading = stream.read(0.01)
        readings += [reading] if reading is not None else []
    source.allow(1)
    reader.close()
    assert readings[0].events.t.tolist() == [3 * MS, 4 * MS]
    assert [(r.t0_ns // MS, r.stamp_ns // MS) for r in readings] == [(0, 10), (10, 20), (20, 30)]
    assert all(not len(r.events) for r in readings[1:])
