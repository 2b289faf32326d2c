"""Opens the taps of the nodes of one process, and calls back with their messages."""

from __future__ import annotations

from collections.abc import Callable

from evis.bus import END
from evis.runtime.hosting.wiring import Wiring
from evis.runtime.tap import TapSubscription
from evis.runtime.wakeup import Wakeup
from msgs.header import Message


class Taps:
    """Holds the taps that the nodes of one process have opened."""

    def __init__(self, wiring: Wiring, wakeup: Wakeup) -> None:
        """Takes the wiring, which makes subscribers, and the wakeup of the executor, which hears their sockets."""
        self._wiring, self._wakeup = wiring, wakeup
        self._open: list[TapSubscription] = []

    def open(self, node: str, topic: str, callback: Callable[[Message], None]) -> TapSubscription:
        """Subscribes a node to a running topic; `pump` calls `callback`, and arrays are valid while that runs."""
        subscribers = self._wiring.subscribe(topic, node, "tap", tap=True)
        for subscriber in subscribers:
            subscriber.start()
            self._wakeup.hear(subscriber, subscriber.sockets())
        tap = TapSubscription(topic, callback, subscribers, self._close)
        self._open.append(tap)
        return tap

    def pump(self) -> bool:
        """Hands over a message of each tap that has one, without waiting; True when there were any."""
        progress = False
        for tap in list(self._open):
            for subscriber in tap.subscribers:
                message = subscriber.receive(0)
                if message is not None and message is not END:
                    progress = True
                    tap.callback(message)
                    message.release()
        return progress

    def close(self) -> None:
        """Ends all subscriptions."""
        for tap in list(self._open):
            self._close(tap)

    def _close(self, tap: TapSubscription) -> None:
        if tap in self._open:
            self._open.remove(tap)
            for subscriber in tap.subscribers:
                self._wakeup.forget(subscriber)
                subscriber.close()
