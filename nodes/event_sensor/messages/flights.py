"""Calls of a sensor on a GPU whose events are fetched when the next call is on its way, so that nobody waits for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from msgs.header import Message
from nodes.event_sensor.cuda.cuts import Cuts
from nodes.event_sensor.readout.device_events import DeviceEvents, Ready


@dataclass
class Landed:
    """Holds the events of a call, on the device. ends: how many of them there are up to the end of each message."""

    events: DeviceEvents
    messages: Sequence[Message]
    ends: list[int]


class Flights:
    """Holds the calls in their order, with the messages that they read."""

    def __init__(self, device: Any) -> None:
        self._cuts = Cuts(device)
        self._flying: list[tuple[Any, Sequence[Message]]] = []

    def begin(self, call: Any, messages: Sequence[Message]) -> None:
        """Takes a call that `EventSensor.process_async` has begun, of these messages, whose frames are kept for it."""
        for message in messages:
            message.keep()
        self._flying.append((call, messages))

    def due(self) -> bool:
        """Tells whether the first call is to be landed: another one is on its way, or its events are there already."""
        return len(self._flying) > 1 or bool(self._flying and isinstance(self._flying[0][0], Ready))

    def land(self) -> Landed | None:
        """Gives the first call's events, None where none is on its way; waits for that call alone."""
        if not self._flying:
            return None
        call, messages = self._flying.pop(0)
        events = call.result()
        for message in messages:
            message.release()
        stamps = [message.header.stamp_ns for message in messages]
        return Landed(events, messages, self._cuts.of(events.t, stamps) if len(events) else [0] * len(stamps))
