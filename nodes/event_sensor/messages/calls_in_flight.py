"""Keeps the calls of a sensor that a GPU works on: the events of one are fetched when the next one has begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from msgs.header import Message
from nodes.event_sensor.readout.device_events import DeviceEvents, Ready


@dataclass
class FinishedCall:
    """Holds the events of a finished call, on the device. ends: number of events up to the stamp of each message."""

    events: DeviceEvents
    messages: Sequence[Message]
    ends: list[int]


class CallsInFlight:
    """Holds the calls in flight in their order, with the messages whose frames they read."""

    def __init__(self) -> None:
        self._calls: list[tuple[Any, Sequence[Message]]] = []

    def add(self, call: Any, messages: Sequence[Message]) -> None:
        """Adds a call that `EventSensor.process_async` has begun, and keeps the messages whose frames it reads."""
        for message in messages:
            message.keep()
        self._calls.append((call, messages))

    def due(self) -> bool:
        """Tells whether the first call is to be finished: another one is in flight, or its events are there already."""
        return len(self._calls) > 1 or bool(self._calls and isinstance(self._calls[0][0], Ready))

    def finish_first(self) -> FinishedCall | None:
        """Waits for the first call and gives its events; None where no call is in flight."""
        if not self._calls:
            return None
        call, messages = self._calls.pop(0)
        events = call.result()
        for message in messages:
            message.release()
        stamps = [message.header.stamp_ns for message in messages]
        return FinishedCall(events, messages, events.up_to(stamps) if len(stamps) > 1 else [len(events)])
