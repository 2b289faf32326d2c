"""Writes messages to a bag, makes previews of keyframes, and counts missed messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from evis.bag.selection import preview_sources, select
from evis.bag.writer import BagWriter, describe_run
from evis.runtime.plan import Plan
from msgs.camera import Keyframe
from msgs.header import Header, Message, missed_between
from msgs.topics import SYSTEM_TOPICS
from nodes.recorder.outcome import Outcome
from nodes.recorder.preview import PreviewMaker


class Recorder:
    """Records messages to a bag. `counters`: messages, previews, lost, late_syncs, and at the end bytes.

    sync: bring the bag to the disk itself once a second; a sync that takes longer than that is counted as late.
    threads: that encode and compress, see `BagWriter`.
    """

    def __init__(
        self,
        path: str | Path,
        plan: Plan,
        globs: Sequence[str],
        preview_hz: float,
        encoding: str,
        sync: bool = False,
        threads: int | None = None,
    ) -> None:
        plan = plan.redacted()  # who gets the bag gets no secret of the run
        self.counters: Counter[str] = Counter()
        self._globs = globs
        self._seen: dict[str, int] = {}
        self._lost: Counter[str] = Counter()
        self._outcome = Outcome()
        self._selected: dict[str, bool] = {}
        unmade = {
            topic for node in plan.nodes.values() if node.dormant and not node.joins for topic in node.outputs.values()
        }
        sources = preview_sources(set(plan.open_topics()) - (unmade - set(globs))) if preview_hz else []
        self._previews = {topic: PreviewMaker(topic, preview_hz) for topic in sources}
        parameters = {name: node.params for name, node in plan.nodes.items()}
        run = {"name": plan.name, "run_id": plan.run_id, "mode": plan.mode, "seed": plan.seed}
        arguments = {f"arg.{key}": value for key, value in plan.args.items()}
        # A launch file may make the scene's arguments from its own.
        given = [params["scene_args"] for params in parameters.values() if params.get("scene_args")]
        arguments |= {"arg.scene_args": given[0]} if given else {}
        arguments |= {f"chosen.{key}": value for key, value in plan.chosen.items()}
        metadata = describe_run(plan.launch_text, parameters, **run, **arguments)
        self.writer = BagWriter(path, metadata, event_encoding=encoding, sync=sync, threads=threads)

    def receive(self, topic: str, message: Message) -> None:
        """Counts the messages missed before this one and writes it; its arrays are free when this returns.

        Raises BagError.
        """
        self.count_missed(topic, message.header)
        self.write(topic, message)

    def selects(self, topic: str) -> bool:
        """Tells whether messages of a topic are written as they are."""
        if topic not in self._selected:
            self._selected[topic] = bool(select([topic], self._globs))
        return self._selected[topic]

    def write(self, topic: str, message: Message) -> None:
        """Writes a message, and the preview made of it; its arrays are free when this returns. Raises BagError."""
        self._outcome.take(topic, message)
        if self.selects(topic):
            self.writer.write(topic, message)
            self.counters["messages"] += 1
        maker = self._previews.get(topic)
        if maker is not None and isinstance(message, Keyframe):
            image = maker.update(message, self.writer.threads)
            if image is not None:
                self.writer.write(maker.topic(message), image)
                self.counters["previews"] += 1
        self._count_late()

    def _count_late(self) -> None:
        syncer = self.writer.container.syncer
        if syncer is not None and syncer.late:
            self.counters["late_syncs"] = syncer.late

    def count_missed(self, topic: str, header: Header) -> None:
        """Counts the messages missed before this one, of a topic whose messages are all given, in their order."""
        seq = header.seq
        missed = missed_between(self._seen.get(topic, seq), seq)
        if missed and topic not in SYSTEM_TOPICS:
            self._lost[topic] += missed
            self.counters["lost"] += missed
        self._seen[topic] = seq

    def close(self) -> None:
        """Completes the bag. A second call does nothing."""
        self.counters["bytes"] = sum(self.writer.bytes.values())
        lost = {topic: str(count) for topic, count in self._lost.items()}
        self.writer.close(({"lost": lost} if lost else {}) | self._outcome.metadata())
        self._count_late()
