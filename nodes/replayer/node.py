"""Publishes a bag's messages on their topics as recorded, as fast as the graph takes them or at a set pace."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evis.config.params import Param, ParamError, resolve
from evis.runtime.node import Node, Output
from evis.runtime.pacing import FAST, Pacer, parse_pace
from msgs.header import Header, Message
from nodes.replayer.descriptions import Descriptions, check_pixels, descriptions_until

if TYPE_CHECKING:
    from evis.bag.reader import BagReader

PARAMS = {
    "bag": Param(str, "", "the bag to replay"),
    "topics": Param(list, [], "globs of topics to play, all when none is given"),
    "exclude": Param(list, [], "globs of topics to leave out"),
    "regenerate": Param(
        bool, False, "leave out what the graph makes again from keyframes: frames, samples, events, labels"
    ),
    "samples_apart": Param(bool, True, "keyframes may hold the samples of supersampled pixels apart, for rigid"),
    "pace": Param(str, "fast", "fast, realtime, or a speed such as 0.5, half as fast as recorded"),
    "start": Param(float, 0.0, "where in the bag to begin, after its first stamp", "s", minimum=0.0),
    "duration": Param(float, None, "seconds to replay", "s", minimum=0.0, optional=True),
    "again": Param(bool, False, "play it again and again, after a short rest and as further episodes, until stopped"),
}
MAX_SLEEP_S = 0.05
"""Longest sleep in one step, so that the graph can be stopped."""
MAX_NAMED = 8
"""Most topics that are named in a warning."""
APART_NS = 10_000_000_000
"""A silence longer than this between messages of two clocks [ns] is none: one camera counts from its start, another
from 1970."""
REST_S = 1.0
"""Pause between two rounds, so that the end can be seen [s]."""


class ReplayerNode(Node):
    """Publishes the messages of a bag; each topic is a port of its own name."""

    PARAMS: ClassVar[Mapping[str, Param]] = PARAMS
    SOURCE: ClassVar[bool] = True
    REMEDY: ClassVar[str] = "a bag has it where it was recorded with `--record-topics {topic}`"

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names what concerns keyframes alone of which frames are made, where none are."""
        return {} if params["regenerate"] else {"samples_apart": "no frames are made anew (regenerate:=true)"}

    @classmethod
    def dynamic_outputs(cls, params: Mapping[str, Any]) -> dict[str, Output]:
        """Returns the ports, which depend on the bag and on what is left out. Raises BagError, ParamError."""
        from evis.bag import BagError
        from evis.bag.reader import BagReader
        from nodes.replayer.choice import topics_to_play

        given = resolve("replayer", cls.PARAMS, params)
        if not given["bag"]:
            raise ParamError("replayer: which bag? give bag:=FILE.mcap")
        try:
            parse_pace(given["pace"])
        except ValueError as error:
            raise ParamError(f"replayer: {error}") from None
        with BagReader(given["bag"]) as reader:
            if reader.problem and not reader.topics:
                raise BagError(f"{reader.path} ends before its first topic ({reader.problem}); nothing can be played")
            chosen = topics_to_play(
                reader.topics, given["topics"], given["exclude"], given["regenerate"], str(reader.path)
            )
            if chosen and reader.start_ns + round(given["start"] * 1e9) > reader.end_ns:
                length = (reader.end_ns - reader.start_ns) / 1e9
                raise ParamError(f"replayer: start is {given['start']:g} s, but {reader.path} is {length:g} s long")
        return {topic: Output(topic) for topic in chosen}

    def setup(self) -> None:
        """Opens the bag and publishes the latched descriptions of the cameras."""
        from evis.bag.reader import BagReader

        ports = list(self.dynamic_outputs(self.params))
        speed = parse_pace(self.params["pace"])
        self._pacer = None if speed == FAST else Pacer(speed)
        self._paced = Header(0)
        """Of the last message whose time was waited for."""
        self._first_episode = self._last_episode = 0
        """Of this round, as it is published, and the last one so far."""
        self._rest_until = 0.0
        self._damage_told = False
        self._reader: BagReader = BagReader(self.params["bag"])
        if self._reader.problem:
            self.warn(f"{self._reader.path} is torn: {self._reader.problem}; replaying what can be read")
        self._warn_of_unknown_topics()
        start = self._reader.start_ns + round(self.params["start"] * 1e9)
        length = self.params["duration"]
        self._part = ports, start, None if length is None else start + round(length * 1e9)
        """Topics, first and last time [ns] of a round."""
        self._messages: Iterator[tuple[str, Message]] = self._reader.messages(*self._part) if ports else iter(())
        self._next = next(self._messages, None)
        is_part = bool(self.params["start"]) or length is not None
        if ports and is_part and self._next is None and not self._reader.skipped:
            self.warn(
                f"{self._reader.path}: {self._words_of_part()} there is no message of {', '.join(ports[:MAX_NAMED])}"
            )
        self._find_descriptions(ports, start)
        self._publish_early()
        if self._next is not None and self._descriptions.covers(*self._next):
            self._next = self._next_message()

    def _find_descriptions(self, ports: Iterable[str], start: int) -> None:
        """Finds the descriptions of the cameras that hold where the replay begins, at `start` [ns]."""
        skipped = self._reader.skipped
        episode = self._next[1].header.episode if self._next else 0
        cameras = [port for port in ports if self._reader.topics[port] == "CameraInfo"]
        found = {topic: descriptions_until(self._reader, topic, start, episode) for topic in cameras}
        known = {topic: infos[-1] for topic, infos in found.items() if infos}
        # A replay of the whole bag has those that were replaced before anything came, too.
        first = 0 if not self.params["start"] else -1
        self._early = deque((topic, info) for topic, infos in found.items() for info in infos[first:])
        """Descriptions that are published before anything else, whatever the pace is."""
        self._warn_of_separate_clocks(known)
        if self.params["regenerate"] and not self.params["samples_apart"]:
            check_pixels(self._reader, known)
        self._descriptions = Descriptions(known)
        self._outdated: list[str] = []
        """Topics whose description must be published again as the round begins."""
        self._skipped_before = self._reader.skipped - skipped
        """Damaged parts that were met on the way to the descriptions."""

    def _words_of_part(self) -> str:
        """Words which part of the bag is replayed, by its own seconds."""
        start, length = self.params["start"], self.params["duration"]
        return f"from {start:g} s on" if length is None else f"from {start:g} to {start + length:g} s"

    def _warn_of_unknown_topics(self) -> None:
        """Warns of wanted topics of the bag that cannot be played."""
        from nodes.replayer.choice import unknown_topics

        there = {stream.topic: stream.kind for stream in self._reader.streams.values()}
        if names := unknown_topics(there, self.params["topics"], self.params["exclude"]):
            more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
            told = ", ".join(names[:MAX_NAMED]) + more
            self.warn(f"{self._reader.path}: not played, for EVIS has no topics of such a name and type: {told}")

    def _warn_of_separate_clocks(self, descriptions: Mapping[str, Message]) -> None:
        """Warns where cameras have clocks of their own, whose times cannot be compared."""
        of_clock: dict[str, list[str]] = {}
        for topic, info in sorted(descriptions.items()):
            of_clock.setdefault(info.header.clock, []).append(topic.rpartition("/")[0])
        if len(of_clock) > 1:
            told = " and ".join(f"{clock} ({', '.join(names[:MAX_NAMED])})" for clock, names in of_clock.items())
            first = next(iter(of_clock.values()))[0]
            self.warn(
                f"{self._reader.path}: the clocks {told} have no time in common: messages come in order of their "
                f"numbers, episode by episode, and start and duration go by these; topics:={first}/* plays one alone"
            )

    def _publish_descriptions(self, topics: Iterable[str]) -> None:
        """Publishes the descriptions that hold where the round begins."""
        for topic in topics:
            info: Any = self._descriptions.at_start[topic]
            self.publish(topic, self._renumber_episodes(replace(info, header=replace(info.header))))

    def _publish_early(self) -> None:
        """Publishes the next of the descriptions that come before anything else, of each camera one."""
        sent: set[str] = set()
        for _ in range(len(self._early)):
            topic, info = self._early.popleft()
            if topic in sent:
                self._early.append((topic, info))
            else:
                sent.add(topic)
                whole: Any = info
                self.publish(topic, replace(whole, header=replace(whole.header)))

    def _next_message(self) -> tuple[str, Message] | None:
        """Reads the next message to be played; None at the end."""
        return next((found for found in self._messages if not self._descriptions.covers(*found)), None)

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Publishes the messages of one stamp, at most one of each topic."""
        if time.monotonic() < self._rest_until:
            time.sleep(MAX_SLEEP_S)
            return True
        if self._early:
            self._publish_early()
            return True
        if self._next is None:
            self._warn_of_damage()
            return False
        instant = self._next[1].header.instant
        if (wait := self._wait_s(self._next[1].header)) > 0:
            time.sleep(min(wait, MAX_SLEEP_S))
            if wait > MAX_SLEEP_S:
                return True
        self._publish_descriptions(self._outdated)
        sent, self._outdated = set(self._outdated), []
        while self._next is not None:
            topic, message = self._next
            if topic in sent or message.header.instant != instant:
                return True
            sent.add(topic)
            self._descriptions.published(topic)
            self.publish(topic, self._renumber_episodes(message))
            self._next = self._next_message()
        self._warn_of_damage()
        if self.params["again"]:
            self._begin_round()
            return True
        return False

    def _wait_s(self, header: Header) -> float:
        """Returns the time until a message is due [s], 0 without a pace; counts late messages."""
        if self._pacer is None:
            return 0.0
        since_ns = header.stamp_ns - self._paced.stamp_ns
        anew = header.episode > self._paced.episode and since_ns < 0  # the distances are this episode's
        if anew or (header.clock != self._paced.clock and since_ns > APART_NS):
            self._pacer.restart()
        self._paced = replace(header)  # whose episode changes where it is published in a later round
        wait = self._pacer.wait_s(header.stamp_ns)
        if wait <= MAX_SLEEP_S:  # it is sent within this step
            self._pacer.passed(header.stamp_ns)
            self.count_total("late_ms_max", self._pacer.late_ms_max)
        return wait

    def finish(self) -> None:
        """Reports how the pace was kept."""
        if self._pacer is not None:
            self.result("pace", self._pacer.result())

    def _warn_of_damage(self) -> None:
        """Warns, once the bag was read to its end, of what was left out as damaged."""
        # What is damaged beside the descriptions is met again, unless it is of another time than what is played.
        skipped = self._reader.skipped - self._skipped_before or self._skipped_before
        if skipped and not self._damage_told:
            self._damage_told = True
            self.count("damaged", skipped)
            self.warn(f"{self._reader.path}: {skipped} damaged parts left out: {self._reader.first_problem}")

    def _begin_round(self) -> None:
        self._first_episode = self._last_episode + 1
        self._outdated = self._descriptions.restart()
        self._messages = self._reader.messages(*self._part)
        self._next = self._next_message()
        if self._pacer is not None:
            self._pacer.restart()
        self._rest_until = time.monotonic() + REST_S

    def _renumber_episodes(self, message: Message) -> Message:
        """Renumbers the episodes of a message, so that they continue those of the round before."""
        if self._first_episode:
            message.header.episode += self._first_episode
            episodes = getattr(message, "episodes", None)
            if episodes is not None:
                message.episodes = np.asarray(episodes) + np.int32(self._first_episode)  # type: ignore[attr-defined]
        self._last_episode = max(self._last_episode, message.header.episode)
        return message

    def close(self) -> None:
        """Closes the bag."""
        reader: BagReader | None = getattr(self, "_reader", None)
        if reader is not None:
            reader.close()
