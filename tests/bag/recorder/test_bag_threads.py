"""Bags whose messages are encoded and compressed by several threads."""

import math
import threading
import time
import zlib

import numpy as np
import pytest
from bag_messages import copied, same, scene
from mcap.reader import make_reader

from evis.bag import BagError
from evis.bag.mcap import packing
from evis.bag.mcap.checksum import BLOCK, crc32
from evis.bag.reader import BagReader
from evis.bag.ros import messages as ros
from evis.bag.threads import Threads
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket
from msgs.header import Header


def packet(k, count, envs=1):
    """Many events in the order of time, as little alike as events of a textured scene are."""
    rng = np.random.default_rng([k, count])
    t0 = k * 33_333_333
    t = np.sort(rng.integers(t0 + 1, t0 + 33_333_333, count))
    x, y = rng.integers(0, 640, count, np.uint16), rng.integers(0, 480, count, np.uint16)
    offsets = np.linspace(0, count, envs + 1).astype(np.int64)
    p = rng.integers(0, 2, count, np.uint8)
    return EventPacket(Header(t0 + 33_333_333, k), offsets, t, x, y, p, width=640, height=480, t0_ns=t0)


def messages():
    """Small ones and large ones, some too large for a chunk, of one environment and of many."""
    for k, count in enumerate([0, 10, 700_000, 50, 90_000, 90_000, 300_000]):
        for topic, message in scene(k).items():
            if topic != "/cam0/events":
                yield topic, message
        yield "/cam0/events", packet(k, count)
    for k in range(2):
        yield "/cam1/events", packet(k, 900_000, envs=40)


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """The same messages by 1, 2 and 5 threads, chunks cut by their size alone."""
    folder = tmp_path_factory.mktemp("bags")
    for count in (1, 2, 5):
        with BagWriter(folder / f"{count}.mcap", chunk_period_s=math.inf, threads=count) as writer:
            for topic, message in messages():
                writer.write(topic, message)
    return folder


def test_the_bytes_do_not_depend_on_the_number_of_threads(bags):
    assert len({(bags / f"{count}.mcap").read_bytes() for count in (1, 2, 5)}) == 1


def test_what_was_written_is_read(bags):
    with BagReader(bags / "5.mcap") as reader:
        read = [(t, copied(m)) for t, m in reader.messages()]
        assert not reader.problem and not reader.skipped
    for topic in ("/cam0/events", "/cam1/events", "/cam0/depth", "/cam0/keyframe", "/state"):
        mine = [m for t, m in messages() if t == topic]
        other = [m for t, m in read if t == topic]
        assert len(mine) == len(other) and all(map(same, mine, other))


def test_another_reader_finds_every_checksum_right(bags):
    """The MCAP library checks them; a chunk of a large message is one zstd frame like any other."""
    with open(bags / "5.mcap", "rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert max(c.uncompressed_size for c in chunks) > packing.LARGEST
    assert sum(c.compression == "zstd" and packing.LARGE < c.uncompressed_size < packing.LARGEST for c in chunks) > 8
    with open(bags / "5.mcap", "rb") as file:
        found = make_reader(file, validate_crcs=True).iter_messages(["/cam0/events"])
        sizes = [ros.read_event_packet(memoryview(m.data)).events.nbytes for _, _, m in found]
    assert sizes == [8 * n for n in (0, 10, 700_000, 50, 90_000, 90_000, 300_000)]


@pytest.mark.parametrize("envs", [1, 40])
def test_a_message_is_in_the_file_soon_after_it_was_taken(tmp_path, envs):
    """Nothing is held back until more comes: what is lost when the process dies is the open chunk, and what a disk has
    not taken yet of large ones."""
    with BagWriter(tmp_path / "a.mcap", chunk_bytes=1000, chunk_period_s=math.inf, threads=3) as writer:
        for k in range(3):
            writer.write("/cam0/events", packet(k, 400_000, envs))
            assert not writer.container._indexes and not writer.container._complete
            found, until = [], time.monotonic() + 20
            while len(found) <= k and time.monotonic() < until:
                with BagReader(tmp_path / "a.mcap") as reader:
                    assert "end" in reader.problem
                    found = [copied(m) for _, m in reader.messages()]
            assert len(found) == k + 1 and same(found[-1], packet(k, 400_000, envs))


def test_an_error_in_one_environment_keeps_the_others_whole(tmp_path):
    """Times before 0 cannot be recorded: the message is refused, all before it and after it are there."""
    bad = packet(1, 1000, envs=4)
    bad.t[700] = -1
    with BagWriter(tmp_path / "a.mcap", threads=2) as writer:
        writer.write("/cam0/events", packet(0, 1000, envs=4))
        with pytest.raises(BagError, match=r"an event at -1 ns cannot be recorded.*--rebase"):
            writer.write("/cam0/events", bad)
        writer.write("/cam0/events", packet(2, 1000, envs=4))
    with BagReader(tmp_path / "a.mcap") as reader:
        assert [m.header.seq for _, m in reader.messages()] == [0, 2] and not reader.problem


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("t0", [-5, 0, 7 << 30, 1 << 70])
def test_times_that_one_packet_cannot_hold(tmp_path, threads, t0):
    """Whatever the packet's own base is: times beyond 2^32 ns of it, in no order, are read as they were."""
    rng = np.random.default_rng(3)
    sent = packet(1, 300_000)
    sent.t = rng.integers(7 << 30, 9 << 30, 300_000) + np.where(np.arange(300_000) < 140_000, 0, 40 << 30)
    sent.t0_ns = t0
    with BagWriter(tmp_path / "a.mcap", threads=threads) as writer:
        writer.write("/cam0/events", sent)
    with BagReader(tmp_path / "a.mcap") as reader:
        (found,) = [copied(m) for _, m in reader.messages()]
    assert same(sent, found)


@pytest.mark.parametrize("count", [1, 4])
def test_of_several_errors_the_first_is_told_when_nobody_works_any_more(count):
    """Arrays that are worked on may be written again then."""
    threads, under_way = Threads(count), []

    def work(item):
        under_way.append(item)
        time.sleep(0.02 if item != 3 else 0.0)
        under_way.remove(item)
        if item in (2, 3):
            raise ValueError(f"item {item}")
        return item

    for _ in range(5):
        with pytest.raises(ValueError, match="item 2"):
            threads.map(work, range(50))
        assert not under_way
    assert threads.map(work, (0, 1, 4, 5, 6, 7)) == [0, 1, 4, 5, 6, 7]
    threads.close()


def test_who_shares_work_waits_for_no_thread_that_is_busy():
    threads, done = Threads(2), threading.Event()
    for _ in range(2):
        threads.begin(lambda _: done.wait(60), [0])
    assert threads.map(abs, (-1, -2, -3)) == [1, 2, 3] and not done.is_set()
    done.set()
    threads.close()


@pytest.mark.parametrize("count", [1, 3])
def test_checksums_of_blocks_are_those_of_the_whole(count):
    """By zlib itself, at every kind of border."""
    rng = np.random.default_rng(0)
    pieces = [rng.bytes(n) for n in (0, 5, 3 * BLOCK, BLOCK - 1, BLOCK, 2 * BLOCK + 17, 9)]
    threads = Threads(count)
    for start in range(len(pieces)):
        assert crc32(pieces[start:], threads)() == zlib.crc32(b"".join(pieces[start:]))
    threads.close()


@pytest.mark.parametrize("megabytes", [2, 300])
def test_a_chunk_that_readers_would_take_for_a_bomb_is_not_compressed(megabytes):
    """Zeros: a reader allows 256 MiB and 100 bytes for each that is stored."""
    zeros = memoryview(bytes(megabytes * 1_000_000))
    packed = packing.Packer(Threads(1)).large([b"head", zeros])()
    stored = sum(map(len, packed.stored))
    assert packed.size == 4 + len(zeros) <= (256 << 20) + 100 * stored
    assert (packed.compression, stored < 1000) == (("", False) if megabytes == 300 else ("zstd", True))
