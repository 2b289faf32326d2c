"""Hands messages to a thread that records them, so that the graph runs on meanwhile."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

from evis.bag.mcap.background_worker import BackgroundWorker
from msgs.header import Message

MAX_BYTES = 64 << 20
"""Bytes of messages that may wait; whoever has more waits."""
MAX_MESSAGES = 32
"""Messages of one topic that may wait, be they small: with those under way fewer than the slots that it has."""


class Handover:
    """Queues messages for the recording thread, in order. To be called from one thread, that of the bus.

    take: called by the other thread with the topic and the message.
    """

    def __init__(self, take: Callable[[str, Message], None]) -> None:
        self._take = take
        self._worker = BackgroundWorker("recorder", MAX_BYTES)
        self._kept: deque[tuple[str, Message]] = deque()
        self._of_topic: Counter[str] = Counter()
        self._told = False

    def put(self, topic: str, message: Message) -> None:
        """Adds a message; waits while the queue is full. Raises what `take` raised for an earlier message."""
        self.release()
        while self._of_topic[topic] >= MAX_MESSAGES and self._worker.error is None:
            self._worker.wait_below(len(self._kept))
            self.release()
        message.keep()
        self._kept.append((topic, message))
        self._of_topic[topic] += 1
        size = sum(array.nbytes for array in message.arrays().values())
        self._worker.put(lambda: self._take(topic, message), size)

    def release(self) -> None:
        """Releases the messages that were recorded. Raises, once, what `take` raised."""
        for _ in range(len(self._kept) - self._worker.unfinished):
            self._release_oldest()
        if self._worker.error is not None and not self._told:
            self._told = True
            raise self._worker.error

    def finish(self) -> None:
        """Waits until all are recorded, or one has failed; raises what `take` raised, unless it was raised before."""
        self._worker.wait()
        self.release()

    def close(self) -> None:
        """Ends the thread and releases all messages that are left. A second call does nothing."""
        self._worker.wait()
        self._worker.close()
        while self._kept:
            self._release_oldest()

    def _release_oldest(self) -> None:
        topic, message = self._kept.popleft()
        self._of_topic[topic] -= 1
        message.release()
