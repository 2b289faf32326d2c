"""Publishes a camera's events, triggers and description."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.node import Node, Output
from evis.params import Param, ParamError
from msgs.camera import CameraInfo, EventPacket, Trigger
from msgs.header import Header, Message

WAIT_S = 0.05
"""Longest wait inside a step, so that the graph can always be stopped."""


class CameraNode(Node):
    """A source of real events. `file` plays a recording; `emulate` plays one at real pace whatever `pace` says, in the
    place of a device. Stamps and times are the device's own; the clock in the header names it."""

    PARAMS = {
        "camera": Param(str, "cam0", "name of the camera"),
        "file": Param(str, None, "recording to play (Prophesee RAW or .npz)", optional=True),
        "emulate": Param(str, None, "recording that stands in for a device, at real pace", optional=True),
        "serial": Param(str, None, "serial number of the USB camera; any when not given", optional=True),
        "pace": Param(str, "realtime", "realtime, fast, or a speed such as 2.0"),
        "packet_ms": Param(float, 10.0, "interval of one packet", "ms", 0.01, 10_000),
        "duration": Param(float, 0.0, "stop after this device time; 0 = all", "s", 0, 1e9),
        "raw": Param(bool, False, "packets carry the wire bytes too, where there are any"),
    }
    OUTPUTS = {
        "events": Output("/{camera}/events"),
        "trigger": Output("/{camera}/trigger"),
        "info": Output("/{camera}/info"),
    }
    SOURCE = True

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """A recording needs no USB."""
        return {"usb": "the camera is a recording"} if params.get("file") or params.get("emulate") else {}

    def setup(self) -> None:
        from nodes.camera.file_source import FileSettings, FileSource, parse_pace
        from nodes.camera.find import find_driver

        p = self.params
        try:
            speed = 1.0 if p["emulate"] else parse_pace(p["pace"])
        except ValueError as e:
            raise ParamError(f"{self.name}: {e}") from None
        self.driver = find_driver(p["file"], p["emulate"], p["serial"])
        self.driver.open()
        if isinstance(self.driver, FileSource):
            self.driver.configure(FileSettings(p["packet_ms"], speed, p["duration"], p["raw"]))
        self.driver.start()
        self._counted: dict[str, int] = {}
        self._interval_ns = round(p["packet_ms"] * 1e6)
        about = self.about = self.driver.info()
        for warning in about.details.get("warnings", ()):
            self.warn(warning)
        self.publish("info", camera_info(p["camera"], about, self.driver.t0_ns))

    def step(self, inputs: Mapping[str, Message]) -> bool:
        reading = self.driver.read(WAIT_S)
        self._count_new(self.driver.counters())
        if reading is None:
            return not self.driver.ended
        events, about = reading.events, self.about
        if reading.late_ns > self._interval_ns:
            self.count("late_packets")
            self.count("late_ms", reading.late_ns / 1e6)
        if self.wants("trigger"):
            edges = events.triggers
            self.publish("trigger", Trigger(self._header(reading.stamp_ns), edges.t, edges.id, edges.value))
        packet = EventPacket(
            self._header(reading.stamp_ns),
            np.array([0, len(events)], np.int64),
            events.t, events.x, events.y, events.p, events.c, reading.raw,
            width=about.width, height=about.height, t0_ns=reading.t0_ns, lost=reading.lost,
            encoding=about.encoding if reading.raw is not None else "",
        )
        self.publish("events", packet)
        return True

    def _header(self, stamp_ns: int) -> Header:
        return Header(stamp_ns, clock=self.about.clock)

    def _count_new(self, counters: Mapping[str, int]) -> None:
        """The driver's totals as increments of the node's counters."""
        for name, total in counters.items():
            if total != self._counted.get(name, 0):
                self.count(name, total - self._counted.get(name, 0))
                self._counted[name] = total

    def close(self) -> None:
        driver = getattr(self, "driver", None)
        if driver is not None:
            driver.stop()
            driver.close()


def camera_info(camera: str, about: Any, stamp_ns: int) -> CameraInfo:
    """The latched description of a device; the intrinsics are zero: not calibrated."""
    sensor = {"name": about.name, "serial": about.serial, "sensor": about.sensor, "encoding": about.encoding}
    return CameraInfo(
        Header(stamp_ns, clock=about.clock), np.zeros((3, 3)), np.zeros(0), name=camera,
        width=about.width, height=about.height, clock=about.clock, sensor=sensor | about.details,
    )
