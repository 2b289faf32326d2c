"""Describes the contents of a bag, for `evis bag info`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from evis.bag import BagError
from evis.bag.decoded import decoded_events
from evis.bag.mcap import scan
from evis.bag.reader import LATCHED, BagReader, BagTopic
from evis.bag.ros import jsonform
from evis.bag.ros import messages as ros


class _Topic:
    """Counts the messages and events of one topic of the file (with its environment's prefix)."""

    def __init__(self, stream: BagTopic) -> None:
        self.type = stream.ros_type
        self.message = stream.kind
        self.part_of = ""
        self.messages = 0
        self.bytes = 0
        self.span: list[int] = []
        self.rounds: list[list[int]] = []
        """First and last time of each stretch, whose times begin at or before that of the one before it."""
        self.events = 0
        self.event_span: list[int] = []
        self.size = (0, 0)
        self.undecoded = 0

    def add(self, log_time: int, size: int) -> None:
        self.messages += 1
        self.bytes += size
        self.span = [min([log_time, *self.span]), max([log_time, *self.span])]
        if not self.rounds or log_time <= self.rounds[-1][0] < self.rounds[-1][1]:
            self.rounds.append([log_time, log_time])
        self.rounds[-1][1] = max(log_time, self.rounds[-1][1])

    def add_events(self, count: int, first: int, last: int) -> None:
        """Notes the first and last time in the order of the stream."""
        self.events += count
        self.event_span = [self.event_span[0] if self.event_span else first, last]

    def as_dict(self) -> dict[str, Any]:
        result: dict[str, Any] = {"type": self.type, "message": self.message, "messages": self.messages}
        result["bytes"] = self.bytes
        if self.span:
            result |= {"start_ns": self.span[0], "end_ns": self.span[1]}
            seconds = sum(last - first for first, last in self.rounds) / 1e9
            result["rate_hz"] = round((self.messages - len(self.rounds)) / seconds, 6) if seconds else 0.0
        if self.part_of:
            result["part_of"] = self.part_of
        elif self.message == "EventPacket":
            first, last = self.event_span or (None, None)
            result |= {"events": self.events, "t_first_ns": first, "t_last_ns": last}
            result |= {"width": self.size[0], "height": self.size[1]}
            if self.undecoded:
                result["undecoded_packets"] = self.undecoded
        return result


def describe(path: str | Path) -> dict[str, Any]:
    """Describes duration, topics and metadata of a bag, from what is counted in it and not from its index. Raises
    BagError.

    {"path", "bytes", "duration_s", "start_ns", "end_ns", "complete", "problem", "topics": {name: {...}}, "parts":
    {name: {...}}, "metadata"}; `parts` are the topics that only complete others (`/cam0/keyframe/meta`).
    """
    with BagReader(path) as reader:
        topics = _count(reader)
        _count_raw_events(reader, topics)
        # diagnostics alone carry the wall's time: they do not count beside the time of what was recorded
        timed = [t for t in topics.values() if t.span and t.message not in (*LATCHED, "Diagnostics")]
        spans = [t.span for t in timed or topics.values() if t.span]
        start, end = min((s[0] for s in spans), default=0), max((s[1] for s in spans), default=0)
        problem = reader.problem or (f"damaged: {reader.first_problem}" if reader.skipped else "")
        return {
            "path": str(path),
            "bytes": reader.scanner.size,
            "duration_s": (end - start) / 1e9,
            "start_ns": start,
            "end_ns": end,
            "complete": not problem,
            "problem": problem,
            "topics": {n: t.as_dict() for n, t in sorted(topics.items()) if not t.part_of},
            "parts": {n: t.as_dict() for n, t in sorted(topics.items()) if t.part_of},
            "metadata": {k: dict(v) for k, v in reader.metadata.items() if not _internal(k)},
        }


def _internal(table: str) -> bool:
    return table == "episode" or table.startswith("jsonschema.")


def _count(reader: BagReader) -> dict[str, _Topic]:
    topics: dict[str, _Topic] = {}
    for stream in reader.streams.values():
        topic = topics.setdefault(stream.channel.topic, _Topic(stream))
        prefix = "" if stream.env is None else f"/env{stream.env}"
        if stream.part and stream.channel.topic != prefix + stream.topic:
            topic.part_of = prefix + stream.topic
    for chunk in reader.scanner.layout.chunks:
        try:
            for opcode, _, record in scan.records(reader.scanner.chunk_data(chunk)):
                if opcode == Opcode.MESSAGE:
                    _count_message(reader, topics, record)
        except scan.TooLargeError:
            raise
        except BagError as error:
            reader.skip(error)
    return topics


def _count_message(reader: BagReader, topics: dict[str, _Topic], record: memoryview) -> None:
    channel, _, log_time, payload = scan.message(record)
    stream = reader.streams.get(channel)
    if stream is None:
        raise BagError("a message's channel is not described")
    topics[stream.channel.topic].add(log_time, len(payload))
    if stream.kind == "EventPacket" and stream.part == "meta":
        body = jsonform.parse(ros.read_text(payload))
        base = topics.get(topics[stream.channel.topic].part_of, topics[stream.channel.topic])
        base.size = _integer(body, "width"), _integer(body, "height")
        counted = body.get("_events") or {}
        if not isinstance(counted, dict):
            raise BagError("a message's count of events is damaged")
        if "t_first_ns" in counted:
            base.add_events(*(_integer(counted, name) for name in ("events", "t_first_ns", "t_last_ns")))
        elif "events" not in counted:
            base.undecoded += 1


def _integer(body: dict[str, Any], name: str) -> int:
    value = body.get(name, 0)
    if not isinstance(value, int):
        raise BagError(f"a message's {name} is {value!r:.40}, no whole number")
    return value


def _count_raw_events(reader: BagReader, topics: dict[str, _Topic]) -> None:
    """Counts events that are recorded as a sensor's own bytes, by decoding them."""
    for name, topic in topics.items():
        packets = [s for s in reader.streams.values() if s.channel.topic == name and s.kind == "EventPacket"]
        foreign = any(not s.part for s in packets)
        if topic.part_of or topic.message != "EventPacket" or not (topic.undecoded or foreign):
            continue
        topic.events, topic.event_span = 0, []
        try:
            for packet, events in decoded_events(reader, name):
                topic.size = packet.width, packet.height
                if len(events):
                    topic.add_events(len(events), int(events.t[0]), int(events.t[-1]))
            topic.undecoded = 0
        except scan.TooLargeError:
            raise
        except BagError:
            topic.undecoded = topic.messages
