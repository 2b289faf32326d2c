"""Which camera a user means: a recording, a recording in the place of a device, or a device on USB."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from nodes.camera.driver import FAMILIES, DeviceInfo, Driver

if TYPE_CHECKING:
    from nodes.camera.file_source import FileSource


def list_devices() -> list[DeviceInfo]:
    """Cameras on USB that this version can drive."""
    return [info for module in FAMILIES.values() for info in importlib.import_module(module).find()]


def open_file(path: str) -> FileSource:
    """A driver that plays a recording; not opened yet."""
    from nodes.camera.file_source import FileSource

    return FileSource(path)


def find_driver(file: str | None, emulate: str | None, serial: str | None) -> Driver:
    """The driver for what was given; at most one of them. Raises ValueError, OSError for a device that is not there."""
    given = [name for name, value in (("file", file), ("emulate", emulate), ("serial", serial)) if value]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} are given; a camera is one of file, emulate and serial")
    path = file or emulate
    if path:
        return open_file(path)
    supported = ", ".join(FAMILIES) or "none in this version"
    for module in FAMILIES.values():
        devices = importlib.import_module(module).find()
        if any(not serial or d.serial == serial for d in devices):
            return importlib.import_module(module).open_device(serial)
    wanted = f"camera {serial}" if serial else "event camera"
    remedy = "play a recording instead, with file:=REC.raw or --file REC.raw"
    raise OSError(f"no {wanted} found (USB cameras supported: {supported}); {remedy}")
