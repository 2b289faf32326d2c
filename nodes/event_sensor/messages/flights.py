"""Keeps calls of a sensor on a GPU that are under way: the events of one are fetched when the next one has begun."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from msgs.header import Message
from nodes.event_sensor.readout.device_events import DeviceEvents, Ready


@dataclass
class Landed:
    """Holds the events of a finished call, on the device. ends: number of events up to the stamp of each message."""

    events: DeviceEvents
    messages: Sequence[Message]
    ends: list[int]


class Flights:
    """Holds the calls under way in their order, with the messages whose frames they read."""

    def __init__(self) -> None:
        self._flying: list[tuple[Any, Sequence[Message]]] = []

    def begin(self, call: Any, messages: Sequence[Message]) -> None:
        """Adds a call that `EventSensor.process_async` has begun, and keeps the messages whose frames it reads."""
        for message in messages:
            message.keep()
        self._flying.append((call, messages))

    def due(self) -> bool:
        """Tells whether the first call is to be finished: another one is under way, or its events are there already."""
        return len(self._flying) > 1 or bool(self._flying and isinstance(self._flying[0][0], Ready))

    def land(self) -> Landed | None:
        """Waits for the first call and gives its events; None where no call is under way."""
        if not self._flying:
            return None
        call, messages = self._flying.pop(0)
        events = call.result()
        for message in messages:
            message.release()
        stamps = [message.header.stamp_ns for message in messages]
        return Landed(events, messages, events.up_to(stamps) if len(stamps) > 1 else [len(events)])
