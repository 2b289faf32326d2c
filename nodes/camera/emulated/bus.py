"""Implements a USB bus with one emulated camera on it."""

from __future__ import annotations

import importlib

from nodes.camera.emulated.backend import EmulatedBackend
from nodes.camera.emulated.device import EmulatedDevice
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.usb.access import Bus
from nodes.camera.usb.driver import UsbDriver
from nodes.camera.usb.models import Model

SERIAL = "0000e915"
"""Serial number of every emulated camera; no real one has it."""


def emulated_device(model: Model, feed: Feed, faults: Faults | None = None) -> EmulatedDevice:
    """Makes the emulated device of a model, fed by `feed`."""
    result: EmulatedDevice = importlib.import_module(model.emulator).make_device(
        model, feed, faults or Faults(), SERIAL
    )
    return result


def emulated_bus(device: EmulatedDevice) -> Bus:
    """Makes a bus with that device. The waits that real chips need are left out."""
    return Bus(EmulatedBackend(device), sleep=lambda seconds: None, emulated=True)


def driver_on(model: Model, feed: Feed, faults: Faults | None = None, live: bool = True) -> UsbDriver:
    """Makes the model's real driver on its emulated device. Raises OSError where the device is not there."""
    device = emulated_device(model, feed, faults)
    bus = emulated_bus(device)
    found = bus.devices(model.ids)
    if not found:
        raise OSError(f"no {model.title} found: plug it in, and look with `evis camera list`")
    camera = importlib.import_module(model.driver).Camera
    result: UsbDriver = camera(bus, found[0], model, live=live, wait_when_full=True)
    result.emulated = device
    return result
