"""Emulates a DVS128: biases and a run switch by vendor requests."""

from __future__ import annotations

from nodes.camera.emulated.device import EmulatedDevice, Identity, stall
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.usb.models import Model

DATA_IN = 0x86
START, STOP, BIASES, RESET_TIME, ARRAY_RESET, MASTER = 0xB3, 0xB4, 0xB8, 0xBB, 0xBD, 0xBE


class Dvs128Device(EmulatedDevice):
    """Emulates a DVS128, which streams between START and STOP once it has biases."""

    DATA = DATA_IN

    def __init__(self, identity: Identity, feed: Feed, faults: Faults) -> None:
        super().__init__(identity, feed, faults)
        self.power_up()

    def power_up(self) -> None:
        self.running, self.biases = False, b""

    def streaming(self) -> bool:
        return self.running and len(self.biases) == 36

    def vendor_in(self, request: int, value: int, index: int) -> bytes:
        stall()

    def vendor_out(self, request: int, value: int, index: int, data: bytes) -> None:
        if request in (START, STOP):
            self.running = request == START
        elif request == BIASES and len(data) == 36:
            self.biases = data
        elif request not in (RESET_TIME, ARRAY_RESET, MASTER):
            stall()


def make_device(model: Model, feed: Feed, faults: Faults, serial: str) -> Dvs128Device:
    """Makes an emulated DVS128."""
    vendor, product = model.ids[0]
    bcd = 0x0005 if faults.unknown_firmware else 0x000E
    identity = Identity(vendor, product, bcd, "DVS128", serial, (DATA_IN,), maker="iniVation (emulated)")
    return Dvs128Device(identity, feed, faults)
