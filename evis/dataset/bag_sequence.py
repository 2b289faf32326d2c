"""Reads a labelled bag as the steps of a simulation, so that it can be written in any layout."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError, environments
from evis.bag.reader import BagReader
from evis.dataset.about import About
from evis.dataset.errors import refused_by_place
from evis.dataset.layouts import LayoutError, writer_of
from evis.dataset.layouts.sample import DENSE, EVENTS, TABLES
from evis.events.codecs.decoder import Decoder, decoder_for
from evis.simulation.step import Step, value_of
from msgs.camera import CameraInfo, EventPacket, Image, Labels
from msgs.header import Message

WANTED = {"events": "EventPacket", "labels": "Labels", "depth": "Depth", "ids": "Ids", "image": "Image"}
"""Outputs of a camera that a sequence has, and the messages that bring them."""
_LOOK = 2
"""First labels to look at for what kinds there are: those of keyframe 0 have no interval behind them."""


def export(bag: str | Path, layout: str, out: str | Path, env: int | None = None) -> dict[str, Any]:
    """Writes a bag into an empty folder in one of the layouts, and tells what was written.

    env: the environment to take of several. Raises BagError, LayoutError for what the layout cannot hold, and OSError
    where the disk refuses; then nothing of the sequence is left.
    """
    with BagReader(bag) as reader:
        sequence = BagSequence(reader, env)
        before = reader.skipped  # what was looked at beforehand is read again
        with _all_or_nothing(Path(out)):
            writer = writer_of(layout)(Path(out), sequence.about)
            for step in sequence.steps():
                writer.add(step)
            writer.close()
        left_out = (f"images on {topic} are left out: no exposure is told" for topic in sequence.unexposed)
        notes = [*writer.notes, *left_out]
        result = {"layout": layout, "out": str(out), "events": sum(writer.counts.values()), "notes": notes}
        if reader.skipped > before:
            result |= {"damaged": reader.skipped - before, "damage": reader.first_problem}
        return result | ({"problem": reader.problem} if reader.problem else {})


@contextlib.contextmanager
def _all_or_nothing(out: Path) -> Iterator[None]:
    """Takes away what an error left in a folder that was empty or not there. Raises OSError that names the folder, and
    LayoutError for what is there and no folder, which stays.
    """
    was_there = out.is_dir()
    if not was_there and os.path.lexists(out):
        raise LayoutError(f"{out} is there and is no folder; a sequence goes into a folder of its own")
    empty = not was_there or not any(out.iterdir())
    try:
        yield
    except BaseException as error:
        if empty:
            for path in out.iterdir() if was_there else [out]:
                shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        too_large = errno.EFBIG if os.strerror(errno.EFBIG) in str(error) else 0
        number = refused_by_place(error) or too_large
        if not number:
            raise
        raise OSError(
            f"{out}: {os.strerror(number)}; nothing is left of it; name a folder where there is room"
        ) from None


class BagSequence:
    """Reads a bag of one episode step by step. about: what the bag tells of itself."""

    def __init__(self, reader: BagReader, env: int | None = None) -> None:
        """Looks for cameras and what there is of them. Raises BagError for a bag without events or cameras' infos."""
        self._reader, self._env = reader, env
        self._decoders: dict[str, Decoder] = {}
        self.unexposed: dict[str, None] = {}
        """Topics of another program's images, whose exposure nothing tells, once the steps have been gone over."""
        self.topics = {
            topic: (topic[1:].rpartition("/")[0], output)
            for topic, kind in sorted(reader.topics.items())
            if WANTED.get(output := topic.rpartition("/")[2]) == kind
        }
        cameras = dict.fromkeys(camera for camera, output in self.topics.values() if output == "events")
        if not cameras:
            raise BagError(reader.lacks("/<cam>/events"))
        infos = {camera: self._info(camera) for camera in cameras}
        # The left camera of a stereo rig is the first one.
        infos = dict(sorted(infos.items(), key=lambda pair: pair[1].baseline))
        self.topics = {topic: named for topic, named in self.topics.items() if named[0] in infos}
        first = next(iter(infos))
        packet = next(self._messages([f"/{first}/events"]), None)
        if not isinstance(packet, EventPacket):
            why = f" ({reader.problem or reader.first_problem})" if reader.problem or reader.first_problem else ""
            raise BagError(f"{reader.path} has no packet of /{first}/events that can be read{why}; record it anew")
        start = packet.t0_ns
        told = reader.metadata.get("evis", {})
        arguments = {key.removeprefix("arg."): value for key, value in told.items() if key.startswith("arg.")}
        seed = _whole(told.get("seed")) + (env or 0)  # environment k is a run of its own with seed + k
        if env is not None:
            alone = {"seed": str(seed), "envs": "1"}
            arguments |= {key: value for key, value in alone.items() if key in arguments}
        self.about = About(
            Path(reader.path).stem, arguments.get("scene", told.get("name", "")), arguments, seed,
            reader.end_ns - start, infos[first].keyframe_rate, infos, self._kinds(first), start,
        )  # fmt: skip

    def steps(self) -> Iterator[Step]:
        """Yields what there is of each stamp, in order. Raises LayoutError for a bag of several episodes."""
        at: int | None = None
        episode: int | None = None
        found: dict[str, dict[str, Any]] = {}
        for topic, message in self._named(self.topics):
            header, (camera, output) = message.header, self.topics[topic]
            if isinstance(message, Image) and not message.exposure_ns:
                if header.clock == "ros":
                    self.unexposed[topic] = None
                continue  # of ours, a preview for people, which no sensor has seen
            if episode not in (None, header.episode):
                raise LayoutError(f"{self._reader.path} has several episodes; a sequence is one: record each by itself")
            episode = header.episode
            if found and (header.stamp_ns != at or output in found.get(camera, {})):
                yield self._step(at, found)
                found = {}
            at = header.stamp_ns
            found.setdefault(camera, {})[output] = value_of(message)
        if found:
            yield self._step(at, found)

    def _step(self, stamp_ns: int | None, found: dict[str, dict[str, Any]]) -> Step:
        assert stamp_ns is not None
        ordered = {camera: found[camera] for camera in self.about.cameras if camera in found}
        return Step(stamp_ns, np.zeros(1, np.int32), ordered, {}, False)

    def _messages(self, topics: list[str]) -> Iterator[Message]:
        return (message for _, message in self._named(topics))

    def _named(self, topics: Any) -> Iterator[tuple[str, Message]]:
        for topic, message in self._reader.messages(list(topics)):
            envs = message.envs if isinstance(message, Image) else environments.count(message)
            if envs > 1 and self._env is None:
                raise LayoutError(f"{self._reader.path} has {envs} environments; name one of them: --env 0")
            shared = isinstance(message, CameraInfo)  # its rows may stand for all environments
            if self._env is not None and envs and not shared and not 0 <= self._env < envs:
                there = f"0 to {envs - 1}" if envs > 1 else "0 alone"
                raise LayoutError(f"{self._reader.path} has no environment {self._env}; it has {there}")
            if self._env is not None and (envs > 1 or environments.tabular(message)):
                found = environments.of_one(message, self._env)
                if found is None:
                    continue
                message = found
            yield topic, self._decoded(topic, message) if isinstance(message, EventPacket) else message

    def _decoded(self, topic: str, packet: EventPacket) -> EventPacket:
        """The packet with its events; a sensor's own bytes are decoded by one decoder, which keeps its state."""
        if packet.t is not None:
            return packet
        try:
            decoder = self._decoders.setdefault(topic, decoder_for(packet.encoding, packet.width, packet.height))
        except ValueError as error:
            raise BagError(f"{topic}: {error}") from None
        events = decoder.decode(b"" if packet.raw is None else packet.raw.tobytes())
        return replace(packet, t=events.t, x=events.x, y=events.y, p=events.p)

    def _info(self, camera: str) -> CameraInfo:
        topic = f"/{camera}/info"
        info = next(self._messages([topic]), None) if topic in self._reader.topics else None
        if not isinstance(info, CameraInfo):
            bag, told = self._reader, f"{topic}, which tells the size of {camera}"
            raise BagError(
                f"{bag.path} ends before {told} ({bag.problem}); nothing of that camera can be written"
                if bag.problem
                else f"{bag.path} has no {told}; record it too"
            )
        return info if self._env is None else environments.info_alone(info, self._env)

    def _kinds(self, camera: str) -> tuple[str, ...]:
        topic, found = f"/{camera}/labels", dict[str, None]()
        if topic in self._reader.topics:
            for _, message in zip(range(_LOOK), self._messages([topic])):
                assert isinstance(message, Labels)
                kinds = (*DENSE.items(), *TABLES.items(), ("events", EVENTS))
                found |= dict.fromkeys(kind for kind, names in kinds if getattr(message, names[0]) is not None)
        return tuple(found)


def _whole(text: str | None) -> int:
    return int(text) if text is not None and text.lstrip("-").isdecimal() else 0
