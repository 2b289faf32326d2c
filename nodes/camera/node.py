"""Publishes a camera's events, frames, inertial samples, triggers and description."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.config.params import Param, ParamError
from evis.events.codecs.buffer import Columns, plain
from evis.runtime.node import Input, Node, Output
from evis.runtime.pacing import parse_pace
from msgs.camera import CameraSettings
from msgs.header import Message
from nodes.camera.interface.elapsed import Elapsed
from nodes.camera.interface.messages import camera_info, packets
from nodes.camera.interface.settings import Configuration, parse_settings, shown, texts_of

if TYPE_CHECKING:
    from nodes.camera.usb.driver import UsbDriver

WAIT_S = 0.05
"""Longest wait inside a step, so that the graph can always be stopped."""
REST_S = 1.0
"""Pause between two rounds of a recording, so that its end can be seen [s]."""
STATUS_S = 5.0
"""Interval at which a USB camera's temperature and clock are asked for and published again."""
FIRST_TIME = {
    "unplugged": "the camera was unplugged; waiting for it",
    "gaps": "bytes of the stream were lost",
    "clock_set_back": "times of the recording go back by far, as after a reset of its camera: all that follows, until "
    "they are past where they were, is one packet",
    "device_messages": "the camera reports an error of its own: device_message on its info topic",
}
"""Counters whose first increment is said as a warning."""
COUNT_S = 0.1
"""Interval at which the driver's totals are asked for; also with each packet before which something was lost."""
MOST_TOLD = 20
"""Changes of settings that the log tells, and refusals, for a node may change them many times a second."""
LEAST_EVENTS = 1 << 17
"""Room of the smallest packet in shared memory: what grows from packet to packet has to be reserved anew."""
GAUGES = ("temperature_c", "clock_drift_ppm")


class CameraNode(Node):
    """Publishes the events of a real camera or a recording.

    `file` plays a recording; `emulate` names a model whose emulated USB device sends `file` to the real driver, or is a
    recording played at real pace whatever `pace` says. Stamps and times are the device's own; the clock in the header
    names it.
    """

    PARAMS = {
        "camera": Param(str, "cam0", "name of the camera in the topics"),
        "file": Param(str, None, "recording to play in place of a camera", optional=True),
        "topic": Param(str, "", "event topic to play, of a file that has several (the first)"),
        "emulate": Param(
            str,
            None,
            "model of an emulated USB camera that sends `file` to the real driver: evk4, silkyevcam, davis346, "
            "dvxplorer, ...; or a recording in a device's place",
            optional=True,
        ),
        "serial": Param(str, None, "serial number of the camera; the first one found when not given", optional=True),
        "pace": Param(str, "realtime", "how fast a file is played: realtime, fast, or a speed such as 2.0"),
        "packet_ms": Param(float, 10.0, "interval of one packet", "ms", 0.01, 10_000),
        "duration": Param(float, 0.0, "stop after this device time, all connections together; 0 = all", "s", 0, 1e9),
        "raw": Param(bool, False, "packets carry the wire bytes too, where there are any"),
        "settings": Param(list, [], "the camera's own settings, as bias_fo=10,event_rate_limit=2e7"),
        "reconnect": Param(bool, False, "wait for a USB camera that was unplugged to come back"),
        "again": Param(bool, False, "play `file` again and again, as further episodes, until stopped"),
        "faults": Param(str, "", "how an emulated camera misbehaves, as stall_every=50 or unplug_after=100000"),
    }
    INPUTS = {"setting": Input("/{camera}/settings", join=False, optional=True, outside=True)}
    OUTPUTS = {
        "events": Output("/{camera}/events"),
        "trigger": Output("/{camera}/trigger"),
        "imu": Output("/{camera}/imu"),
        "image": Output("/{camera}/image"),
        "info": Output("/{camera}/info"),
    }
    SOURCE = True

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for what names no camera, or several, for a model, a fault or a pace that there is not."""
        from nodes.camera.emulated.faults import Faults
        from nodes.camera.find import check_choice, is_model

        check_choice(params["file"], params["emulate"], params["serial"])
        if is_model(params["emulate"]):
            Faults.of(params["faults"])
        parse_pace(params["pace"])
        return frozenset(cls.INPUTS)

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names the parameters of a device where a recording is played, and those of a recording where a device is
        read."""
        from nodes.camera.effects import without_effect

        return without_effect(params["file"], params["emulate"])

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Names pyusb as a package that is not imported where a recording is played."""
        from nodes.camera.find import is_model

        played = (params.get("file") or params.get("emulate")) and not is_model(params.get("emulate"))
        return {"usb": "the camera is a recording"} if played else {}

    def setup(self) -> None:
        self._interval_ns = round(self.params["packet_ms"] * 1e6)
        self._stamp_ns = 0
        self._episodes_before = 0
        """Episodes of the rounds of a recording before this one."""
        self._connection = 0
        """Number of the driver's connection, which goes up when the camera was plugged in again."""
        self._elapsed = Elapsed()
        self._told: set[str] = set()
        self._admitted: Message | None = None
        self._changed_ns: list[Any] = []
        self._info_due = False
        """The camera's description is to be published anew: once in a step, which is called when there is room for it,
        for who reads it may be waiting for its own settings to be taken."""
        self._changes = self._refused = 0
        self._set_since: dict[str, Any] = {}
        """Settings that were changed while it streamed."""
        self._count_at = self._rest_until = 0.0
        self._open()

    def _open(self) -> None:
        """Opens, configures and starts the driver that the parameters name, and publishes the camera's description."""
        from nodes.camera.file_source import FileSettings, FileSource
        from nodes.camera.find import find_driver, is_model

        p = self.params
        try:
            speed = parse_pace(p["pace"])
        except ValueError as e:
            raise ParamError(f"{self.name}: {e}") from None
        self.driver = find_driver(
            p["file"], p["emulate"], p["serial"], speed, p["duration"], p["faults"], topic=p["topic"]
        )
        self.driver.open()
        if isinstance(self.driver, FileSource):
            played_as_device = p["emulate"] and not is_model(p["emulate"])
            speed = 1.0 if played_as_device else speed
            self.driver.configure(FileSettings(p["packet_ms"], speed, p["duration"], p["raw"]))
        else:
            configure_usb(self.driver, p, self._set_since)  # type: ignore[arg-type]
            if not p["raw"]:  # bytes of unknown size beside the events would make the bus copy both
                self.driver.allocate = self.columns  # type: ignore[attr-defined]
        self.driver.start()
        self._status_at = time.monotonic() + STATUS_S
        self.about = self.driver.info()
        self._warn_of_device()
        self._stamp_ns = self.driver.t0_ns
        self._publish_info()

    def _warn_of_device(self) -> None:
        """Gives each warning of the driver's once."""
        for warning in self.about.details.get("warnings", ()):
            if warning not in self._told:
                self._told.add(warning)
                self.warn(warning)

    @property
    def _episode(self) -> int:
        """Returns the episode of what the driver gives now: one for each connection, of each round of a recording."""
        return self._episodes_before + self.driver.episode

    def _publish_info(self) -> None:
        """Publishes the camera's description and settings, with the stamp of the last reading."""
        self._info_due = False
        held = self.driver.held_settings()
        settings = {"settings": held, "settings_changed_ns": self._changed_ns} if held else {}
        self.publish("info", camera_info(self.params["camera"], self.about, self._stamp_ns, self._episode, settings))

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if time.monotonic() < self._rest_until:
            time.sleep(WAIT_S)
            return True
        reading = self.driver.read(WAIT_S)
        now = time.monotonic()
        if reading is None or reading.lost or now >= self._count_at:
            self._count_at = now + COUNT_S
            self._count_new(self.driver.counters())
            self._watch()
        if self._info_due:
            self._publish_info()
        if reading is None:
            return not self.driver.ended or self._begin_again()
        if reading.late_ns > self._interval_ns:
            self.count("late_packets")
            self.count("late_ms", reading.late_ns / 1e6)
        self._stamp_ns = reading.stamp_ns
        for port, message in packets(reading, self.about, self._episode, self.wants):
            self.publish(port, message)
        if not self.params["duration"] or self.params["file"] or self.params["emulate"]:
            return True  # a recording ends by itself
        elapsed = self._elapsed.add(self.driver.episode, reading.t0_ns, reading.stamp_ns)
        return elapsed < round(self.params["duration"] * 1e9)

    def admit(self, port: str, message: Message) -> None:
        """Raises ValueError for settings that the camera cannot take; nothing is written then."""
        self._wanted(message)
        self._admitted = message

    def receive(self, port: str, message: Message) -> None:
        """Writes settings to the camera while it streams.

        Raises ValueError where that fails, for a program outside the graph to be told; a node's message is refused with
        a warning.
        """
        try:
            self._change_settings(message)
        except ValueError as error:
            if message is self._admitted:
                raise
            self.count("refused_settings")
            self._refused += 1
            if self._refused <= MOST_TOLD:
                self.warn(f"refused: {error}{'; the next ones are only counted' if self._refused == MOST_TOLD else ''}")

    def _wanted(self, message: Message) -> Configuration:
        """Returns the settings that the camera would have after a message. Raises ValueError."""
        assert isinstance(message, CameraSettings)
        return self.driver.changed_settings(parse_settings(self.driver.settings_type(), texts_of(message.values)))

    def _change_settings(self, message: Message) -> None:
        """Writes settings, and has the camera's description published with what holds then. Raises ValueError."""
        wanted = self._wanted(message)
        # the host's estimate may be late by what the stream is; what was published is past
        begun_ns = max(self.driver.device_now_ns() or 0, self._stamp_ns)
        changed: list[str] | None = None
        try:
            changed = self.driver.change(wanted)
        finally:
            if changed != []:
                begun_ns = self._changed_ns[0] if self._info_due else begun_ns
                ended_ns = self.driver.device_now_ns()
                ended_ns = None if ended_ns is None else max(ended_ns, self._stamp_ns)
                self._changed_ns, self._info_due = [begun_ns, ended_ns], True
        if not changed:
            return
        self._set_since |= {name: getattr(wanted, name) for name in changed}
        self.count("settings_changed", len(changed))
        self._warn_of_device()
        self._changes += 1
        if self._changes <= MOST_TOLD:
            values = ", ".join(f"{name}={shown(self._set_since[name])}" for name in changed)
            more = "; the next changes are only counted, and on its info topic" if self._changes == MOST_TOLD else ""
            self.runtime.diagnose(self, "info", f"{values} from {begun_ns / 1e9:.6f} s on{more}")

    def _begin_again(self) -> bool:
        """Starts the recording once more where `again` asks for that; False where it does not."""
        if not self.params["again"] or not self.params["file"]:
            return False
        self._count_new(self.driver.counters())
        self.close()
        self.restart_totals()
        self._episodes_before = self._episode + 1
        self._connection, self._changed_ns = 0, []
        self._rest_until = time.monotonic() + REST_S
        self._open()
        return True

    def columns(self, n: int) -> Columns:
        """Lends the columns [n] of the message to be sent, into which the driver decodes at most n events."""
        if not self.wants("events"):
            return plain(n)
        n = max(n, LEAST_EVENTS)
        kinds = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
        given = self.loan("events", **{name: ((n,), kind) for name, kind in kinds.items()})
        return given["t"], given["x"], given["y"], given["p"]

    def finish(self) -> None:
        if self._info_due:
            self._publish_info()
        self._count_new(self.driver.counters())

    def _watch(self) -> None:
        """Warns when the camera comes back, and has its temperature and clock published every STATUS_S."""
        if self.driver.episode != self._connection:
            self._connection, self._changed_ns = self.driver.episode, []
            self.warn(f"the camera is back; its clock starts anew (episode {self._episode})")
            self._status_at, self._stamp_ns = 0.0, self.driver.t0_ns
        if time.monotonic() < self._status_at or not hasattr(self.driver, "bus"):
            return
        self._status_at = time.monotonic() + STATUS_S
        about = self.about = self.driver.info()
        gauges = {k: float(about.details[k]) for k in GAUGES if k in about.details}
        self._count_new(gauges)
        self._info_due = True

    def _count_new(self, counters: Mapping[str, float]) -> None:
        """Adds what the driver's totals have gained to the node's counters."""
        for name, total in counters.items():
            if self.count_total(name, total) and name in FIRST_TIME:
                self.warn(FIRST_TIME[name])

    def close(self) -> None:
        driver = getattr(self, "driver", None)
        if driver is not None:
            driver.stop()
            driver.close()


def configure_usb(driver: UsbDriver, params: Mapping[str, Any], set_since: Mapping[str, Any]) -> None:
    """Configures an open driver with the node's parameters and the camera's own settings, and what was `set_since`.

    Raises ValueError.
    """
    kind = driver.settings_type()
    common = {"packet_ms": params["packet_ms"], "raw": params["raw"], "reconnect": params["reconnect"]}
    given = parse_settings(kind, params["settings"])
    driver.configure(dataclasses.replace(kind.of({**common, **given, **set_since})))
