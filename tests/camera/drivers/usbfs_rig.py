"""Real libusb on a faked kernel: run under `umockdev-wrapper` by the system's Python.

    umockdev-wrapper python3 usbfs_rig.py MODEL RECORDING TRANSFERS FAULTS

The emulated device sits behind usbfs ioctls; the driver reaches it through pyusb and libusb as it reaches a camera.
Prints one line of JSON.
"""

from __future__ import annotations

import array
import errno
import hashlib
import json
import struct
import sys
import threading
from typing import Any

import gi

gi.require_version("UMockdev", "1.0")
import usb.core  # noqa: E402
from gi.repository import GLib, UMockdev  # noqa: E402

from evis.events.arrays import Events  # noqa: E402
from nodes.camera.emulated.bus import emulated_device  # noqa: E402
from nodes.camera.emulated.device import EmulatedDevice  # noqa: E402
from nodes.camera.emulated.faults import Faults  # noqa: E402
from nodes.camera.emulated.recording_feed import RecordingFeed  # noqa: E402
from nodes.camera.find import on_usb  # noqa: E402
from nodes.camera.usb.access import usb_bus  # noqa: E402
from nodes.camera.usb.models import MODELS  # noqa: E402

NODE = "/dev/bus/usb/001/002"
SUBMIT, DISCARD, REAP, REAP_NOW, CLAIM, CLEAR_HALT, CAPABILITIES, GET_DRIVER = 10, 11, 12, 13, 15, 21, 26, 8
ACCEPTED = (4, 5, 16, 18, 20)
"""Set interface, set configuration, release, reset: done without further ado."""
CONTROL = 2


def describe(device: EmulatedDevice) -> str:
    """The device in umockdev's words, with the binary descriptors that the kernel would show."""
    d = device.identity
    endpoints = b"".join(
        struct.pack("<BBBBHB", 7, 5, e, 3 if e in d.interrupt else 2, 1024, e in d.interrupt)
        + struct.pack("<BBBBH", 6, 0x30, 0, 0, 0)
        for e in d.endpoints
    )
    interface = struct.pack("<9B", 9, 4, 0, 0, len(d.endpoints), 0xFF, 0x19, 0, 0)
    size = 9 + len(interface) + len(endpoints)
    head = struct.pack(
        "<BBHBBBBHHHBBBB", 18, 1, 0x0300, 0xFF, d.subclass, 0, 9, d.vendor, d.product, d.bcd_device, 1, 2, 3, 1
    )
    data = head + struct.pack("<BBHBBBBB", 9, 2, size, 1, 1, 0, 0x80, 100) + interface + endpoints
    lines = ["P: /devices/pci0000:00/0000:00:14.0/usb1/1-1", "N: bus/usb/001/002"]
    product = f"{d.vendor:x}/{d.product:x}/{d.bcd_device:x}"
    facts = {
        "BUSNUM": "001", "DEVNUM": "002", "DEVNAME": NODE, "DEVTYPE": "usb_device", "DRIVER": "usb", "MAJOR": "189",
        "MINOR": "1", "PRODUCT": product, "SUBSYSTEM": "usb",
    }  # fmt: skip
    lines += [f"E: {k}={v}" for k, v in facts.items()]
    attributes = {"bConfigurationValue": "1", "busnum": "1", "devnum": "2", "speed": "5000"}
    lines += [f"A: {k}={v}\\n" for k, v in attributes.items()]
    return "\n".join([*lines, f"H: descriptors={data.hex().upper()}", ""])


class Kernel(UMockdev.IoctlBase):  # type: ignore[misc]
    """Answers usbfs ioctls with the emulated device."""

    def serve(self, device: EmulatedDevice) -> None:
        self.device, self.waiting, self.ready = device, [], []

    def do_handle_ioctl(self, client: Any) -> bool:
        number, argument = client.get_request() & 0xFF, client.get_arg()
        result, error = 0, 0
        if number == CAPABILITIES:
            argument.resolve(0, 4).update(0, list(struct.pack("<I", 0x4D)))
        elif number == CLAIM:
            self.device.claimed = True
        elif number == CLEAR_HALT:
            self.device.halted.clear()
        elif number == SUBMIT:
            self.submit(argument)
        elif number == DISCARD:
            self.discard(argument.resolve(0, 56).client_addr)
        elif number in (REAP, REAP_NOW):
            self.pump()
            if self.ready:
                argument.resolve(0, 8).set_ptr(0, self.ready.pop(0))
            else:
                result, error = -1, errno.EAGAIN
        elif number not in ACCEPTED:
            result, error = -1, errno.ENODATA if number == GET_DRIVER else errno.ENOTTY
        client.complete(result, error)
        return True

    def submit(self, argument: Any) -> None:
        request = argument.resolve(0, 56)
        raw = bytes(request.retrieve())
        size = struct.unpack_from("<i", raw, 24)[0]
        self.waiting.append((request, raw[0], raw[1], size, request.resolve(16, size) if size else None))
        self.pump()

    def discard(self, address: int) -> None:
        for item in self.waiting:
            if item[0].client_addr == address:
                self.waiting.remove(item)
                self.finish(item[0], -errno.ENOENT, 0)
                return

    def finish(self, request: Any, status: int, size: int) -> None:
        request.update(4, list(struct.pack("<i", status)))
        request.update(28, list(struct.pack("<i", size)))
        self.ready.append(request)

    def pump(self) -> None:
        """Serve what waits, in order, as far as the device has something."""
        for item in list(self.waiting):
            request, kind, endpoint, size, buffer = item
            status, done = 0, 0
            try:
                done = self.transfer(kind, endpoint, size, buffer)
            except usb.core.USBTimeoutError:
                continue
            except usb.core.USBError as failure:
                gone = failure.errno in (errno.ENODATA, errno.ENODEV)
                status = -errno.EPIPE if failure.errno == errno.EPIPE else -errno.ESHUTDOWN if gone else -errno.EPROTO
            self.waiting.remove(item)
            self.finish(request, status, done)

    def transfer(self, kind: int, endpoint: int, size: int, buffer: Any) -> int:
        device = self.device
        if kind == CONTROL:
            raw = bytes(buffer.retrieve())
            to, request, value, index, length = struct.unpack_from("<BBHHH", raw)
            if not to & 0x80:
                return device.request_out(to, request, value, index, raw[8 : 8 + length])
            answer = device.request_in(to, request, value, index)[:length]
            buffer.update(8, list(answer))
            return len(answer)
        if not endpoint & 0x80:
            return device.bulk_out(endpoint, bytes(buffer.retrieve()))
        into = array.array("B", bytes(size))
        done = device.bulk_in(endpoint, into, 0.0)
        buffer.update(0, into[:done].tolist())
        return done


def main() -> None:
    name, path, transfers, faults = sys.argv[1:5]
    model = MODELS[name]
    device = emulated_device(model, RecordingFeed(path, model, 0.0), Faults.of(faults))
    testbed = UMockdev.Testbed.new()
    testbed.add_from_string(describe(device))
    kernel = Kernel()
    kernel.serve(device)
    testbed.attach_ioctl(NODE, kernel)
    threading.Thread(target=GLib.MainLoop().run, daemon=True).start()

    bus = usb_bus()
    bus.sleep = lambda seconds: None
    (driver,) = on_usb(bus)
    result: dict[str, Any] = {}
    parts = [Events.empty()]
    with driver:
        result["serial"], result["name"] = driver.info().serial, driver.info().name
        driver.configure(driver.settings_type().of({"decoder": "numpy", "transfers": transfers, "longest_ms": 10.0}))
        driver.start()
        try:
            while True:
                reading = driver.read(0.1)
                parts += [reading.events] if reading is not None else []
        except OSError as end:
            result["end"] = str(end)
        result["counters"] = driver.counters()
    events = Events.concatenate(parts)
    digest = hashlib.sha256()
    for values in (events.t // 1000, events.x, events.y, events.p):
        digest.update(values.tobytes())
    result |= {"samples": len(events.imu), "acceleration": float(events.imu.acceleration.sum())}
    print(json.dumps({**result, "events": len(events), "sha256": digest.hexdigest()}))


main()
