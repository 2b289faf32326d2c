"""Measures rate, bandwidth and delay of a topic from what a tap sees of it."""

from __future__ import annotations

import time

from msgs.codec import encode
from msgs.header import Message

_BURST = 0.25
"""Messages of a sender within a smaller part of all the time say nothing of its rate but how many they were."""


class _Sender:
    """Counts the messages of one sender by their numbers, and fits the rate at which these grow.

    What comes in bursts, as the heartbeats of all nodes of a process, has more messages than its first and last one
    lie apart at its rate; a line through all of them does not care.
    """

    def __init__(self, arrived: float, seq: int) -> None:
        self._first, self._last = (arrived, seq), (arrived, seq)
        self._n = 0
        self._sums = [0.0] * 4  # t, seq, t^2, t seq, from the first message

    def add(self, arrived: float, seq: int) -> None:
        """Takes the number of a message that came at `arrived`, the first one's too."""
        t, number = arrived - self._first[0], seq - self._first[1]
        self._n += 1
        self._sums = [s + v for s, v in zip(self._sums, (t, number, t * t, t * number))]
        self._last = arrived, seq

    @property
    def newest(self) -> int:
        """Returns the number of the last message."""
        return self._last[1]

    @property
    def published(self) -> int:
        """Returns how many messages were sent from the first to the last, those that were missed too."""
        return self._last[1] - self._first[1] + 1

    def hz(self, span: float) -> float:
        """Returns messages per second; span: time in which any sender was heard [s]."""
        if self._last[0] - self._first[0] <= _BURST * span:
            return self.published / span
        t, number, squares, products = (s / self._n for s in self._sums)
        return (products - t * number) / (squares - t * t)


class TopicRates:
    """Collects arrivals. A tap skips messages when they come faster than its limit; sequence numbers tell how many."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self.messages = 0
        self._bytes = 0
        self._first = self._last = (0.0, 0)
        self._senders: dict[str, _Sender] = {}
        self._lags: list[float] = []
        self._wall = False

    def add(self, arrived: float, message: Message, sender: str = "") -> None:
        """Takes one message that came at `arrived` (time.monotonic()). sender: each numbers its own."""
        header = message.header
        if sender in self._senders and header.seq < self._senders[sender].newest:  # a publisher that started again
            self._begin()
        self._last = arrived, header.stamp_ns
        if not self.messages:
            self._first = self._last
        self._senders.setdefault(sender, _Sender(arrived, header.seq)).add(arrived, header.seq)
        self.messages += 1
        self._bytes += sum(memoryview(frame).nbytes for frame in encode(message))
        self._wall = header.clock == "wall"
        if self._wall:
            self._lags.append(time.time() - header.stamp_ns / 1e9)
        else:
            # Another clock: only how the lag changes can be known, against the least seen.
            self._lags.append(arrived - header.stamp_ns / 1e9)

    @property
    def _span(self) -> float:
        return max(self._last[0] - self._first[0], 1e-9)

    def hz(self) -> dict[str, float | int]:
        """Returns messages per second at the publishers, and how many of them this tap saw."""
        return {
            "hz": sum(sender.hz(self._span) for sender in self._senders.values()),
            "published": sum(sender.published for sender in self._senders.values()),
            "seen": self.messages,
            "window_s": self._span,
        }

    def bw(self) -> dict[str, float | int]:
        """Returns bytes per second at the publisher, headers and arrays, from the mean size of the messages seen."""
        mean = self._bytes / self.messages
        return {"bytes_per_s": float(self.hz()["hz"]) * mean, "mean_bytes": mean, "seen": self.messages}

    def delay(self) -> dict[str, float | int]:
        """Returns the lag behind the stamps [s]: absolute for the wall clock, otherwise over the least lag seen."""
        stamps = (self._last[1] - self._first[1]) / 1e9
        least = 0.0 if self._wall else min(self._lags)
        lags = [lag - least for lag in self._lags]
        return {
            "least_s": min(lags),
            "mean_s": sum(lags) / len(lags),
            "most_s": max(lags),
            "stamp_rate": stamps / self._span,
            "seen": self.messages,
        }
