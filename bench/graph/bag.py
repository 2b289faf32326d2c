"""Measures throughput and CPU time of recording and reading bags, against the MCAP library's own writer.

    evis bench bag [--quick]

Keyframes are 640x480 float32 RGB (3.7 MB), one a message, rendered-like: a smooth image with texture. Events are those
of a moving edge, 10 000 a packet, 8 bytes each. CPU time is user plus system of this process with its flushing thread;
wall time also depends on the disk (the page cache here) and on the machine's load.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from msgs.camera import Depth, EventPacket, Keyframe
from msgs.header import Header, Message

COMMAND = "evis bench bag"
WIDTH, HEIGHT = 640, 480
PACKET = 10_000
VARIANTS = 4
"""Different messages, sent in turn."""


def keyframe(k: int) -> Keyframe:
    """Makes a smooth HDR image with a fine texture."""
    rng = np.random.default_rng(k % VARIANTS)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    smooth = np.exp(np.sin(x / 90 + k % VARIANTS) + np.cos(y / 70))
    radiance = smooth[..., None] * rng.uniform(0.8, 1.2, (HEIGHT, WIDTH, 3)).astype(np.float32)
    return Keyframe(Header(k * 33_333_333, k), np.zeros(1, np.int32), radiance[None].astype(np.float32))


def depth(k: int) -> Depth:
    """Makes the depth image of a sphere in front of a plane."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    r2 = (x - WIDTH / 2 - 9 * (k % VARIANTS)) ** 2 + (y - HEIGHT / 2) ** 2
    z = np.where(r2 < 150**2, 2 - np.sqrt(np.maximum(150**2 - r2, 0)) / 300, 3 + y / 480)
    return Depth(Header(k * 33_333_333, k), z[None].astype(np.float32))


def packet(k: int) -> EventPacket:
    """Makes the events of one interval, sorted by time, along a vertical edge."""
    rng = np.random.default_rng(k % VARIANTS)
    t0 = k * 33_333_333
    t = np.sort(rng.integers(t0 + 1, t0 + 33_333_333, PACKET))
    x = (200 + 20 * (t - t0) // 33_333_333 + rng.integers(0, 3, PACKET)).astype(np.uint16)
    y = rng.integers(0, HEIGHT, PACKET).astype(np.uint16)
    p = rng.integers(0, 2, PACKET).astype(np.uint8)
    offsets = np.array([0, PACKET], np.int64)
    return EventPacket(Header(t0 + 33_333_333, k), offsets, t, x, y, p, width=WIDTH, height=HEIGHT, t0_ns=t0)


def content_bytes(message: Message) -> int:
    """Counts a message's bytes in a bag without compression: pixels, or 8 bytes an event."""
    if isinstance(message, EventPacket):
        return 8 * PACKET
    return sum(a.nbytes for a in message.arrays().values())


def evis_writer(path: Path, messages: Iterator[tuple[str, Message]]) -> None:
    """Writes the messages to a bag with BagWriter, on one thread as the library does."""
    with BagWriter(path, threads=1) as writer:
        for topic, message in messages:
            writer.write(topic, message)


def library_writer(path: Path, messages: Iterator[tuple[str, Message]]) -> None:
    """Writes the same messages with mcap.writer.Writer: keyframes uncompressed, others zstd, chunks of 1 MB."""
    from mcap.writer import CompressionType, Writer

    from evis.bag.ros import mapping, schemas

    writer: Writer | None = None
    with open(path, "wb") as file:
        for topic, message in messages:
            raw = isinstance(message, Keyframe)
            if writer is None:
                writer = Writer(file, compression=CompressionType.NONE if raw else CompressionType.ZSTD)
                writer.start("ros2")
                kind = schemas.EVENT_PACKET if isinstance(message, EventPacket) else schemas.IMAGE
                schema = writer.register_schema(kind, "ros2msg", schemas.DEFINITIONS[kind].encode())
                channel = writer.register_channel(topic, "cdr", schema)
            stamp = message.header.stamp_ns
            for part in mapping.encode(message, topic)[0]:
                writer.add_message(channel, stamp, b"".join(bytes(b) for b in part.buffers), stamp)
        if writer is not None:
            writer.finish()


def read(path: Path) -> None:
    """Reads all messages of a bag with BagReader."""
    with BagReader(path) as reader:
        for _ in reader.messages():
            pass


def timed(work: Callable[[], None]) -> tuple[float, float]:
    """Measures (wall, CPU) seconds of a call."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def stream(topic: str, make: Callable[[int], Message], megabytes: int) -> Callable[[], Iterator[tuple[str, Message]]]:
    """Gives as many messages as make `megabytes`, the same few over and over, made beforehand."""
    made = [make(k) for k in range(VARIANTS)]
    count = max(VARIANTS, megabytes * 1_000_000 // content_bytes(made[0]))

    def messages() -> Iterator[tuple[str, Message]]:
        for k in range(count):
            yield topic, made[k % VARIANTS]

    return messages


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures MB/s of wall time, CPU seconds per GB of content and the ratio to the library's writer; medians."""
    megabytes, repeats = (100, 3) if quick else (500, 5)
    rows = []
    for topic, make in (("/cam0/keyframe", keyframe), ("/cam0/depth", depth), ("/cam0/events", packet)):
        messages = stream(topic, make, megabytes)
        gigabytes = sum(content_bytes(m) for _, m in messages()) / 1e9
        results: dict[str, list[tuple[float, float]]] = {"write": [], "library": [], "read": []}
        with tempfile.TemporaryDirectory() as folder:
            ours, theirs = Path(folder) / "a.mcap", Path(folder) / "b.mcap"
            for _ in range(repeats):  # in turn, so that a change of the machine's load meets all
                results["write"].append(timed(lambda: evis_writer(ours, messages())))  # noqa: B023
                results["library"].append(timed(lambda: library_writer(theirs, messages())))  # noqa: B023
                results["read"].append(timed(lambda: read(ours)))  # noqa: B023
                size = ours.stat().st_size / 1e9
                os.unlink(ours)
                os.unlink(theirs)
        wall = {name: statistics.median(w for w, _ in r) for name, r in results.items()}
        cpu = {name: statistics.median(c for _, c in r) for name, r in results.items()}
        rows.append({
            "topic": topic,
            "size / content": round(size / gigabytes, 3),
            "write MB/s": round(gigabytes * 1e3 / wall["write"]),
            "write CPU s/GB": round(cpu["write"] / gigabytes, 2),
            "library CPU s/GB": round(cpu["library"] / gigabytes, 2),
            "ours / library": round(cpu["write"] / cpu["library"], 2),
            "read MB/s": round(gigabytes * 1e3 / wall["read"]),
            "read CPU s/GB": round(cpu["read"] / gigabytes, 2),
        })  # fmt: skip
    return {
        "bags": {
            "title": "Bags: recording and reading, one core",
            "command": COMMAND,
            "rows": rows,
            "note": "Keyframes are stored as they are, depth and events with zstd level 1 (the library: level 3). "
            "Reading gives whole messages, arrays as views. Files are in the page cache.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
