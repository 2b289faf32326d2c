"""Defines the interface of a camera driver: open, info, configure, start, read, stop, close.

One file per camera family. Decoding is the business of `evis.events`, one file per codec.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events
from nodes.camera.interface.settings import Configuration

LONG_GAP = 100
"""A silence of more packets than this is one empty packet: a jump in device time must not become a flood."""


def packet_boundary(t_ns: int, packet_ns: int) -> int:
    """Computes the last packet boundary, a whole multiple of packet_ns, before an event at t_ns [ns]."""
    return (t_ns - 1) // packet_ns * packet_ns


@dataclass(frozen=True)
class DeviceInfo:
    """Identifies a camera: name, serial number, sensor, size and encoding.

    `clock` names the domain of its times in message headers.
    """

    name: str
    serial: str
    sensor: str
    width: int
    height: int
    encoding: str
    clock: str
    details: dict[str, Any] = field(default_factory=dict)


@dataclass
class Reading:
    """Holds the events of the interval (t0_ns, stamp_ns] on the device's clock, in the order and with the times it
    gave.

    raw: the wire bytes (uint8) of the interval if asked for. lost: events or bytes known to be missing before it.
    late_ns: how much later than its due time it is handed over (files at a set pace only).
    """

    events: Events
    t0_ns: int
    stamp_ns: int
    raw: np.ndarray | None = None
    lost: int = 0
    late_ns: int = 0


class Driver(abc.ABC):
    """Opens, configures and reads a camera. Use: `with Driver(...) as d: d.configure(...); d.start(); d.read(0.1)`.

    Entering opens, leaving stops and closes, also after an error. Failures are OSError or ValueError with one line.
    """

    SETTINGS: ClassVar[type[Configuration]]
    t0_ns: int = 0
    """Where the stream begins on the device's clock; known after start where the source knows it."""
    episode: int = 0
    """Goes up each time the device's clock starts anew (after it was unplugged)."""

    @abc.abstractmethod
    def open(self) -> None:
        """Opens the device and reads its identity."""

    @abc.abstractmethod
    def info(self) -> DeviceInfo:
        """Returns the camera's identity; valid only while it is open."""

    def settings_type(self) -> type[Configuration]:
        """Returns the class of the settings that this camera takes; valid only while it is open."""
        return self.SETTINGS

    @abc.abstractmethod
    def configure(self, configuration: Configuration) -> None:
        """Applies settings (of type SETTINGS). Raises ValueError for one out of range."""

    def changed_settings(self, values: Mapping[str, Any]) -> Configuration:
        """Returns the settings of a camera that streams with `values` in their place, for `change`.

        Raises ValueError for those that it cannot take, or not while it streams.
        """
        raise ValueError("a recording is played, which was made with the settings that its camera had")

    def change(self, configuration: Configuration) -> list[str]:
        """Writes what of a configuration of `changed_settings` is new to the streaming camera; returns its names.

        Raises ValueError where that fails: whether these names were written is not known then, and the next change
        writes them again.
        """
        raise ValueError(f"{type(self).__name__} has nothing to write settings to")

    def held_settings(self) -> dict[str, Any]:
        """Returns the settings that the camera itself holds, by name, but those of which that is not known; none of a
        recording."""
        return {}

    def device_now_ns(self) -> int | None:
        """Returns the device's time now [ns], good to the delay on the way; None where nothing has shown it."""
        return None

    @abc.abstractmethod
    def start(self) -> None:
        """Starts the stream of the camera."""

    @abc.abstractmethod
    def read(self, timeout_s: float) -> Reading | None:
        """Returns the next interval; None where it is not complete after timeout_s, and at the end (`ended`)."""

    @property
    @abc.abstractmethod
    def ended(self) -> bool:
        """Tells whether no reading will follow: True at the end of a file, never for a device that is connected."""

    def counters(self) -> dict[str, int]:
        """Returns how much was dropped, skipped or out of order so far, by reason; only counts above 0."""
        return {}

    @abc.abstractmethod
    def stop(self) -> None:
        """Ends the stream; does nothing when it has not begun."""

    @abc.abstractmethod
    def close(self) -> None:
        """Closes the device; does nothing where it is not open."""

    def __enter__(self) -> Driver:
        self.open()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self.stop()
        finally:
            self.close()
