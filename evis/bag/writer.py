"""Writes messages into a bag."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evis.bag import BagError, environments
from evis.bag.mcap.container import CHUNK_BYTES, CHUNK_PERIOD_S, Container
from evis.bag.ros import events, jsonform, mapping, schemas
from evis.bag.ros import messages as ros
from evis.bag.ros.cdr import ros_time
from evis.bag.threads import Threads
from msgs.camera import EventPacket, Image
from msgs.header import Message

if TYPE_CHECKING:
    from evis.events.codecs.prophesee.evt3 import Encoder

TOPIC_KEY, MESSAGE_KEY, SUFFIX_KEY, ENV_KEY = "evis.topic", "evis.message", "evis.part", "evis.env"
"""Metadata of a channel: our topic and message, "meta" for the closing JSON or "part", and the environment."""


_MOST_EARLY = 1000
"""Messages of the wall's clock that wait for the first one of another clock."""


class BagWriter:
    """Writes messages to a bag; `close` (or `with`) completes it, but it can be read at any time.

    path: an existing bag there is moved to `<name>.bak`, `.bak2`, ... (`backup`) when the new one is open. metadata:
    named tables of texts (launch file, parameters, seeds). event_encoding: `mono` (exact) or `evt3` (1 us, half the
    size) for decoded events. sync: also keep all but the last second if the machine dies, see `Container`. threads:
    share encoding and compression within `write`; None = one per core, at most 8. The bag's bytes do not depend on it.

    Messages whose clock is the wall's are filed under the newest stamp of the others, after a reset that of the newest
    episode, so that a simulation's bag does not span half a century; their own stamps are kept. Those that come before
    any other wait for it, or for `close`.
    """

    def __init__(
        self,
        path: str | Path,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
        *,
        event_encoding: str = "mono",
        chunk_bytes: int = CHUNK_BYTES,
        chunk_period_s: float = CHUNK_PERIOD_S,
        sync: bool = False,
        threads: int | None = None,
    ) -> None:
        if event_encoding not in events.ENCODINGS:
            raise BagError(f"event encoding is '{event_encoding}', must be one of {', '.join(events.ENCODINGS)}")
        self.path = Path(path)
        self.event_encoding = event_encoding
        self.threads = Threads(threads)
        """Those that share the work on a message, for who prepares one too."""
        self.container = Container(self.path, chunk_bytes, chunk_period_s, sync, self.threads)
        self.messages: dict[str, int] = defaultdict(int)
        """Messages recorded, by topic."""
        self.bytes: dict[str, int] = defaultdict(int)
        """Their size before compression."""
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._encoders: dict[str, Encoder] = {}
        self._described: set[str] = set()
        self._envs = 1
        self._newest: int | None = None
        self._early: list[tuple[str, Message]] = []
        self._episode: int | None = None
        for name, values in (metadata or {}).items():
            self.container.add_metadata(name, values)

    @property
    def backup(self) -> Path | None:
        """Returns the place to which an older bag of the same name was moved."""
        return self.container.backup

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, topic: str, message: Message) -> None:
        """Records one message; its arrays are free when this returns. Raises BagError, for a full disk too."""
        message.check()
        wall = message.header.clock == "wall"
        # arrays are the sender's again when this returns: such a message cannot wait
        if wall and self._newest is None and len(self._early) < _MOST_EARLY and not message.arrays():
            ros_time(message.header.stamp_ns)  # raises for what no bag can hold
            self._early.append((topic, message))
            return
        self._add(topic, message, self._log_time(message))

    def _add(self, topic: str, message: Message, log_time: int) -> None:
        if self._early:
            early, self._early = self._early, []
            for at, waiting in early:
                self._add(at, waiting, log_time)
        self._begin_episode(message.header.episode)
        envs = environments.count(message)
        if isinstance(message, Image) and message.envs > 1:
            self._write(topic, f"/env{message.env}", message.env, message, log_time, {})
            self.messages[topic] += 1
            return
        self._envs = max(self._envs, envs)
        envs = envs or (self._envs if environments.tabular(message) else 1)
        if envs > 1 and environments.fits(message, envs):
            with self.container.together():
                for e, (part, rows) in enumerate(environments.split(message, envs)):
                    extra = {"_envs": envs, **({"_rows": rows} if rows else {})}
                    self._write(topic, f"/env{e}", e, part, log_time, extra)
        else:
            self._write(topic, "", None, message, log_time, {})
        self.messages[topic] += 1

    def flush(self) -> None:
        """Writes all pending messages to the file now."""
        self.container.flush()

    def close(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Writes the open chunks, the tables of texts that are only known now, and the index. A second call does
        nothing."""
        if not self.container.failure and not self.container.closed:
            early, self._early = self._early, []
            for topic, message in early:
                self._add(topic, message, message.header.stamp_ns)
            for name, values in (metadata or {}).items():
                self.container.add_metadata(name, values)
        try:
            self.container.close()
        finally:
            self.threads.close()

    def _begin_episode(self, episode: int) -> None:
        if self._episode is None or episode > self._episode:
            if self._episode is not None:
                self.container.flush()
                self.container.add_metadata("episode", {"episode": str(episode)})
            self._episode = episode

    def _log_time(self, message: Message) -> int:
        """Returns the time [ns] under which a message is filed. Raises BagError for one that no bag can hold."""
        header = message.header
        if header.clock == "wall" and self._newest is not None:
            return self._newest
        ros_time(header.stamp_ns)
        if header.clock != "wall":
            begins = self._newest is None or self._episode is None or header.episode > self._episode
            self._newest = header.stamp_ns if begins else max(self._newest or 0, header.stamp_ns)
        return header.stamp_ns

    def _write(
        self, topic: str, prefix: str, env: int | None, message: Message, log_time: int, extra: dict[str, Any]
    ) -> None:
        kind = type(message).__name__
        full = prefix + topic
        parts, closing = mapping.encode(message, full, self._encoder(full, message), self.threads, **extra)
        records = []
        for part in parts:
            channel = self._channel(full + part.suffix, topic, part.ros_type, kind, part.name, env)
            records.append((channel, message.header.seq, part.stamp_ns, part.buffers))
        name = full + mapping.META if kind in mapping.ROS_TYPES else full
        channel = self._channel(name, topic, schemas.TEXT, kind, "meta", env)
        records.append((channel, message.header.seq, log_time, ros.text(closing)))
        # What events are packed into is nobody else's.
        given = isinstance(message, EventPacket) and message.raw is None
        self.container.add(records, kind not in mapping.UNCOMPRESSED, given)
        self.bytes[topic] += sum(len(b) for *_, buffers in records for b in buffers)

    def _encoder(self, topic: str, message: Message) -> Encoder | None:
        if self.event_encoding == "mono" or not isinstance(message, EventPacket):
            return None
        if topic not in self._encoders:
            self._encoders[topic] = events.evt3_encoder()
        return self._encoders[topic]

    def _channel(self, name: str, topic: str, ros_type: str, kind: str, part: str, env: int | None) -> int:
        """Returns the id of the channel of one part, which its first use registers. Parts of one name share a
        channel."""
        key = f"{name} {part}"
        if key not in self._channels:
            metadata = {TOPIC_KEY: topic, MESSAGE_KEY: kind, SUFFIX_KEY: part}
            if env is not None:
                metadata[ENV_KEY] = str(env)
            if ros_type not in self._schemas:
                definition = schemas.DEFINITIONS[ros_type].encode()
                self._schemas[ros_type] = self.container.add_schema(ros_type, "ros2msg", definition)
            self._channels[key] = self.container.add_channel(name, "cdr", self._schemas[ros_type], metadata)
            if kind not in self._described:
                self._described.add(kind)
                self.container.add_metadata(f"jsonschema.{kind}", {"schema": jsonform.schema(Message.TYPES[kind])})
        return self._channels[key]


def describe_run(launch_text: str, parameters: Mapping[str, Any], **values: Any) -> dict[str, dict[str, str]]:
    """Returns the metadata of a run: tables `launch` (the resolved launch file), `parameters` (JSON by node), `evis`
    (seed, ...).

    `values` (seed, run_id, mode, ...) are kept as text, with the versions of the packages that decide the bits.
    """
    from importlib.metadata import PackageNotFoundError, version

    versions = {}
    for package in ("evis", "numpy", "warp-lang", "mujoco", "mcap"):
        try:
            versions[f"version.{package}"] = version(package)
        except PackageNotFoundError:
            versions[f"version.{package}"] = "not installed"
    return {
        "evis": {**{k: str(v) for k, v in values.items()}, **versions},
        "launch": {"text": launch_text},
        "parameters": {node: json.dumps(values) for node, values in parameters.items()},
    }
