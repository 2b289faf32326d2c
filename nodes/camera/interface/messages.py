"""Converts a driver's readings to messages of the bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from msgs.camera import CameraInfo, EventPacket, Image, Imu, Trigger
from msgs.header import Header, Message
from nodes.camera.interface.driver import DeviceInfo, Reading


def packets(
    reading: Reading, about: DeviceInfo, episode: int, wants: Callable[[str], bool]
) -> Iterator[tuple[str, Message]]:
    """Yields (port, message) of one reading: triggers, inertial samples and frames where they are wanted, then events.

    Every port has one message per reading but `image`: one per frame, stamped with the middle of its exposure.
    """
    events = reading.events

    def header(stamp_ns: int) -> Header:
        return Header(stamp_ns, clock=about.clock, episode=episode)

    if wants("trigger"):
        edges = events.triggers
        yield "trigger", Trigger(header(reading.stamp_ns), edges.t, edges.id, edges.value)
    if wants("imu"):
        imu = events.imu
        yield "imu", Imu(header(reading.stamp_ns), imu.t, imu.acceleration, imu.angular_velocity, imu.temperature)
    if wants("image"):
        for frame in events.frames:
            pixels = np.ascontiguousarray(frame.pixels if frame.pixels.ndim == 3 else frame.pixels[:, :, None])
            deep = "16" if pixels.dtype == np.uint16 else "8"
            encoding = ("rgb" if pixels.shape[2] == 3 else "mono") + deep
            yield "image", Image(header(frame.middle_ns), pixels, encoding, frame.exposure_ns)
    yield (
        "events",
        EventPacket(
            header(reading.stamp_ns),
            np.array([0, len(events)], np.int64),
            events.t,
            events.x,
            events.y,
            events.p,
            events.c,
            reading.raw,
            width=about.width,
            height=about.height,
            t0_ns=reading.t0_ns,
            lost=reading.lost,
            encoding=about.encoding if reading.raw is not None else "",
        ),
    )


def camera_info(
    camera: str, about: Any, stamp_ns: int, episode: int = 0, settings: Mapping[str, Any] | None = None
) -> CameraInfo:
    """Makes the latched CameraInfo of a device at a time of its clock; the intrinsics are zero, which means not
    calibrated.

    settings: what is told of the device's settings, beside who it is.
    """
    sensor = {"name": about.name, "serial": about.serial, "sensor": about.sensor, "encoding": about.encoding}
    stamp_ns = max(stamp_ns, 0)  # the interval of an event at 0 begins before, where a bag has no times
    return CameraInfo(
        Header(stamp_ns, clock=about.clock, episode=episode),
        np.zeros((3, 3)),
        np.zeros(0),
        name=camera,
        width=about.width,
        height=about.height,
        clock=about.clock,
        sensor=sensor | about.details | dict(settings or {}),
    )
