"""Emulated iniVation FX3 cameras: registers by module and parameter; data when every gate is open."""

from __future__ import annotations

import errno
import struct

import usb.core

from nodes.camera.emulated.device import EmulatedDevice, Identity, stall
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.usb.models import Model

DATA_IN, DEBUG_IN = 0x82, 0x81
REGISTER, SEVERAL = 0xBF, 0xC2
CLOCKS = {(6, 3): 90, (6, 4): 30, (6, 5): 80, (6, 6): 1000}
GATES = {
    "davis346": {(0, 0): 1, (0, 1): 1, (0, 3): 1, (9, 0): 1, (1, 3): 1},
    "dvxplorer": {(0, 0): 1, (0, 1): 1, (0, 3): 1, (9, 0): 1, (1, 3): 1, (5, 0x3000): 2, (5, 0x3067): 0x80},
    "dvxplorer_mini": {(5, 0x3000): 2},
}
FIRMWARE = {"davis346": 0x0006, "dvxplorer": 0x0009, "dvxplorer_mini": 0x0401}


class Fx3Device(EmulatedDevice):
    """A DAVIS346, DVXplorer or Mini."""

    DATA = DATA_IN

    def __init__(self, model: Model, identity: Identity, feed: Feed, faults: Faults) -> None:
        super().__init__(identity, feed, faults)
        self.model = model
        self.power_up()

    def power_up(self) -> None:
        logic = 11 if self.faults.unknown_firmware else 18
        fixed = {(6, 0): logic, (6, 7): 4, (6, 1): 1, (6, 2): 1, **CLOCKS}
        size = {
            (1, 0): self.model.width,
            (1, 1): self.model.height,
            (2, 0): self.model.width,
            (2, 1): self.model.height,
        }
        if self.faults.unknown_chip:
            size[1, 0] = 999
        # the Mini has neither multiplexer nor system registers
        self.fixed = size if self.model.name == "dvxplorer_mini" else {**fixed, **size, (2, 6): 1}
        self.registers: dict[tuple[int, int], int] = {}
        self.writes: list[tuple[int, int, int]] = []

    def streaming(self) -> bool:
        return all(self.registers.get(at, 0) == value for at, value in GATES[self.model.name].items())

    def vendor_in(self, request: int, value: int, index: int) -> bytes:
        if request != REGISTER or not self._has(value):
            stall()
        return struct.pack(">I", self.fixed.get((value, index), self.registers.get((value, index), 0)))

    def vendor_out(self, request: int, value: int, index: int, data: bytes) -> None:
        if request == REGISTER and len(data) == 4:
            self._store(value, index, struct.unpack(">I", data)[0])
        elif request == SEVERAL and len(data) == 6 * value:
            for i in range(value):
                module, parameter, number = struct.unpack_from(">BBI", data, 6 * i)
                self._store(module, parameter, number)
        else:
            stall()

    def _store(self, module: int, parameter: int, number: int) -> None:
        if not self._has(module):
            raise usb.core.USBError("Pipe error", -9, errno.EPIPE)
        self.writes.append((module, parameter, number))
        self.registers[module, parameter] = number

    def _has(self, module: int) -> bool:
        return module in ((1, 3, 5) if self.model.name == "dvxplorer_mini" else (0, 1, 2, 3, 4, 5, 6, 9))


def make_device(model: Model, feed: Feed, faults: Faults, serial: str) -> Fx3Device:
    """An emulated iniVation FX3 camera."""
    vendor, product = model.ids[0]
    bcd = 0x0001 if faults.unknown_firmware and model.name != "dvxplorer_mini" else FIRMWARE[model.name]
    identity = Identity(vendor, product, bcd, model.sensor, serial, (DEBUG_IN, DATA_IN), maker="iniVation (emulated)")
    return Fx3Device(model, identity, feed, faults)
