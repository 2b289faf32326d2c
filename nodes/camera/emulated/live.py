"""Sends simulated events through an emulated USB camera: /events -> wire words -> emulated device -> real driver ->
/events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.events.arrays import Events
from evis.runtime.node import Input, Node, Output
from msgs.camera import EventPacket
from msgs.header import Message
from nodes.camera.interface.messages import camera_info, packets

WAIT_S = 10.0
"""Longest wait for the bytes of one packet to come back from the reader thread [s]."""


class EmulatedCameraNode(Node):
    """Sends simulated events through an emulated camera: one packet out per packet in, with the same stamp.

    Times become whole us, as a sensor counts: an event of t ns comes out with t - t % 1000, all else and the order
    unchanged (a DVXplorer Mini may put events of one us in another order).
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "source": Param(str, "cam0", "simulated camera whose events are sent"),
        "camera": Param(str, "usb0", "name of the USB camera"),
        "emulate": Param(str, "davis346", "model of the emulated camera"),
        "raw": Param(bool, False, "packets carry the wire bytes too"),
        "decoder": Param(str, "numpy", "of the driver", choices=("numpy", "warp")),
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {"simulated": Input("/{source}/events")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {
        "events": Output("/{camera}/events"),
        "trigger": Output("/{camera}/trigger"),
        "info": Output("/{camera}/info"),
    }

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Raises ValueError for a model that there is not."""
        from nodes.camera.usb.models import model_named

        model_named(params["emulate"])
        return frozenset(cls.INPUTS)

    def setup(self) -> None:
        from nodes.camera.emulated.bus import driver_on
        from nodes.camera.emulated.feed import LiveFeed
        from nodes.camera.emulated.reencode import Reencoder
        from nodes.camera.usb.models import model_named

        p = self.params
        self.model = model_named(p["emulate"])
        self.feed = LiveFeed()
        self.driver = driver_on(self.model, self.feed, live=False)
        self.driver.open()
        kind = self.driver.settings_type()
        self.driver.configure(kind.of({"raw": p["raw"], "decoder": p["decoder"]}))
        self.encoder = Reencoder(self.model)
        self._episode: int | None = None
        self.publish("info", camera_info(p["camera"], self.driver.info(), 0))

    def update(self, inputs: Mapping[str, Message]) -> None:
        packet: Any = inputs["simulated"]
        if packet.header.episode != self._episode:
            self._begin_episode(packet.header.episode)
        events = self._events_of(packet)
        self.encoder.count_reordered(events)
        data = self.encoder.encode(events)
        self.feed.put(data)
        reading = self.driver.read_bytes(len(data), packet.t0_ns, packet.header.stamp_ns, WAIT_S)
        for name, total in {**self.driver.counters(), **self.encoder.counts}.items():
            self.count_total(name, total)
        for port, message in packets(reading, self.driver.info(), packet.header.episode, self._sends):
            self.publish(port, message)

    def _sends(self, port: str) -> bool:
        """Tells whether an output is read and can have messages: the simulator feeds the device with events alone."""
        return port in self.OUTPUTS and self.wants(port)

    def _begin_episode(self, episode: int) -> None:
        """Restarts the camera, its encoder and its decoder, whose times start anew with the episode."""
        from nodes.camera.emulated.reencode import Reencoder

        self.driver.stop()
        counts = self.encoder.counts
        self.encoder = Reencoder(self.model)
        self.encoder.counts = counts  # what was counted stays counted
        self.driver.start()
        self._episode = episode

    def _events_of(self, packet: EventPacket) -> Events:
        """Returns the events of a packet. Raises ValueError for those that a camera cannot have."""
        if len(packet.env_offsets) > 2:
            raise ValueError(f"{self.name}: a camera sees one world, not {len(packet.env_offsets) - 1}; use envs 1")
        if packet.width > self.model.width or packet.height > self.model.height:
            raise ValueError(
                f"{self.name}: events of {packet.width}x{packet.height} px do not fit on the {self.model.title} "
                f"({self.model.width}x{self.model.height}); choose another camera or a smaller width and height"
            )
        if packet.t is None or packet.x is None or packet.y is None or packet.p is None:
            raise ValueError(f"{self.name}: /{self.params['source']}/events holds no decoded events")
        return Events(np.asarray(packet.t), np.asarray(packet.x), np.asarray(packet.y), np.asarray(packet.p))

    def close(self) -> None:
        driver = getattr(self, "driver", None)
        if driver is not None:
            driver.stop()
            driver.close()
