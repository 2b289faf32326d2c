"""Matches messages of several shares of the environments by their stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from msgs.header import Message

Key = tuple[int, int, int]
"""Episode, stamp, and how many of that stamp came before."""


@dataclass
class Waiting:
    """Holds a message that waits for those of other shares. after_loss: messages before it did not arrive."""

    key: Key
    message: Message
    after_loss: bool


class Alignment:
    """Matches messages of the shares by episode and stamp; several of one stamp in their order.

    A share may publish nothing at a stamp at which others do: a sensor that holds no events back at the end. Where a
    message was lost instead (on a tap), a gap in the share's sequence numbers tells. Messages that lack one which was
    lost are released unused; `lost` counts them.
    """

    def __init__(self, shares: int) -> None:
        self._queues: list[deque[Waiting]] = [deque() for _ in range(shares)]
        self._last: list[tuple[Key, int] | None] = [None] * shares
        """Key and sequence number of the last message of each."""
        self.lost = 0

    def put(self, share: int, message: Message) -> None:
        """Takes over a message, with one pin."""
        header, last = message.header, self._last[share]
        key, after_loss = (header.episode, header.stamp_ns, 0), False
        if last is not None:
            again = last[0][:2] == key[:2]
            key = (*key[:2], last[0][2] + 1 if again else 0)
            after_loss = header.seq != last[1] + 1
        self._last[share] = key, header.seq
        self._queues[share].append(Waiting(key, message, after_loss))

    def complete(self, over: bool = False) -> Iterator[list[Message | None]]:
        """Yields matched messages, one per share, None for a share without. over: no more messages will come."""
        while any(self._queues) and (over or all(self._queues)):
            key = min(queue[0].key for queue in self._queues if queue)
            mine = [bool(queue) and queue[0].key == key for queue in self._queues]
            broken = any(queue and queue[0].after_loss for queue, own in zip(self._queues, mine) if not own)
            row = [queue.popleft().message if own else None for queue, own in zip(self._queues, mine)]
            if not broken:
                yield row
                continue
            for message in row:
                if message is not None:
                    message.release()
                    self.lost += 1

    def release(self) -> None:
        """Releases all messages that wait."""
        for queue in self._queues:
            while queue:
                queue.popleft().message.release()
