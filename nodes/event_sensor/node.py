"""The event sensor node: frames in, events out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.node import Input, Node, Output
from evis.params import Param
from msgs.camera import EventPacket, Frames, Keyframe
from msgs.header import Header, Message

if TYPE_CHECKING:
    from nodes.event_sensor.sensor import EventSensor


class EventSensorNode(Node):
    """Turns the frames of a camera, or its keyframes where nothing comes between, into events."""

    PARAMS = {
        "camera": Param(str, "cam0", "which camera of the scene"),
        "source": Param(
            str, "frames", "frames (interpolator) or keyframe (renderer, K = 1)", choices=("frames", "keyframe")
        ),
        "preset": Param(str, "ideal", "sensor whose faults to have; ideal has none", choices=("ideal",)),
        "threshold": Param(float, 0.2, "contrast threshold, ON and OFF", "ln I", 0.001, 10),
        "threshold_on": Param(float, None, "contrast threshold ON, if it differs", "ln I", 0.001, 10, optional=True),
        "threshold_off": Param(float, None, "contrast threshold OFF, if it differs", "ln I", 0.001, 10, optional=True),
        "dark_level": Param(float, 0.0, "dark current, in radiance units: L = ln(I + dark_level)", "W/(sr m^2)", 0),
        "defocus": Param(float, 0.0, "standard deviation of the blur of the lens, 0 = sharp", "px", 0, 50),
        "seed": Param(int, 0, "seed of the sensor's random streams; preset ideal has none", minimum=0),
        "device": Param(str, "cpu", "cpu, cuda or cuda:N"),
        "colour": Param(bool, False, "three sensors, for R, G and B, instead of one for luminance"),
    }
    INPUTS = {"frames": Input("/{camera}/frames"), "keyframe": Input("/{camera}/keyframe")}
    OUTPUTS = {"events": Output("/{camera}/events")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """One of the two: frames where an interpolator runs, keyframes where it is left out."""
        return frozenset({params["source"]})

    def setup(self) -> None:
        self._sensor: EventSensor | None = None
        self._counted = (0, 0)
        # Compile now rather than at the first frame.
        one = np.ones((1, 2, 2, 3), np.float32)
        warm = self._of_keyframe(Keyframe(Header(0), one, np.zeros(1, np.int32)))
        self._make(2, 2, 1).process(warm, np.zeros(1, np.int64), np.zeros(1, np.int32))

    def _make(self, height: int, width: int, envs: int) -> EventSensor:
        from nodes.event_sensor.sensor import EventSensor

        p = self.params
        on, off = (p["threshold"] if p[k] is None else p[k] for k in ("threshold_on", "threshold_off"))
        return EventSensor(
            height,
            width,
            envs,
            threshold_on=on,
            threshold_off=off,
            dark_level=p["dark_level"],
            defocus=p["defocus"],
            channels=3 if p["colour"] else 1,
            device=p["device"],
        )

    def update(self, inputs: Mapping[str, Message]) -> None:
        message = inputs[self.params["source"]]
        if isinstance(message, Keyframe):
            image, t = self._of_keyframe(message), np.array([message.header.stamp_ns])
        else:
            assert isinstance(message, Frames)
            image, t = self._of_frames(message), message.t
        envs, _, height, width = image.shape[:4]
        if self._sensor is None:
            self._sensor = self._make(height, width, envs)
        sensor = self._sensor
        count = sensor.advance(image, t, message.episodes)
        out: dict[str, Any] = {**self.loan("events", **{n: ((count,), d) for n, d in sensor.columns().items()})}
        sensor.read(out)
        for name, now, before in zip(("nonfinite_samples", "clipped_samples"), sensor.counts(), self._counted):
            if now > before:
                self.count(name, now - before)
        self._counted = sensor.counts()
        header = Header(message.header.stamp_ns, clock=message.header.clock, episode=message.header.episode)
        packet = EventPacket(
            header, sensor.env_offsets(), **out, width=width, height=height, t0_ns=sensor.t_base
        )  # fmt: skip
        self.publish("events", packet)

    def _of_keyframe(self, message: Keyframe) -> np.ndarray:
        """[E, 1, h, w(, 3)] without the margin: the keyframe's RGB, or its luminance."""
        image = message.radiance
        if not self.params["colour"]:
            from nodes.interpolator.luminance import luminance_of

            image = luminance_of(image).numpy()
        m = message.margin
        return image[:, None, m : image.shape[1] - m, m : image.shape[2] - m]

    def _of_frames(self, message: Frames) -> np.ndarray:
        image = message.rgb if self.params["colour"] else message.luminance
        if image is None:
            want, have = ("rgb", "luminance") if self.params["colour"] else ("luminance", "rgb")
            raise ValueError(
                f"{self.name}: frames carry {have}, the sensor needs {want}; set colour alike on both nodes"
            )
        return image
