"""Connects the executor's thread with the server's: who reads which channel, and what each message becomes for it.

The server's side says what its clients want; the node's `idle` opens and closes taps until they match. Messages come
in on the executor's thread, where they are encoded once for all who read them. Nothing here ever waits for a client.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from evis.bag import environments
from evis.bag.ros import images
from evis.bag.ros.mapping import frame_of
from evis.runtime.plan import Plan
from evis.web.notices import Notices
from msgs.camera import CameraInfo, EventPacket, Image, Keyframe
from msgs.header import Message
from msgs.topics import SYSTEM_TOPICS
from nodes.foxglove import protocol
from nodes.foxglove.channels import MOST_ENVS, PICTURE, PREVIEW, Channel, Channels, Frame, encode
from nodes.foxglove.client import Client
from nodes.foxglove.pictures import PREVIEW_HZ, EventPicture, Pace, preview

LEFT_OUT, MISSED, OUTSIDE = "messages_left_out", "messages_missed", "events_outside"
"""Counters of the node."""


class Relay(Notices):
    """Holds the shared state; every method is safe from any thread."""

    def __init__(self, plan: Plan) -> None:
        super().__init__()
        self.plan = plan
        self.failure = ""
        """What ended the graph before its time; empty where nothing did."""
        self._channels = Channels(plan)
        self._clients: set[Client] = set()
        self._readers: dict[Channel, set[Client]] = {}
        self._latched: dict[Channel, list[Frame]] = {}
        self._refused: dict[str, str] = {}
        self._pictures: dict[Channel, EventPicture] = {}
        self._previews: dict[Channel, Pace] = {}
        self._sizes: dict[str, tuple[int, int]] = {}
        """Width and height of each camera, from its latched info."""
        self._instant = (-1, 0)

    # -- the server's side -------------------------------------------------------------------------------------------

    def join(self, client: Client) -> None:
        """Adds a client, and tells it which channels there are."""
        with self._lock:
            client.say(protocol.advertise([c.advertised() for c in self._channels.all.values()]))
            if self._channels.envs > MOST_ENVS:
                client.say(protocol.status(protocol.INFO, _too_many(self._channels.envs)))
            self._clients.add(client)

    def subscribe(self, client: Client, subscription: int, number: int) -> None:
        """Adds a subscription; what is latched is sent at once. Raises ValueError."""
        with self._lock:
            channel = self._channels.all.get(number)
            if channel is None:
                raise ValueError(f"there is no channel {number}")
            client.subscribe(subscription, channel)
            self._readers.setdefault(channel, set()).add(client)
            if channel in self._latched:
                client.offer(channel, self._latched[channel])
            if channel.topic in self._refused:
                client.say(protocol.status(protocol.ERROR, self._refused[channel.topic]))

    def unsubscribe(self, client: Client, subscription: int) -> None:
        """Ends a subscription. Raises ValueError."""
        with self._lock:
            self._forget(client, client.unsubscribe(subscription))

    def leave(self, client: Client) -> None:
        """Removes a client and its subscriptions."""
        with self._lock:
            self._clients.discard(client)
            for channel in client.channels():
                self._forget(client, channel)

    def _forget(self, client: Client, channel: Channel) -> None:
        readers = self._readers.get(channel, set())
        readers.discard(client)
        if not readers:
            self._readers.pop(channel, None)
            self._pictures.pop(channel, None)
            self._previews.pop(channel, None)
        if not any(other.topic == channel.topic for other in self._readers):
            self._refused.pop(channel.topic, None)

    # -- the executor's side -----------------------------------------------------------------------------------------

    def wanted(self) -> set[str]:
        """Names the topics to be tapped now: those that are read, and the info that tells the size of a picture."""
        with self._lock:
            infos = {_info_of(channel.topic) for channel in self._readers if channel.suffix == PICTURE}
            return {channel.topic for channel in self._readers} | (infos & self.plan.topics.keys())

    def forget(self, topic: str) -> None:
        """Notes that a topic is no longer tapped: what was latched of it may change unseen."""
        with self._lock:
            self._latched = {channel: frames for channel, frames in self._latched.items() if channel.topic != topic}

    def refused(self, topic: str) -> bool:
        """Tells whether a topic could not be read since somebody subscribed to it."""
        with self._lock:
            return topic in self._refused

    def put(self, topic: str, message: Message) -> None:
        """Takes a message of a tap; its arrays are not used after return."""
        try:
            with self._lock:
                self._put(topic, message)
        except Exception as error:
            self.refuse(topic, f"{type(error).__name__}: {error}")

    def _put(self, topic: str, message: Message) -> None:
        if message.header.clock != "wall":
            self._instant = max(self._instant, message.header.instant)
        if isinstance(message, CameraInfo):
            self._sizes[topic] = message.width, message.height
        latched = topic in self.plan.topics and self.plan.topics[topic].latched
        numbers, envs = self._environments(topic, message)
        parts: list[Message] = []
        for env in numbers:
            channels = self._channels.of(topic, env)
            read = {s: channel for s, channel in channels.items() if latched or channel in self._readers}
            if not read:
                continue
            if not parts:
                parts = [message] if len(numbers) == 1 else [part for part, _ in environments.split(message, envs)]
            part = parts[env or 0] if len(parts) > 1 else message
            lacking = read.keys() & set(images.PARTS.get(type(message).__name__, {}).values())
            for suffix, frames in encode(part, channels[""].base, read.keys(), self._time_of(topic, message)):
                lacking.discard(suffix)
                self._send(read[suffix], frames)
                if latched:
                    self._latched[read[suffix]] = frames
            self._tell_lacking([read[suffix] for suffix in sorted(lacking)])
            self._draw(read, part)

    def _tell_lacking(self, channels: list[Channel]) -> None:
        """Tells who reads a part that the newest message is without, such as a label that the graph does not make."""
        for channel in channels:
            name = channel.base + channel.suffix
            text = protocol.status(protocol.WARNING, f"{name}: the newest message of {channel.topic} has no such part")
            for client in self._readers.get(channel, ()):
                client.lack(channel, text)

    def _time_of(self, topic: str, message: Message) -> int | None:
        """Returns the time of a message of the system, whose wall clock would stand apart from all others; None where
        a message has its own.
        """
        return self.newest_ns if topic in SYSTEM_TOPICS and message.header.clock == "wall" else None

    @property
    def newest_ns(self) -> int:
        """Returns the latest stamp of the newest episode [ns], 0 before any."""
        return max(self._instant[1], 0)

    def _environments(self, topic: str, message: Message) -> tuple[Sequence[int | None], int]:
        """Returns which environments a message is of, as a bag tells them apart, and how many there are; makes their
        channels where they lack. [None]: of one, or of all together.
        """
        if isinstance(message, Image) and message.envs > 1:
            self._widen(topic, message, message.envs)
            return [message.env], message.envs
        envs = environments.count(message) or (self._channels.envs if environments.tabular(message) else 1)
        if envs <= 1 or not environments.fits(message, envs):
            self._widen(topic, message, 1)
            return [None], 1
        self._widen(topic, message, envs)
        return range(min(envs, MOST_ENVS)), envs

    def _widen(self, topic: str, message: Message, envs: int) -> None:
        """Makes the channels of a topic that has other environments than were foreseen, and tells the clients."""
        more = envs > max(self._channels.envs, MOST_ENVS)
        self._channels.envs = max(self._channels.envs, envs)
        new = self._channels.add(topic, type(message).__name__, envs)
        texts = [protocol.advertise([channel.advertised() for channel in new])] if new else []
        if new and envs > 1:
            texts.append(
                protocol.status(
                    protocol.INFO, f"{topic} has {envs} environments: they are on /env0{topic}, /env1{topic}, ..."
                )
            )
        texts += [protocol.status(protocol.INFO, _too_many(envs))] if more else []
        for client in self._clients:
            for text in texts:
                client.say(text)

    def _draw(self, read: dict[str, Channel], part: Message) -> None:
        if PREVIEW in read and isinstance(part, Keyframe):
            channel = read[PREVIEW]
            pace = self._previews.setdefault(channel, Pace(PREVIEW_HZ))
            if pace.due():
                pace.passed()
                self._send(channel, [Frame(max(part.header.stamp_ns, 0), preview(part, frame_of(channel.base)))])
        if PICTURE in read and isinstance(part, EventPacket):
            channel = read[PICTURE]
            size = (part.width, part.height) if part.width else self._sizes.get(_info_of(channel.topic), (0, 0))
            picture = self._pictures.setdefault(channel, EventPicture())
            outside = picture.add(part, *size)
            if outside:
                self._counts[OUTSIDE] += outside
            self._send_picture(channel, picture)

    def _send_picture(self, channel: Channel, picture: EventPicture) -> None:
        drawn = picture.take(frame_of(channel.base))
        if drawn is not None:
            self._send(channel, [Frame(picture.stamp_ns, drawn)])

    def _send(self, channel: Channel, frames: list[Frame]) -> None:
        for client in self._readers.get(channel, ()):
            self._counts[LEFT_OUT] += client.offer(channel, frames)

    def tick(self) -> None:
        """Sends the pictures of events that have become due since the last packet."""
        with self._lock:
            for channel, picture in self._pictures.items():
                self._send_picture(channel, picture)

    def miss(self, topic: str, count: int) -> None:
        """Notes messages that a tap of a topic did not get."""
        with self._lock:
            self._counts[MISSED] += count
            for client in {c for channel, clients in self._readers.items() if channel.topic == topic for c in clients}:
                client.miss(count)

    def refuse(self, topic: str, reason: str) -> None:
        """Notes that a topic cannot be read or sent: who reads it is told so, and the node warns once."""
        text = f"{topic} cannot be shown: {reason}"
        with self._lock:
            known = topic in self._refused
            self._refused.setdefault(topic, text)
            readers: set[Client] = set()
            for channel, clients in self._readers.items():
                readers |= clients if channel.topic == topic else set()
            for client in () if known else readers:
                client.say(protocol.status(protocol.ERROR, text))
        if not known:
            self.report(text)

    def goodbye(self) -> str:
        """Returns the status with which clients are left."""
        if self.failure:
            return protocol.status(protocol.ERROR, f"the run has failed: {self.failure}")
        return protocol.status(
            protocol.INFO, "no more comes: the run has ended, or what serves it to Foxglove was stopped"
        )

    def describe(self) -> dict[str, Any]:
        """Returns what a client is told of the graph; no secret of the run."""
        plan = self.plan.redacted()
        return {"graph": plan.name, "mode": plan.mode, "seed": str(plan.seed)}


def _info_of(topic: str) -> str:
    return topic.rpartition("/")[0] + "/info"


def _too_many(envs: int) -> str:
    return f"of {envs} environments the first {MOST_ENVS} have channels; the others are left out"
