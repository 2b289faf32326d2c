"""Measures rate, bandwidth and delay of a topic from what a tap sees of it."""

from __future__ import annotations

import time

from msgs.header import Message


class TopicRates:
    """Collects arrivals. A tap skips messages when they come faster than its limit; sequence numbers tell how many."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self.messages = 0
        self._bytes = 0
        self._first = self._last = (0.0, 0)
        self._numbers: dict[str, tuple[int, int]] = {}
        """First and last sequence number of each sender."""
        self._lags: list[float] = []
        self._wall = False

    def add(self, arrived: float, message: Message, sender: str = "") -> None:
        """Takes one message that came at `arrived` (time.monotonic()). sender: each numbers its own."""
        header = message.header
        if header.seq < self._numbers.get(sender, (0, header.seq))[1]:  # a publisher that started again
            self._begin()
        self._last = arrived, header.stamp_ns
        if not self.messages:
            self._first = self._last
        self._numbers[sender] = self._numbers.get(sender, (header.seq, 0))[0], header.seq
        self.messages += 1
        self._bytes += sum(int(array.nbytes) for array in message.arrays().values())
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
        published = sum(last - first + 1 for first, last in self._numbers.values())
        return {
            "hz": (published - 1) / self._span,
            "published": published,
            "seen": self.messages,
            "window_s": self._span,
        }

    def bw(self) -> dict[str, float | int]:
        """Returns array bytes per second at the publisher, from the mean size of the messages seen."""
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
