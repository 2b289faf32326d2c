"""Reads messages of a bag, whole or torn."""

from __future__ import annotations

import heapq
import itertools
import math
import os
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel

from evis.bag import BagError, environments
from evis.bag.mcap import scan
from evis.bag.ros import jsonform, mapping
from evis.bag.ros import messages as ros
from evis.bag.unpacked_chunks import ChunkHold, UnpackedLimit
from evis.bag.writer import ENV_KEY, MESSAGE_KEY, SUFFIX_KEY, TOPIC_KEY
from evis.files.damage import faults_as
from evis.files.descriptor import DescriptorOwner
from msgs.header import Message
from msgs.topics import TOPICS, UnknownTopic, find_topic

LATCHED = frozenset(row.type.__name__ for row in TOPICS if row.latched)
"""Messages that stay true: their times, of when they were said, tell nothing of when the others were."""
NEVER_NS = 1 << 64
"""Later than any log time, which has 64 bits."""
RANKS = {row.type.__name__: i for i, row in enumerate(TOPICS)}
"""Order of data flow among messages of one stamp."""


@dataclass(frozen=True)
class BagTopic:
    """Describes one channel of the file.

    topic, kind: the message's topic and type that it serves, `` for foreign types that cannot be read. part: its part
    of the message, `meta` = the closing JSON, "" = another program's message.
    """

    channel: Channel
    ros_type: str
    topic: str
    kind: str
    part: str
    env: int | None


@dataclass
class _RawMessage:
    """Holds a message's raw form, ready to be decoded."""

    stream: BagTopic
    log_time: int
    sequence: int
    parts: dict[str, list[memoryview]]
    body: dict[str, Any] | None
    raw: memoryview
    held: tuple[ChunkHold, ...]
    """The chunks that `parts` and `raw` lie in."""


_Pending = dict[tuple[str, int | None], list[tuple[int, str, memoryview, ChunkHold]]]
"""(topic, environment) -> (sequence number, name, bytes, chunk) of each part of a message."""


class BagReader(DescriptorOwner):
    """Reads a bag. A torn bag (no index, cut anywhere) opens like a whole one; `problem` says what it lacks.

    topics: topic -> message type name; environments of one topic are joined. metadata: the tables of texts.
    skipped: damaged chunks and messages that were left out so far. Raises BagError.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.is_dir():
            inside = sorted(p.name for p in self.path.glob("*.mcap"))
            there = f"it holds {', '.join(inside[:3])}" if inside else "it holds none"
            raise BagError(f"{self.path} is a folder; name the .mcap in it ({there})")
        if self.path.exists() and not self.path.is_file():  # a pipe that nobody writes to would be waited for
            raise BagError(f"{self.path} is no file, and a bag is read at more than one place: save it to a file first")
        try:
            self._descriptor = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
            try:
                with faults_as(BagError, self.path):
                    self.scanner = scan.Scanner(self._descriptor, str(self.path))
                    layout = self.scanner.layout
                    self.streams = {i: self._stream(channel) for i, channel in layout.channels.items()}
            except BaseException:
                os.close(self._descriptor)
                raise
        except OSError as error:
            raise BagError(f"cannot read {self.path}: {error.strerror}") from None
        self._limit = UnpackedLimit(self.path, self.scanner.size)
        self.problem = layout.problem
        self.metadata: Mapping[str, Mapping[str, str]] = layout.metadata
        self.topics = {s.topic: s.kind for s in self.streams.values() if s.kind}
        self.skipped = 0
        self.first_problem = ""

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @cached_property
    def start_ns(self) -> int:
        """Returns the earliest log time [ns], of LATCHED messages where there are no others; 0 in an empty bag."""
        return self._extreme_time(min, [(c.start_ns, c) for c in self.scanner.layout.chunks])

    @cached_property
    def end_ns(self) -> int:
        """Returns the latest log time [ns], of LATCHED messages where there are no others; 0 in an empty bag."""
        return self._extreme_time(max, [(c.end_ns, c) for c in self.scanner.layout.chunks])

    def _extreme_time(self, least: Callable[..., int], edges: list[tuple[int, scan.Chunk]]) -> int:
        """Finds the earliest or latest log time, `least` being min or max; edges: that of each chunk.

        Chunks with LATCHED messages are looked into, those first that may have it.
        """
        latched = frozenset(i for i, s in self.streams.items() if s.kind in LATCHED)
        found: int | None = None
        for edge, chunk in sorted(edges, key=lambda pair: pair[0], reverse=least is max):
            if found is not None and least(found, edge) == found:
                break
            if latched and (chunk.channels is None or chunk.channels & latched):
                times = [] if found is None else [found]
                with suppress(BagError):  # counted when its messages are read
                    for opcode, _, record in scan.records(self.scanner.chunk_data(chunk)):
                        if opcode == Opcode.MESSAGE and (message := scan.message(record))[0] not in latched:
                            times.append(message[2])
                found = least(times, default=None)
            else:
                found = edge
        return least((edge for edge, _ in edges), default=0) if found is None else found

    def _stream(self, channel: Channel) -> BagTopic:
        schema = self.scanner.layout.schemas.get(channel.schema_id)
        name = schema.name if schema else ""
        given = channel.metadata
        if TOPIC_KEY in given and given.get(MESSAGE_KEY) in Message.TYPES:
            env = given.get(ENV_KEY)
            number = int(env) if env is not None and env.isdecimal() else None
            return BagTopic(channel, name, given[TOPIC_KEY], given[MESSAGE_KEY], given.get(SUFFIX_KEY, ""), number)
        kind = mapping.FOREIGN.get(name, "") if channel.message_encoding == "cdr" else ""
        return BagTopic(channel, name, channel.topic, kind, "", None)

    # -- messages ----------------------------------------------------------------------------------------------------

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[str, Message]]:
        """Yields (topic, message) by episode, time, and at one time in data-flow order. Arrays are read-only.

        topics: None = all. start_ns, end_ns: inclusive range of log times [ns]. Damaged parts are left out and counted
        in `skipped`. Raises BagError for a topic that the bag does not have.
        """
        for topic in topics or ():
            if topic not in self.topics:
                raise BagError(self.lacks(topic))
        wanted = frozenset(i for i, s in self.streams.items() if s.kind and (topics is None or s.topic in topics))
        sets: dict[tuple[str, int, int, int], dict[int, _RawMessage]] = {}
        for found in self._in_order(wanted, start_ns, end_ns):
            try:
                with faults_as(BagError, self.path):
                    message = self._complete(found, sets)
            except BagError as error:
                self.skip(error)
                continue
            if message is not None:
                yield found.stream.topic, message
        self.skipped += len(sets)

    def lacks(self, topic: str) -> str:
        """Words the error that a topic is not there: which topics are, and how it would be recorded."""
        there = f"it has {', '.join(sorted(self.topics)) or 'none'}"
        if self.problem:
            return f"{self.path} is torn ({self.problem}); up to there it has no topic '{topic}'; {there}"
        with suppress(UnknownTopic):
            if not find_topic(topic).recorded:
                there += f"; `evis launch` records it with --record-topics {topic}"
        return f"{self.path} has no topic '{topic}'; {there}"

    def skip(self, error: BagError) -> None:
        """Counts a part that is left out because it is damaged."""
        self.skipped += 1
        self.first_problem = self.first_problem or str(error)

    def _complete(
        self, found: _RawMessage, sets: dict[tuple[str, int, int, int], dict[int, _RawMessage]]
    ) -> Message | None:
        """Decodes a message, once all of its environments are there; None until then."""
        if found.body is None:
            return mapping.decode_foreign(found.stream.ros_type, found.raw, found.sequence)
        envs = found.body.get("_envs")
        if found.stream.env is None or not isinstance(envs, int):
            return mapping.decode(found.stream.kind, found.parts, found.body)
        header = jsonform.header_of(found.body)
        key = (found.stream.topic, header.episode, header.stamp_ns, header.seq)
        waiting = sets.setdefault(key, {})
        waiting[found.stream.env] = found
        if len(waiting) < envs:
            return None
        del sets[key]
        parts = [f for _, f in sorted(waiting.items())]
        joined = [
            (mapping.decode(f.stream.kind, f.parts, f.body or {}), (f.body or {}).get("_rows", {})) for f in parts
        ]
        try:
            return environments.join(joined)
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise BagError(f"{found.stream.topic}: its environments do not fit together: {error}") from None

    def _in_order(self, wanted: frozenset[int], start_ns: int | None, end_ns: int | None) -> Iterator[_RawMessage]:
        """Yields the messages of all chunks in order; each waits until no chunk of its episode can hold an
        earlier one."""
        lowest, highest = start_ns or 0, NEVER_NS if end_ns is None else end_ns
        for chunks in self._chunks_by_episode(wanted, start_ns, end_ns):
            following = reversed([chunk.start_ns for chunk in chunks[1:]])
            earliest_behind = [*itertools.accumulate(following, min, initial=NEVER_NS)][::-1]
            heap: list[tuple[int, int, int, str, int, _RawMessage]] = []
            count = 0
            pending: _Pending = {}
            for chunk, bound in zip(chunks, earliest_behind):
                for found in self._messages_of(chunk, wanted, pending):
                    if lowest <= found.log_time <= highest:
                        rank = RANKS.get(found.stream.kind, 0)
                        heapq.heappush(heap, (_episode(found), found.log_time, rank, found.stream.topic, count, found))
                        count += 1
                while heap and heap[0][1] < bound:
                    yield heapq.heappop(heap)[-1]

    def _chunks_by_episode(
        self, wanted: frozenset[int], start_ns: int | None, end_ns: int | None
    ) -> Iterator[list[scan.Chunk]]:
        """Yields the wanted chunks episode by episode, for time may start anew with each."""
        layout = self.scanner.layout
        borders = [*sorted(layout.episodes), math.inf]
        segment: list[scan.Chunk] = []
        for chunk in layout.chunks:
            while chunk.at > borders[0]:
                borders.pop(0)
                yield segment
                segment = []
            if chunk.channels is not None and not chunk.channels & wanted:
                continue
            if (start_ns is None or chunk.end_ns >= start_ns) and (end_ns is None or chunk.start_ns <= end_ns):
                segment.append(chunk)
        yield segment

    def _messages_of(self, chunk: scan.Chunk, wanted: frozenset[int], pending: _Pending) -> Iterator[_RawMessage]:
        """Yields the messages of one chunk.

        pending: parts of which the closing JSON is still to come; a tool that has written the bag anew may have put it
        into the next chunk.
        """
        try:
            data = self.scanner.chunk_data(chunk)
            held = self._limit.hold(len(data))
            for opcode, _, record in scan.records(data):
                if opcode != Opcode.MESSAGE:
                    continue
                channel, sequence, log_time, payload = scan.message(record)
                if channel not in wanted:
                    continue
                stream = self.streams[channel]
                key = stream.topic, stream.env
                if not stream.part:
                    yield _RawMessage(stream, log_time, sequence, {}, None, payload, (held,))
                elif stream.part != "meta":
                    pending.setdefault(key, []).append((sequence, stream.part, payload, held))
                else:
                    body = jsonform.parse(ros.read_text(payload))
                    parts: dict[str, list[memoryview]] = {}
                    chunks = {held: None}
                    for number, part, content, its in pending.pop(key, ()):
                        if number == sequence:  # not those of a message whose JSON is lost
                            parts.setdefault(part, []).append(content)
                            chunks[its] = None
                    yield _RawMessage(stream, log_time, sequence, parts, body, payload, tuple(chunks))
        except scan.TooLargeError:
            raise
        except BagError as error:
            pending.clear()
            self.skip(error)


def _episode(found: _RawMessage) -> int:
    episode = found.body["header"].get("episode", 0) if found.body else 0
    return episode if isinstance(episode, int) else 0
