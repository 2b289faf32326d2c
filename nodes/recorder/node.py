"""Runs the recorder as a node: the topics that it is wired to go into one bag, with a small preview of every camera's
keyframes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from evis.bus.memory.device import device_of
from evis.config.params import Param, resolve
from evis.runtime.node import Input, Node
from msgs.header import Message
from nodes.recorder.handover import Handover

if TYPE_CHECKING:
    from nodes.recorder.recorder import Recorder

PARAMS = {
    "path": Param(str, "recording.mcap", "the bag; an older one of that name is kept as <name>.bak, .bak2, ..."),
    "topics": Param(list, [], "globs of topics to record besides the default ones (events, info, state, ...)"),
    "preview_hz": Param(float, 10.0, "rate of the rgb8 preview made from keyframes; 0 = none", "Hz", minimum=0.0),
    "event_encoding": Param(str, "mono", "of decoded events; evt3 cuts to 1 us", choices=("mono", "evt3")),
    "sync": Param(bool, False, "bring the bag to the disk every second: death of the machine takes 1 s, not 30"),
    "threads": Param(int, 0, "that encode and compress; 0 = one per core, at most 8", minimum=0, maximum=256),
}


class RecorderNode(Node):
    """Writes every message it receives; the port is the topic's name."""

    PARAMS: ClassVar[Mapping[str, Param]] = PARAMS
    INPUTS: ClassVar[Mapping[str, Input]] = {"messages": Input("*", join=False)}

    @classmethod
    def dynamic_inputs(cls, params: Mapping[str, Any], available: Iterable[str]) -> list[str]:
        """Names the topics of `available` that this recorder reads. Raises ParamError."""
        from evis.bag.selection import subscribed

        given = resolve("recorder", cls.PARAMS, params)
        return subscribed(available, given["topics"], given["preview_hz"])

    @classmethod
    def arrays_hz(cls, params: Mapping[str, Any], port: str) -> float | None:
        """Limits the rate of arrays to that of previews, for keyframes that are recorded as previews alone."""
        from evis.bag.selection import select

        given = resolve("recorder", cls.PARAMS, params)
        return None if select([port], given["topics"]) else given["preview_hz"] or None

    @classmethod
    def foreseen_among(cls, params: Mapping[str, Any], topics: Collection[str]) -> tuple[str, ...]:
        """Names wanted topics that no node publishes."""
        from evis.bag.selection import unpublished

        none = "no node of this graph publishes a topic like '{}': the bag has none of it"
        return tuple(none.format(glob) for glob in unpublished(topics, params["topics"]))

    def setup(self) -> None:
        """Opens the bag, and warns of wanted topics that no node publishes.

        A path that cannot be written is so known before the graph starts.
        """
        from evis.files.named_pipe import with_reader
        from nodes.recorder.recorder import Recorder

        p = self.params
        with with_reader(p["path"], lambda line: self.runtime.diagnose(self, "info", line)):
            self.recorder: Recorder = Recorder(
                p["path"],
                self.runtime.plan,
                p["topics"],
                p["preview_hz"],
                p["event_encoding"],
                p["sync"],
                p["threads"] or None,
            )
        self._handover = Handover(self.recorder.write)
        for line in self.foreseen_among(p, self.runtime.plan.topics.keys()):
            self.warn(line)
        if backup := self.recorder.writer.backup:
            self.runtime.diagnose(self, "info", f"the older {p['path']} is now {backup}")

    def receive(self, port: str, message: Message) -> None:
        """Hands a message of topic `port` to the thread that writes the bag."""
        self.recorder.count_missed(port, message.header)
        if device_of(message) is None:  # else it is none of those that arrays_hz asks for
            self._handover.put(port, message)
        self._count()

    def idle(self) -> None:
        """Releases recorded messages, also while no new ones come."""
        self._handover.release()

    def _count(self) -> None:
        for name, value in self.recorder.counters.copy().items():
            if self.count_total(name, value) and name == "late_syncs":
                self.warn("the disk took more than 1 s for a sync; if the machine dies now, more than 1 s is lost")

    def finish(self) -> None:
        """Closes the bag when all topics have ended."""
        self._handover.finish()
        self.recorder.close()
        self._count()

    def close(self) -> None:
        """Completes the bag, also after an error elsewhere."""
        recorder: Recorder | None = getattr(self, "recorder", None)
        if recorder is not None:
            self._handover.close()
            recorder.close()
            self._count()
