"""Finds the driver of the camera that a user means: a recording, an emulated device, or a device on USB."""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING

from nodes.camera.interface.driver import DeviceInfo, Driver
from nodes.camera.usb.models import ALIASES, MODELS, Model, model_named

if TYPE_CHECKING:
    from nodes.camera.file_source import FileSource
    from nodes.camera.usb.access import Bus
    from nodes.camera.usb.driver import UsbDriver


def is_model(name: str | None) -> bool:
    """Tells whether `emulate` names a camera model and not a recording, whose path has a separator or a suffix."""
    if not name:
        return False
    return name in MODELS or name in ALIASES or not (os.sep in name or "." in name or os.path.exists(name))


def list_devices(bus: Bus | None = None) -> list[DeviceInfo]:
    """Lists the cameras on USB that this version can drive, each with the identity that it states.

    Raises OSError when there is no libusb.

    One that cannot be opened is listed with the reason in details["problem"].
    """
    result = []
    for driver in on_usb(bus):
        try:
            result.append(driver.identify())
        except OSError as error:
            from nodes.camera.usb.access import label

            details = {"usb": label(driver.device), "problem": str(error)}
            result.append(driver.model.device_info("", details))
    return result


def on_usb(bus: Bus | None = None) -> list[UsbDriver]:
    """Makes drivers, not opened yet, of the cameras on a bus (the machine's own unless given). Raises OSError."""
    from nodes.camera.usb.access import usb_bus

    bus = bus or usb_bus()
    drivers: list[UsbDriver] = []
    seen: set[tuple[int, int]] = set()
    for model in MODELS.values():
        if not seen.isdisjoint(model.ids):  # the driver finds out which of the models with these ids it is
            continue
        seen.update(model.ids)
        camera = importlib.import_module(model.driver).Camera
        drivers += [camera(bus, device, model) for device in bus.devices(model.ids)]
    return drivers


def open_file(path: str, topic: str = "") -> FileSource:
    """Makes a driver that plays a recording; it is not opened yet. topic: of a bag with several; "" = the first."""
    from nodes.camera.file_source import FileSource

    return FileSource(path, topic=topic)


def open_emulated(
    name: str,
    path: str | None,
    speed: float = 1.0,
    duration_s: float = 0.0,
    faults: str = "",
    topic: str = "",
) -> UsbDriver:
    """Makes the real driver of a model on an emulated device that sends a recording; it is not opened yet.

    speed: device time per real time, 0 = as fast as it is read. Without a recording it is silent. Raises ValueError,
    OSError.
    """
    from nodes.camera.emulated.bus import driver_on
    from nodes.camera.emulated.faults import Faults
    from nodes.camera.emulated.feed import LiveFeed
    from nodes.camera.emulated.recording_feed import RecordingFeed

    model: Model = model_named(name)
    feed = RecordingFeed(path, model, speed, duration_s, topic) if path else LiveFeed()
    return driver_on(model, feed, Faults.of(faults), live=speed == 1.0)


def check_choice(file: str | None, emulate: str | None, serial: str | None, streams: bool = True) -> None:
    """Raises ValueError where the arguments, which are those of `find_driver`, do not name exactly one camera.

    An empty text, as of a shell's variable that is not set, is not the same as none: it is not to open a live camera.
    """
    for name, value in (("file", file), ("emulate", emulate), ("serial", serial)):
        if value == "":
            raise ValueError(f"{name} is empty; name one, or leave it out")
    if emulate and is_model(emulate):
        if serial:
            raise ValueError("emulate and serial are given; an emulated camera has its own serial number")
        model_named(emulate)
        if streams and not file:
            raise ValueError(f"an emulated {emulate} sends a recording: give it with file:=REC or --file REC")
        return
    given = [name for name, value in (("file", file), ("emulate", emulate), ("serial", serial)) if value]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} are given; a camera is one of file, emulate and serial")


def find_driver(
    file: str | None,
    emulate: str | None,
    serial: str | None,
    speed: float = 1.0,
    duration_s: float = 0.0,
    faults: str = "",
    streams: bool = True,
    topic: str = "",
) -> Driver:
    """Finds the driver of the camera that the arguments name. Raises ValueError, and OSError for a device that is not
    there.

    file: a recording. emulate: a camera model, whose emulated device sends `file`; or a recording, which then stands in
    for a device. serial: a camera on USB; the first one when nothing is given. streams: an emulated camera must have
    something to send. topic: of a recording with several event topics; "" = the first.
    """
    check_choice(file, emulate, serial, streams)
    if emulate and is_model(emulate):
        return open_emulated(emulate, file, speed, duration_s, faults, topic)
    path = file or emulate
    if path:
        return open_file(path, topic)
    return _find_on_usb(serial)


def _find_on_usb(serial: str | None) -> Driver:
    """Finds the USB camera with this serial number, or the first one. Raises OSError that says how to go on without."""
    problems = []
    for driver in on_usb():
        if not serial:
            return driver
        try:
            if driver.identify().serial == serial:
                return driver
        except OSError as error:
            problems.append(str(error))
    if problems:
        raise OSError(f"no camera {serial} found; but {'; '.join(problems)}")
    wanted = f"camera {serial}" if serial else "event camera"
    remedy = "play a recording instead, with file:=REC.raw or --file REC.raw"
    raise OSError(f"no {wanted} found (USB cameras supported: {', '.join(MODELS)}); {remedy}")
