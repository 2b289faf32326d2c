"""Joins labels with the events of the same packet: both arrive separately, in order."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msgs.camera import EventPacket, EventSignal, Labels
from msgs.header import Header, Message
from msgs.world import WorldState


@dataclass
class Packet:
    """Holds the events of a packet, copied, with what made them."""

    header: Header
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    env_offsets: np.ndarray
    signal: np.ndarray


class EventPairing:
    """Takes labels, packets and their signals; gives them in threes.

    A sensor that looks ahead publishes a last packet with the stamp of the one before; that comes without labels.
    """

    def __init__(self) -> None:
        self._given: tuple[int, int] | None = None
        """Episode and stamp of the labels given last."""
        self._labels: deque[tuple[Labels, WorldState]] = deque()
        self._packets: deque[EventPacket] = deque()
        self._signals: deque[EventSignal] = deque()

    def label(self, labels: Labels, state: WorldState) -> None:
        """Takes the labels of a stamp, without those of events, and copies its state."""
        names = ("t", "end_pose", "moving", "moving_pose", "moving_twist", "episodes", "own", "own_t")
        arrays = {n: np.array(value) for n in names if (value := getattr(state, n)) is not None}
        rest = WorldState(state.header, names=state.names, **arrays)
        self._labels.append((labels, rest))

    def take(self, message: Message) -> None:
        """Takes a packet, or its signal, and copies it. Raises ValueError for a packet that is not decoded."""
        if isinstance(message, EventPacket):
            if message.t is None or message.x is None or message.y is None:
                raise ValueError(
                    f"events in the encoding '{message.encoding}' have no labels; they are of a real sensor"
                )
            columns: dict[str, Any] = {
                name: np.array(getattr(message, name)) for name in ("t", "x", "y", "env_offsets")
            }
            self._packets.append(replace(message, p=None, c=None, raw=None, **columns))
        elif isinstance(message, EventSignal):
            self._signals.append(replace(message, signal=np.array(message.signal)))

    def next(self, ended: bool = False) -> tuple[Labels | None, WorldState | None, Packet] | None:
        """Gives the next packet with the labels of its stamp, or without any where these were given already; None
        where something is still missing.

        There are two packets of a stamp where environments begin anew at it, with labels each, and where the sensor
        held events back; so that is known only by what comes next, or once the run has `ended`.
        """
        if not self._packets or not self._signals:
            return None
        key = self._packets[0].header.instant
        due = bool(self._labels) and self._labels[0][0].header.instant == key
        if not due and not self._labels and not (ended and key == self._given):
            return None
        packet, signal = self._packets.popleft(), self._signals.popleft()
        assert packet.t is not None and packet.x is not None and packet.y is not None
        own = Packet(packet.header, packet.t, packet.x, packet.y, packet.env_offsets, signal.signal)
        if not due and key == self._given:
            return None, None, own
        labels, state = self._labels.popleft()
        if not due:
            raise ValueError(f"events of {key[1]} ns came where those of {labels.header.stamp_ns} ns were due")
        self._given = key
        return labels, state, own
