"""Gives the messages of a bag's topic to what writes them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from evis.bag import BagError, environments
from evis.bag.reader import BagReader
from evis.events.files.rosbag.messages import TYPES, plain_type
from msgs.header import Message

Messages = Callable[[], Iterator[Message]]
"""Gives the messages of a topic from the start, each of one environment."""
_ENV = re.compile(r"/env(\d+)(/.*)")


@dataclass(frozen=True)
class Source:
    """Holds the topic that is exported: `topic` as it was asked for, its `name` in the bag, and the environment `env`
    that was named with it, None for all."""

    reader: BagReader
    topic: str
    name: str
    env: int | None

    @property
    def kind(self) -> str:
        """Returns the type of its messages."""
        return self.reader.topics[self.name]

    def messages(self) -> Iterator[Message]:
        """Yields its messages from the start."""
        return messages_of(self.reader, self.name, self.env)

    def check_one(self) -> None:
        """Raises BagError for images of several environments, which would be one film."""
        if self.env is None:
            environments.check_one(self.name, len(_environments(self.reader, self.name)))


def find(reader: BagReader, topic: str) -> Source:
    """Finds a topic of a bag by its name, `/env<k>/...` for one environment of several.

    Raises BagError, which says which topics there are.
    """
    if topic in reader.topics:
        return Source(reader, topic, topic, None)
    match = _ENV.fullmatch(topic)
    if match and match[2] in reader.topics:
        if int(match[1]) in _environments(reader, match[2]):
            return Source(reader, topic, match[2], int(match[1]))
    layout = reader.scanner.layout
    for schema in (layout.schemas.get(c.schema_id) for c in layout.channels.values() if c.topic == topic):
        kind = schema.name if schema else "of no type"
        events = f"; `evis events convert {reader.path} OUT --topic {topic}` writes its events"
        raise BagError(
            f"{reader.path}: {topic} is {kind}; no such message can be exported"
            + (events if plain_type(kind) in TYPES else "")
        )
    raise BagError(reader.lacks(topic))


def _environments(reader: BagReader, name: str) -> set[int | None]:
    """Returns the environments that a topic has streams of; None where it is of all."""
    return {stream.env for stream in reader.streams.values() if stream.topic == name}


def messages_of(reader: BagReader, topic: str, env: int | None) -> Iterator[Message]:
    """Yields the messages of a topic, of one environment where `env` names it."""
    for _, message in reader.messages([topic]):
        found = message if env is None else environments.of_one(message, env)
        if found is not None:
            yield found


def by_stamp(reader: BagReader, topics: list[str]) -> Iterator[dict[type[Message], Message]]:
    """Yields the messages of several topics that have one stamp, by their types."""
    group: dict[type[Message], Message] = {}
    at: tuple[int, int] | None = None
    for _, message in reader.messages(topics):
        key = (message.header.episode, message.header.stamp_ns)
        if key != at and group:
            yield group
            group = {}
        at = key
        group[type(message)] = message
    if group:
        yield group
