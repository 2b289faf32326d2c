"""Measures the CPU time per message between processes, of the bus and of plain ZeroMQ in the same run.

    evis bench bus [--quick]

One publisher sends 640x480 float32 images (1.2 MB) to one and to three consumers, as fast as they take them. The bus
writes each into shared memory (that copy is counted); plain ZeroMQ sends an array that is ready, with copy=True and a
blocking XPUB. CPU time is user plus system of all processes, I/O threads included; wall time depends on the machine's
load, CPU time hardly does.
"""

from __future__ import annotations

import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import msgpack
import numpy as np
import zmq

from bench import command
from evis.bus import END, Endpoints, Publisher, Subscriber, endpoints_for
from msgs.camera import Depth
from msgs.header import Header

COMMAND = "evis bench bus"
TOPIC = "/cam0/depth"
SHAPE = (1, 480, 640)
WARM_UP = 50
"""Messages before the clock starts: mapping, page faults, first allocations."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""As for the processes of a graph; numpy's idle threads would spin for a while and be counted."""
TARGETS = {1: 0.15, 3: 0.20}
"""CPU time per message wanted of the bus, by number of consumers [ms]."""


def _read_bus(pipe: Connection, endpoints: Endpoints, name: str) -> None:
    context = zmq.Context()
    subscriber = Subscriber(context, TOPIC, name, "in", endpoints, message_type=Depth)
    subscriber.start()
    start, count = 0.0, 0
    while (message := subscriber.receive(1000)) is not END:
        if message is not None:
            count += 1
            start = time.process_time() if count == WARM_UP else start
            message.release()
    pipe.send(time.process_time() - start)
    subscriber.close()
    context.term()


def _send_bus(endpoints: Endpoints, names: list[str], count: int) -> float:
    context = zmq.Context()
    source = np.random.default_rng(0).random(SHAPE, np.float32)
    publisher = Publisher(context, TOPIC, "renderer", endpoints, [f"{n}:in" for n in names], message_type=Depth)
    publisher.start()
    while publisher.missing():
        zmq.select(publisher.sockets(), [], [], 0.01)
    start = 0.0
    for i in range(WARM_UP + count):
        start = time.process_time() if i == WARM_UP else start
        out = publisher.loan(depth=(SHAPE, "float32"))["depth"]
        out[...] = source
        slot = publisher.send(Depth(Header(i), depth=out))
        assert slot is not None
        slot.unpin()
    publisher.finish(30)
    used = time.process_time() - start
    publisher.close()
    context.term()
    return used


def _read_plain(pipe: Connection, endpoints: Endpoints, name: str) -> None:
    context = zmq.Context()
    sock = context.socket(zmq.SUB)
    sock.setsockopt(zmq.RCVHWM, 4)
    sock.setsockopt(zmq.SUBSCRIBE, TOPIC.encode())
    sock.connect(endpoints.lockstep)
    start, count = 0.0, 0
    while len(frames := sock.recv_multipart()) == 3:
        fields = msgpack.unpackb(frames[1])
        array = np.frombuffer(frames[2], fields["dtype"]).reshape(fields["shape"])
        count += array.shape == SHAPE
        start = time.process_time() if count == WARM_UP else start
    pipe.send(time.process_time() - start)
    context.destroy(linger=0)


def _send_plain(endpoints: Endpoints, names: list[str], count: int) -> float:
    context = zmq.Context()
    sock = context.socket(zmq.XPUB)
    sock.setsockopt(zmq.SNDHWM, 4)
    sock.setsockopt(zmq.XPUB_NODROP, 1)
    sock.setsockopt(zmq.XPUB_VERBOSER, 1)
    sock.bind(endpoints.lockstep)
    for _ in names:
        sock.recv()
    source = np.random.default_rng(0).random(SHAPE, np.float32)
    topic, start = TOPIC.encode(), 0.0
    for i in range(WARM_UP + count):
        start = time.process_time() if i == WARM_UP else start
        header = msgpack.packb({"seq": i, "dtype": "float32", "shape": SHAPE})
        sock.send_multipart([topic, header, source.data])
    sock.send_multipart([topic, b""])
    used = time.process_time() - start
    context.destroy(linger=10_000)
    return used


def _run(read: Callable[..., None], send: Callable[..., float], consumers: int, count: int) -> float:
    """CPU time per message of all processes [ms]."""
    spawn = multiprocessing.get_context("spawn")
    os.environ |= ONE_THREAD
    with tempfile.TemporaryDirectory(prefix="evis-") as directory:
        endpoints = endpoints_for(directory, TOPIC)
        names = [f"consumer{i}" for i in range(consumers)]
        pipes = [spawn.Pipe() for _ in names]
        children = [spawn.Process(target=read, args=(p[1], endpoints, n), daemon=True) for p, n in zip(pipes, names)]
        for child in children:
            child.start()
        used = send(endpoints, names, count) + sum(p[0].recv() for p in pipes)
        for child in children:
            child.join()
    return 1e3 * used / count


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures CPU milliseconds per 1.2 MB message for 1 and 3 consumers: median and least of the repetitions."""
    count, repetitions = (600, 5) if quick else (2000, 7)
    load, rows = os.getloadavg()[0], []
    for consumers, target in TARGETS.items():
        # Alternating, so that a change of the machine's load meets both.
        pairs = [
            (_run(_read_bus, _send_bus, consumers, count), _run(_read_plain, _send_plain, consumers, count))
            for _ in range(repetitions)
        ]
        bus, plain = zip(*pairs)
        rows.append({
            "consumers": consumers,
            "bus [CPU ms]": round(statistics.median(bus), 3), "bus, least": round(min(bus), 3), "target": target,
            "ZeroMQ [CPU ms]": round(statistics.median(plain), 3), "ZeroMQ, least": round(min(plain), 3),
            "ZeroMQ / bus": round(statistics.median(p / b for b, p in pairs), 1),
        })  # fmt: skip
    return {
        "message": {
            "title": f"CPU time of a message of {int(np.prod(SHAPE)) * 4 / 1e6:.1f} MB, all processes together",
            "command": COMMAND,
            "rows": rows,
            "note": f"Medians of {repetitions} runs of {count} messages, {os.cpu_count()} cores. The load was "
            f"{load:.1f} before and shows in the figures, so compare the ratio, and the least.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
