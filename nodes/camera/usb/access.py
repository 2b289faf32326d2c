"""Opens USB devices through pyusb, and tells users what to do when that fails."""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import usb.backend.libusb1
import usb.core
import usb.util

RULES_FILE = "/etc/udev/rules.d/65-event-cameras.rules"
PERMISSION = (
    f"no permission to open it: run `evis camera udev | sudo tee {RULES_FILE}`, then "
    "`sudo udevadm control --reload && sudo udevadm trigger`, and plug it in again"
)
NO_LIBUSB = "libusb-1.0 was not found: `pip install 'evis[usb]'` brings it, or install your system's libusb-1.0"
UNSUPPORTED = "evis cannot drive it: record with the maker's program, and play that with file:=REC or --file REC"
"""What a user can do with a camera that has another sensor than those that the driver knows."""
DRAIN_READS, DRAIN_MS = 64, 10
"""Most reads that empty a camera's buffers, and how long each waits [ms]."""
CONTROL_MS = 1000
"""Longest wait for a control request or a command's answer [ms]."""


class Unplugged(OSError):
    """Reports that the device is gone."""


class StreamEnd(OSError):
    """Reports that an emulated device has sent all of its recording."""


@dataclass
class Bus:
    """Finds devices through a pyusb backend. An emulated bus brings its own `sleep` [s], which may return at once."""

    backend: Any
    sleep: Callable[[float], None] = time.sleep
    emulated: bool = False

    def devices(self, ids: Iterable[tuple[int, int]]) -> list[Any]:
        """Finds all usb.core.Device with one of these (vendor, product) pairs. Raises OSError."""
        wanted = set(ids)
        try:
            found = usb.core.find(
                find_all=True, backend=self.backend, custom_match=lambda d: (d.idVendor, d.idProduct) in wanted
            )
            return list(found or ())
        except usb.core.USBError as e:
            raise OSError(f"USB cannot be searched: {e.strerror or e}") from None


def usb_bus() -> Bus:
    """Opens the machine's own USB, with libusb from the `libusb-package` wheel or from the system. Raises OSError."""
    try:
        import libusb_package

        backend = libusb_package.get_libusb1_backend()
    except ImportError:
        backend = None
    backend = backend or usb.backend.libusb1.get_backend()
    if backend is None:
        raise OSError(NO_LIBUSB)
    return Bus(backend)


def label(device: Any) -> str:
    """Returns a device's USB ids and place: `04b4:00f5 on bus 1 address 7`."""
    return f"{device.idVendor:04x}:{device.idProduct:04x} on bus {device.bus} address {device.address}"


def readable_error(error: Exception, what: str) -> OSError:
    """Converts a USB error to one line for a user, with the remedy; any other error has one already.

    what: names the camera.
    """
    if isinstance(error, OSError) and not type(error).__module__.startswith("usb"):
        return error
    code = getattr(error, "errno", None)
    if isinstance(error, usb.core.USBTimeoutError) or code == errno.ETIMEDOUT:
        return OSError(f"{what}: no answer in {CONTROL_MS / 1000:g} s; unplug it and plug it in again")
    if code in (errno.EACCES, errno.EPERM):
        return OSError(f"{what}: {PERMISSION}")
    if code == errno.EBUSY:
        return OSError(f"{what}: busy: another program or node has it open; close that, or name another by serial")
    if code == errno.ENODATA:
        return StreamEnd(f"{what}: end of the recording")
    if code in (errno.ENODEV, errno.ENOENT):
        return Unplugged(f"{what}: it was unplugged")
    return OSError(f"{what}: USB failed: {getattr(error, 'strerror', None) or error}")


def claim(device: Any, interface: int, set_alternate: bool = True) -> None:
    """Claims an interface for this program, also from a kernel driver. Raises usb.core.USBError."""
    try:
        if device.is_kernel_driver_active(interface):
            device.detach_kernel_driver(interface)
    except NotImplementedError:
        pass
    try:
        device.get_active_configuration()
    except usb.core.USBError:
        device.set_configuration()
    usb.util.claim_interface(device, interface)
    if set_alternate:
        device.set_interface_altsetting(interface, 0)


def drain(device: Any, endpoint: int, size: int) -> None:
    """Clears a bulk endpoint and discards what an earlier program left in the camera's buffers.

    size: of one read [bytes].
    """
    device.clear_halt(endpoint)
    try:
        for _ in range(DRAIN_READS):
            device.read(endpoint, size, DRAIN_MS)
    except usb.core.USBTimeoutError:
        return


def release(device: Any) -> None:
    """Releases the device and its interfaces; an unplugged one needs no release."""
    try:
        usb.util.dispose_resources(device)
    except usb.core.USBError:
        pass


def string_descriptor(device: Any, index: int) -> str:
    """Reads a string descriptor, empty where there is none.

    Raises usb.core.USBError for a device that cannot be opened.
    """
    if not index:
        return ""
    try:
        return (usb.util.get_string(device, index) or "").strip("\x00 ")
    except ValueError:  # the device has no languages
        return ""
