"""Hands messages to a thread that records them, so that the graph goes on meanwhile."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

from evis.bag.mcap.behind import Behind
from msgs.header import Message

MOST = 64 << 20
"""Bytes of messages that may wait; whoever has more waits."""
MOST_MESSAGES = 32
"""Messages of one topic that may wait, be they small: with those under way fewer than the slots that it has."""


class Handover:
    """Keeps messages until a thread has taken them, in their order. Called from one thread, that of the bus.

    take: called by the other thread with the topic and the message.
    """

    def __init__(self, take: Callable[[str, Message], None]) -> None:
        self._take = take
        self._behind = Behind("recorder", MOST)
        self._kept: deque[tuple[str, Message]] = deque()
        self._of_topic: Counter[str] = Counter()
        self._told = False

    def put(self, topic: str, message: Message) -> None:
        """Adds a message; waits while too many do. Raises what `take` has raised of an earlier one."""
        self.release()
        while self._of_topic[topic] >= MOST_MESSAGES and self._behind.error is None:
            self._behind.wait_below(len(self._kept))
            self.release()
        message.keep()
        self._kept.append((topic, message))
        self._of_topic[topic] += 1
        size = sum(array.nbytes for array in message.arrays().values())
        self._behind.put(lambda: self._take(topic, message), size)

    def release(self) -> None:
        """Releases the messages that were taken. Raises what `take` has raised, once."""
        for _ in range(len(self._kept) - self._behind.undone):
            self._let_go()
        if self._behind.error is not None and not self._told:
            self._told = True
            raise self._behind.error

    def finish(self) -> None:
        """Waits until all are taken, or one has failed, and raises what it has raised if nobody was told."""
        self._behind.wait()
        self.release()

    def close(self) -> None:
        """Ends the thread and releases all that is left. A second call does nothing."""
        self._behind.wait()
        self._behind.close()
        while self._kept:
            self._let_go()

    def _let_go(self) -> None:
        topic, message = self._kept.popleft()
        self._of_topic[topic] -= 1
        message.release()
