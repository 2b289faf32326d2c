"""Plays a recording as a camera: with its own clock and its own order, at real pace or as fast as it is read."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from evis.events import Recording, open_recording
from evis.runtime.clock import NS
from evis.runtime.pacing import FAST, FASTEST
from nodes.camera.interface.driver import LONG_GAP, DeviceInfo, Driver, Reading, packet_boundary
from nodes.camera.interface.settings import Configuration, setting


@dataclass
class FileSettings(Configuration):
    """Holds the settings by which a recording is played. All times are the device's."""

    packet_ms: float = setting(10.0, "length of a packet's interval", "ms", 0.01, 10_000)
    speed: float = setting(1.0, "device time per real time; 0 = as fast as it is read", "", FAST, FASTEST)
    duration_s: float = setting(0.0, "stop so long after the first event; 0 = all", "s", 0, 1e9)
    raw: bool = setting(False, "also give the wire bytes, where the file has them")


class FileSource(Driver):
    """Plays a recording as a camera driver.

    Packets end at whole multiples of packet_ms on the device's clock, so that two cameras of one clock have the same
    stamps. A cut goes before the first event later than the boundary: events whose time steps back stay in their place
    and are counted; where a clock was set back by more than LONG_GAP packets, so is that, for all up to the time before
    is one packet. now [ns] and sleep [s] are the wall clock; a test gives its own. topic: of a bag
    with several event topics.
    """

    SETTINGS = FileSettings

    def __init__(
        self,
        path: str | Path,
        now: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
        topic: str = "",
    ) -> None:
        self.path, self._topic = Path(path), topic
        self._now, self._sleep = now, sleep
        self._recording: Recording | None = None
        self._settings = FileSettings()
        self._running = False
        self._prepared: Reading | None = None
        self._end: int | None = None
        self._origin: tuple[int, int] | None = None
        """Where the pace counts from: wall clock and device time [ns]."""
        self._counts: Counter[str] = Counter()
        self._ended = False

    def open(self) -> None:
        self._recording = open_recording(self.path, topic=self._topic)

    def info(self) -> DeviceInfo:
        about = self._open_recording().info
        details = {
            "file": self.path.name,
            "format": about.format,
            "geometry_from": about.geometry_from,
            "header": about.header,
            "warnings": about.warnings,
        }
        clock = f"device:{about.serial or self.path.name}"
        return DeviceInfo(
            self.path.name, about.serial, about.sensor, about.width, about.height, about.encoding, clock, details
        )

    def configure(self, configuration: Configuration) -> None:
        if self._running:
            raise ValueError(f"{self.path}: settings can be changed only before start")
        if not isinstance(configuration, FileSettings):
            raise ValueError(f"{self.path}: a recording takes FileSettings, not {type(configuration).__name__}")
        configuration.check()
        self._settings = dataclasses.replace(configuration)

    def start(self) -> None:
        recording = self._open_recording()
        self._packet_ns = round(self._settings.packet_ms * 1e6)
        first = recording.next_t_ns
        self._ended = first is None
        self.t0_ns = 0 if first is None else packet_boundary(first, self._packet_ns)
        if self._settings.duration_s and first is not None:  # as an emulated device; a packet may begin long before
            self._end = first - 1 + round(self._settings.duration_s * NS)
        self._at = self.t0_ns
        self._running = True

    def read(self, timeout_s: float) -> Reading | None:
        if not self._running:
            raise ValueError(f"{self.path}: read before start")
        if self._prepared is None:
            self._origin = self._origin or (self._now(), self.t0_ns)
            self._prepared = self._next()
        reading = self._prepared
        if reading is None:
            self._ended = True
            return None
        if self._settings.speed and self._origin is not None:
            start, t0 = self._origin
            wait = start + round((reading.stamp_ns - t0) / self._settings.speed) - self._now()
            if wait > timeout_s * NS:
                self._sleep(timeout_s)
                return None
            if wait > 0:
                self._sleep(wait / NS)
            reading.late_ns = max(-wait, 0)
        self._prepared = None
        return reading

    def _next(self) -> Reading | None:
        """Reads the events up to the next packet boundary; None at the end of the recording."""
        recording, t0 = self._open_recording(), self._at
        following = recording.next_t_ns
        if following is None or (self._end is not None and t0 >= self._end):
            return None
        stamp = t0 + self._packet_ns
        if following > t0 + LONG_GAP * self._packet_ns:
            stamp = packet_boundary(following, self._packet_ns)
            self._counts["long_gaps"] += 1
        if self._end is not None:
            stamp = min(stamp, self._end)
        events = recording.read_until(stamp)
        stepped_back = int((events.t <= t0).sum())
        if stepped_back:
            self._counts["events_stepped_back"] += stepped_back
            if t0 - int(events.t.min()) > LONG_GAP * self._packet_ns:
                self._counts["clock_set_back"] += 1
        self._at = stamp
        return Reading(events, t0, stamp, recording.raw if self._settings.raw else None)

    @property
    def ended(self) -> bool:
        return self._ended

    def counters(self) -> dict[str, int]:
        return dict(self._counts) | (self._recording.counters() if self._recording else {})

    def stop(self) -> None:
        self._running = False

    def close(self) -> None:
        if self._recording is not None:
            self._recording.close()
            self._recording = None

    def _open_recording(self) -> Recording:
        """Returns the open recording. Raises ValueError where there is none."""
        if self._recording is None:
            raise ValueError(f"{self.path}: not open")
        return self._recording
