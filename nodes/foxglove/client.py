"""Holds one client's subscriptions, and of each the newest message that waits for it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

from nodes.foxglove.channels import Channel, Frame


class Client:
    """Holds what one client has subscribed to and has still to get; every method is safe from any thread.

    wake: called, from any thread, when there is something to send.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._lock = threading.Lock()
        self._channels: dict[int, Channel] = {}
        """Of each subscription."""
        self._subscriptions: dict[int, int] = {}
        """Of each channel."""
        self._waiting: dict[int, list[Frame]] = {}
        """Of each subscription, the one that has waited longest first."""
        self._lacking: set[int] = set()
        """Channels of which it was told that messages are without them."""
        self._texts: deque[str] = deque()
        self._left_out = 0
        self._missed = 0

    def subscribe(self, subscription: int, channel: Channel) -> None:
        """Adds a subscription. Raises ValueError where its id or channel is taken."""
        with self._lock:
            if subscription in self._channels:
                raise ValueError(f"subscription {subscription} is there already")
            if channel.number in self._subscriptions:
                raise ValueError(f"channel {channel.number} is subscribed to already")
            self._channels[subscription] = channel
            self._subscriptions[channel.number] = subscription

    def unsubscribe(self, subscription: int) -> Channel:
        """Ends a subscription and returns its channel; what waits for it is forgotten. Raises ValueError."""
        with self._lock:
            if subscription not in self._channels:
                raise ValueError(f"there is no subscription {subscription}")
            channel = self._channels.pop(subscription)
            del self._subscriptions[channel.number]
            self._waiting.pop(subscription, None)
            self._lacking.discard(channel.number)
            return channel

    def reads(self, channel: Channel) -> bool:
        """Tells whether a channel is subscribed to."""
        with self._lock:
            return channel.number in self._subscriptions

    def channels(self) -> list[Channel]:
        """Returns the channels that are subscribed to."""
        with self._lock:
            return list(self._channels.values())

    def offer(self, channel: Channel, frames: list[Frame]) -> bool:
        """Takes what one message of the graph has become. Tells whether one that waited is left out for it."""
        with self._lock:
            subscription = self._subscriptions.get(channel.number)
            if subscription is None:
                return False
            left_out = subscription in self._waiting
            self._left_out += left_out
            self._waiting[subscription] = frames  # at the place of the one before
        self._wake()
        return left_out

    def say(self, text: str) -> None:
        """Takes a text of the protocol that goes before all that waits."""
        with self._lock:
            self._texts.append(text)
        self._wake()

    def lack(self, channel: Channel, text: str) -> None:
        """Takes a text about a part that is not there, once in the time of a subscription."""
        with self._lock:
            if channel.number not in self._subscriptions or channel.number in self._lacking:
                return
            self._lacking.add(channel.number)
            self._texts.append(text)
        self._wake()

    def miss(self, count: int) -> None:
        """Notes messages that a tap did not get."""
        with self._lock:
            self._missed += count

    def take(self) -> str | tuple[int, list[Frame]] | None:
        """Returns what is to be sent next: a text, or a subscription with its frames; None where nothing waits."""
        with self._lock:
            if self._texts:
                return self._texts.popleft()
            if not self._waiting:
                return None
            subscription = next(iter(self._waiting))
            return subscription, self._waiting.pop(subscription)

    def losses(self) -> tuple[int, int]:
        """Returns how many messages were left out and how many taps missed since the last call."""
        with self._lock:
            result = self._left_out, self._missed
            self._left_out = self._missed = 0
            return result
