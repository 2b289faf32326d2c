"""Fixtures of the bus tests: a private run directory, a context, child processes that never outlive their test."""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bus_workers
import pytest
import zmq

from evis.bus import Endpoints, Publisher, Subscriber, endpoints_for


@pytest.fixture
def context() -> Iterator[zmq.Context]:
    context = zmq.Context()
    yield context
    context.destroy(linger=0)


@pytest.fixture
def endpoints() -> Iterator[Endpoints]:
    """In a short directory: pytest's own are too long for a socket."""
    with tempfile.TemporaryDirectory(prefix="evis-") as directory:
        assert Path(directory).stat().st_mode & 0o077 == 0
        yield endpoints_for(directory, bus_workers.TOPIC)


@pytest.fixture
def pair(context: zmq.Context, endpoints: Endpoints) -> Iterator[tuple[Publisher, Subscriber]]:
    """A publisher and one consumer, in this process, connected."""
    publisher = bus_workers.publisher_on(context, endpoints, ["labeler:in"])
    subscriber = bus_workers.subscriber_on(context, endpoints)
    bus_workers.meet(publisher, subscriber)
    yield publisher, subscriber
    subscriber.close()
    publisher.close()


class Child:
    """A process and the pipe that it reports through."""

    def __init__(self, target: Callable[..., None], *args: Any) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self.process = spawn.Process(target=target, args=(theirs, *args), daemon=True)
        self.process.start()
        theirs.close()

    def hear(self, timeout_s: float = 60.0) -> Any:
        """The next report."""
        assert self.pipe.poll(timeout_s), "the child says nothing"
        return self.pipe.recv()


@pytest.fixture
def child() -> Iterator[Callable[..., Child]]:
    """`child(target, *args)` starts a process; it is killed when the test is over."""
    children: list[Child] = []

    def start(target: Callable[..., None], *args: Any) -> Child:
        children.append(Child(target, *args))
        return children[-1]

    yield start
    for one in children:
        one.process.kill()
        one.process.join()


@pytest.fixture
def reader(child: Callable[..., Child]) -> Callable[..., Child]:
    """`reader(endpoints, name, **options)`: a consumer process, started."""

    def start(endpoints: Endpoints, name: str, **options: Any) -> Child:
        one = child(bus_workers.read, endpoints, name, options)
        assert one.hear() == "started"
        return one

    return start
