"""The machine's own USB is not the tests': what is plugged in, and whether there is a libusb, changes nothing."""

from __future__ import annotations

import pytest
from usb_rig import silent


@pytest.fixture(autouse=True)
def no_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """No description of a camera for its temperature alone, where a test asks for none: on a slow machine it would come
    in the middle of any."""
    monkeypatch.setattr("nodes.camera.node.STATUS_S", 3600.0)


@pytest.fixture
def no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bus with nothing on it."""
    bus = silent("evk4").bus
    bus.backend.devices.clear()
    monkeypatch.setattr("nodes.camera.usb.access.usb_bus", lambda: bus)
