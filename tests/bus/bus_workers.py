"""What the processes of the bus tests run, and the messages that they exchange."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import zmq

import evis.bus.memory.mapping
from evis.bus import END, Endpoints, Publisher, Subscriber, wire
from msgs.camera import Depth
from msgs.header import Header, Message

TOPIC = "/cam0/depth"
SIZES = ((1, 4, 6), (1, 100, 90), (1, 120, 160), (2, 90, 100), (1, 3, 3))
"""Below and above the inline limit, and growing, so that the ring must grow."""

QUICK_HEARTBEATS = 20, 100
"""Their interval and the time for an answer [ms]: what takes the bus seconds happens at once."""


def image(i: int) -> np.ndarray:
    """Message i of the stream, from a counter: every side can make it again."""
    bits = np.random.Generator(np.random.Philox(key=i)).integers(0, 1 << 23, SIZES[i % len(SIZES)], np.uint32)
    return bits.astype(np.float32)


def digest(pairs: Iterator[tuple[int, np.ndarray]]) -> str:
    """Hash of (stamp, array) pairs: the truth that every way of transport is held against."""
    sha = hashlib.sha256()
    for stamp, array in pairs:
        sha.update(f"{stamp} {array.shape} {array.dtype}".encode())
        sha.update(array.tobytes())
    return sha.hexdigest()


def truth(count: int) -> str:
    """Digest of messages 0 .. count - 1."""
    return digest((i, image(i)) for i in range(count))


def send_stream(publisher: Publisher, count: int) -> None:
    """Publish the stream, half of it in place."""
    for i in range(count):
        array = image(i)
        if i % 2:
            out = publisher.loan(depth=(array.shape, array.dtype))["depth"]
            out[...] = array
            array = out
        slot = publisher.send(Depth(Header(i), depth=array), timeout_s=60)
        if slot is not None:
            slot.unpin()


def wait_for(condition: Any, timeout_s: float = 60.0) -> None:
    """Poll until true."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "nothing happened in time"
        time.sleep(0.005)


def publisher_on(
    context: zmq.Context, endpoints: Endpoints, consumers: list[str], kind: type[Message] = Depth, **options: Any
) -> Publisher:
    """A started publisher of TOPIC, node `renderer`."""
    publisher = Publisher(context, TOPIC, "renderer", endpoints, consumers, message_type=kind, **options)
    publisher.start()
    return publisher


def subscriber_on(
    context: zmq.Context, endpoints: Endpoints, name: str = "labeler", kind: type[Message] = Depth, **options: Any
) -> Subscriber:
    """A started subscriber to TOPIC."""
    subscriber = Subscriber(context, TOPIC, name, "in", endpoints, message_type=kind, **options)
    subscriber.start()
    return subscriber


def meet(publisher: Publisher, *subscribers: Subscriber) -> None:
    """Wait until all of them are connected, and nobody is missing."""
    wait_for(lambda: (publisher.pump(), all([s.connected() for s in subscribers]))[1] and not publisher.missing())


def read(pipe: Any, endpoints: Endpoints, name: str, options: dict[str, Any]) -> None:
    """A consumer process: reads to the end and reports.

    options: tap, window; sleep_s after every message; stall (seed of random stalls); keep (messages held back, oldest
    released first, with a check that they did not change); inline (cannot open other processes' memory); hang_after.
    """
    if options.get("inline"):
        evis.bus.memory.mapping.reachable = lambda *_: False  # type: ignore[assignment]
    rng = np.random.default_rng(options.get("stall"))
    context = zmq.Context()
    subscriber = Subscriber(
        context, TOPIC, name, "in", endpoints, message_type=Depth,
        tap=options.get("tap", False), window=options.get("window", 2),
    )  # fmt: skip
    subscriber.start()
    sha, count, changed, shared = hashlib.sha256(), 0, 0, 0
    kept: list[tuple[Depth, bytes]] = []
    pipe.send("started")
    while True:
        message = subscriber.receive(100)
        if message is None:
            subscriber.raise_if_publisher_lost()
            continue
        if message is END:
            break
        assert isinstance(message, Depth)
        sha.update(f"{message.header.stamp_ns} {message.depth.shape} {message.depth.dtype}".encode())
        sha.update(message.depth.tobytes())
        count += 1
        shared += "mmap" in repr(_base(message.depth))
        if count == options.get("hang_after"):
            pipe.send("hanging")
            time.sleep(600)
        if options.get("keep"):
            message.keep()
            kept.append((message, message.depth.tobytes()))
            if len(kept) > options["keep"]:
                old, before = kept.pop(0)
                changed += old.depth.tobytes() != before
                old.release()
        if options.get("sleep_s"):
            time.sleep(options["sleep_s"])
        if options.get("stall") is not None and rng.random() < 0.0005:
            time.sleep(rng.random() * 0.02)
        message.release()
    pipe.send({
        "hash": sha.hexdigest(), "count": count, "lost": subscriber.lost, "rejected": subscriber.rejected,
        "changed": changed + sum(m.depth.tobytes() != before for m, before in kept), "shared": shared,
    })  # fmt: skip
    subscriber.close()
    context.term()


def lag(pipe: Any, endpoints: Endpoints) -> None:
    """A tap's process that reads nothing until it is told a number, then all until a message has that number."""
    wire.HEARTBEAT_MS, wire.HEARTBEAT_TIMEOUT_MS = QUICK_HEARTBEATS
    context = zmq.Context()
    subscriber = subscriber_on(context, endpoints, "program", tap=True, every=True)
    seq = pipe.recv()
    while (message := subscriber.receive(60_000)) is not None and message.header.seq < seq:
        pass
    pipe.send(message is not None)
    subscriber.close()
    context.term()


def _base(array: Any) -> Any:
    while getattr(array, "base", None) is not None:
        array = array.base
    return array.obj if isinstance(array, memoryview) else array


def publish(pipe: Any, endpoints: Endpoints, consumers: list[str], options: dict[str, Any]) -> None:
    """A publisher process: `count` messages of the stream, then finish and exit at once, or hang (`hang`)."""
    context = zmq.Context()
    publisher = publisher_on(context, endpoints, consumers)
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, options["count"])
    pipe.send(os.getpid())
    if options.get("hang"):
        time.sleep(600)
    publisher.finish(60)
    publisher.close()
    context.term()
