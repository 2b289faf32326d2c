"""Joins the inputs of a node by stamp."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from msgs.header import Message


class Join:
    """Queues a node's joined inputs, and returns one message per port once all of a stamp are there.

    Messages of one topic come in order. A stamp that some port skipped can never be completed: its messages are
    released and counted in `skipped`.
    """

    def __init__(self, ports: Iterable[str]) -> None:
        self.queues: dict[str, deque[Message]] = {port: deque() for port in ports}
        self.ended: set[str] = set()
        self.skipped = 0
        self._complete: list[dict[str, Message]] = []
        """What `gather` has found and not handed out yet."""

    def put(self, port: str, message: Message) -> None:
        """Adds a message, whose pin now belongs to the join."""
        self.queues[port].append(message)

    def end(self, port: str) -> None:
        """Notes that no more messages will come on a port."""
        self.ended.add(port)

    def ready(self) -> bool:
        """Tells whether `take` has something to return; releases what can never be completed."""
        if not self.queues:
            return False
        while all(self.queues.values()):
            keys = {port: queue[0].header.instant for port, queue in self.queues.items()}
            newest = max(keys.values())
            if all(key == newest for key in keys.values()):
                return True
            for port, key in keys.items():
                if key < newest:
                    self.queues[port].popleft().release()
                    self.skipped += 1
        return False

    def take(self) -> dict[str, Message]:
        """Returns one message per port, all of the same episode and stamp."""
        return {port: queue.popleft() for port, queue in self.queues.items()}

    def gather(self, least: int) -> list[dict[str, Message]]:
        """Returns what `take` would return for every stamp that is there, in order; nothing while these are fewer than
        `least` and more may come."""
        while self.ready():
            self._complete.append(self.take())
        if len(self._complete) < least and not self.ended:
            return []
        found, self._complete = self._complete, []
        return found

    def over(self) -> bool:
        """Tells whether nothing more can be completed: a port has ended and its queue is empty."""
        return any(port in self.ended and not queue for port, queue in self.queues.items())

    def clear(self) -> None:
        """Removes all messages and ends."""
        self.drop_rest()
        self.ended.clear()
        self.skipped = 0

    def drop_rest(self) -> int:
        """Releases what can no longer be joined, and returns how many messages that were."""
        rest = [m for queue in self.queues.values() for m in queue]
        rest += [m for complete in self._complete for m in complete.values()]
        for message in rest:
            message.release()
        self._complete = []
        for queue in self.queues.values():
            queue.clear()
        return len(rest)
