"""Taps of a topic of which each environment has messages of its own: each has the rate that a single one has."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
import zmq
from bus_workers import wait_for

from evis.bus import Endpoints, Publisher, Subscriber, tap
from msgs.camera import Image
from msgs.fields import array
from msgs.header import Header, Message

TOPIC = "/cam0/image"
HZ = 30.0


@dataclass
class Gauge(Message):
    """A message that the bus has never heard of, of which each of three environments has its own."""

    header: Header
    value: np.ndarray = array("float32", "N")
    of: int = 0

    @property
    def environment(self) -> tuple[int, int]:
        return self.of, 3


class Clock:
    """A clock that the test sets [s]."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        monkeypatch.setattr(tap, "time", SimpleNamespace(monotonic=lambda: self.now))


def passed(clock: Clock, envs: int, rate: float, seconds: float, jitter: float = 0.0) -> Counter[int]:
    """How many messages of each environment pass, of bursts in which each has one, 0.1 ms after the one before.

    rate: of the bursts [Hz]. jitter: how far they are early or late, a part of the time between them.
    """
    sender, begin = tap.TapSender(TOPIC, HZ), clock.now
    sender.listeners, sender.socket = 1, SimpleNamespace(setsockopt=lambda option, value: None)  # type: ignore[assignment]
    late = np.random.default_rng(7).uniform(-jitter, jitter, round(rate * seconds)) / rate
    count: Counter[int] = Counter()
    for k, delay in enumerate(late):
        for env in range(envs):
            clock.now = begin + k / rate + delay + 1e-4 * env
            count[env] += sender.due(env, envs)
    assert sender.skipped == envs * len(late) - count.total()
    return count


@pytest.mark.parametrize("envs", [1, 2, 4, 16])
@pytest.mark.parametrize("rate", [10.0, 30.0, 50.0, 240.0])
def test_each_environment_has_the_rate_of_one(monkeypatch: pytest.MonkeyPatch, envs: int, rate: float) -> None:
    """All of a slow source's messages, HZ a second of a fast one's; one more at the start."""
    count = passed(Clock(monkeypatch), envs, rate, seconds=20.0, jitter=0.03)
    wanted = 20.0 * min(rate, HZ)
    assert len(count) == envs
    for env in range(envs):
        assert wanted - 1 <= count[env] <= wanted + 2, env


@pytest.mark.parametrize("envs", [17, 40, 300])
def test_many_environments_take_turns(monkeypatch: pytest.MonkeyPatch, envs: int) -> None:
    """All together have the messages of ENVS_AT_ONCE, and none has more than its part of them."""
    count = passed(Clock(monkeypatch), envs, rate=60.0, seconds=20.0)
    turns = -(-envs // tap.ENVS_AT_ONCE)
    assert len(count) == envs and count.total() <= tap.ENVS_AT_ONCE * (20.0 * HZ + 2)
    for env in range(envs):
        assert abs(count[env] - 20.0 * HZ / turns) <= 2, env


def test_who_had_wanted_every_message_leaves_the_rate_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many passed meanwhile: a recorder that leaves does not stop the pictures of a page."""
    clock = Clock(monkeypatch)
    sender = tap.TapSender(TOPIC, HZ)
    sender.listeners, sender.eager = 2, 1
    for _ in range(3000):
        clock.now += 1 / 300
        assert sender.due()
    sender.listeners, sender.eager = 1, 0
    begin, count = clock.now, 0
    while clock.now < begin + 2.0:
        clock.now += 1 / 300
        count += sender.due()
    assert abs(count - 2.0 * HZ) <= 1


def test_any_message_may_be_of_one_environment(
    context: zmq.Context, endpoints: Endpoints, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of three passes as often as a single one would: the message itself says whose it is."""
    clock = Clock(monkeypatch)
    publisher = Publisher(context, TOPIC, "scale", endpoints, [], message_type=Gauge)
    publisher.start()
    viewer = Subscriber(context, TOPIC, "viewer", "tap", endpoints, message_type=Gauge, tap=True)
    viewer.start()
    wait_for(lambda: (publisher.pump(), publisher.tapped())[1])

    def burst(stamp: int) -> None:
        for env in range(3):
            publisher.send(Gauge(Header(stamp), np.full(2, env, np.float32), env))

    # At one time the first message and the one that is due then pass, of each environment.
    for stamp in range(3):
        burst(stamp)
    assert (publisher._tap.sent, publisher._tap.skipped) == (6, 3)
    # The first ones tell the viewer for how many it is to have room.
    wait_for(lambda: viewer.receive(0) is not None)
    while viewer.receive(200) is not None:
        pass
    clock.now += 1.0
    burst(3)
    came: list[Gauge] = []
    wait_for(lambda: (came.extend(filter(None, [viewer.receive(0)])), len(came) == 3)[1])
    assert [(m.header.stamp_ns, m.of, m.value.tolist()) for m in came] == [(3, e, [e, e]) for e in range(3)]
    viewer.close()
    publisher.close()


@pytest.fixture
def connected(context: zmq.Context, endpoints: Endpoints) -> tuple[Publisher, Subscriber]:
    """A publisher of images, and a viewer of them."""
    publisher = Publisher(context, TOPIC, "camera", endpoints, [], message_type=Image)
    publisher.start()
    viewer = Subscriber(context, TOPIC, "viewer", "tap", endpoints, message_type=Image, tap=True)
    viewer.start()
    wait_for(lambda: (publisher.pump(), publisher.tapped())[1])
    return publisher, viewer


def test_a_viewer_that_is_a_burst_behind_has_an_image_of_each(connected: tuple[Publisher, Subscriber]) -> None:
    """Each is larger than what a socket of the system holds. The first burst tells how many environments there are."""
    publisher, viewer = connected
    envs, pixels = 16, np.zeros((400, 800, 1), np.uint8)

    def burst(stamp: int) -> None:
        for env in range(envs):
            pixels[...] = env
            publisher.send(Image(Header(stamp), pixels.copy(), "mono8", env=env, envs=envs))

    burst(0)
    wait_for(lambda: viewer.receive(0) is not None)
    while viewer.receive(200) is not None:
        pass
    lost = viewer.lost
    publisher._tap._next = publisher._tap._left = 0  # the time for the next burst
    burst(1)
    came = []
    while len(came) < envs:
        image = viewer.receive(60_000)
        assert isinstance(image, Image) and image.header.stamp_ns == 1 and (image.data == image.env).all()
        came.append(image.env)
    assert came == list(range(envs)) and viewer.lost == lost
    viewer.close()
    publisher.close()
