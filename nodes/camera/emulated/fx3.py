"""Emulates iniVation FX3 cameras: registers by module and parameter; data come while all registers of GATES hold their
values."""

from __future__ import annotations

import dataclasses
import struct

import numpy as np

from evis.events.arrays import Events
from nodes.camera.emulated.device import EmulatedDevice, Identity, stall
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.emulated.readout import Readout, lines_between
from nodes.camera.usb.models import Model

DATA_IN, DEBUG_IN = 0x82, 0x81
REGISTER, SEVERAL = 0xBF, 0xC2
BINNING, CROP = (5, 0x3202), 0x3300
"""The cropper: off, first group of eight rows and its mask, last group and its mask, first and last column as two bytes
each."""
FLIP_X, FLIP_Y = 2, 1
"""Bits of the orientation: the sensor counts from the far edge."""
FIRST_COLUMN, FIRST_ROW, LAST_COLUMN, LAST_ROW = (1, 41), (1, 42), (1, 43), (1, 44)
"""The region of interest of a DAVIS, by the numbers of the readout."""
FRAMES = 2, 4
"""Frames of a DAVIS are sent."""
IMU = 3
"""Module of the inertial chip."""
CLOCKS = {(6, 3): 90, (6, 4): 30, (6, 5): 80, (6, 6): 1000}
GATES = {
    "davis346": {(0, 0): 1, (0, 1): 1, (0, 3): 1, (9, 0): 1, (1, 3): 1},
    "dvxplorer": {(0, 0): 1, (0, 1): 1, (0, 3): 1, (9, 0): 1, (1, 3): 1, (5, 0x3000): 2, (5, 0x3067): 0x80},
    "dvxplorer_lite": {(0, 0): 1, (0, 1): 1, (0, 3): 1, (9, 0): 1, (1, 3): 1, (5, 0x3000): 2, (5, 0x3204): 9},
    "dvxplorer_mini": {(5, 0x3000): 2},
    "dvxplorer_micro": {(1, 3): 1, (1, 11): 1},
}
FIRMWARE = {"davis346": 0x0006, "dvxplorer": 0x0009, "dvxplorer_lite": 0x0009, "dvxplorer_mini": 0x0401,
            "dvxplorer_micro": 0x040A}  # fmt: skip
CHIPS = {"dvxplorer_lite": 19}
MODULES = {"dvxplorer_mini": (1, 3, 5), "dvxplorer_micro": (1, 3)}
"""Register modules of the small models, which have neither multiplexer nor system registers; the others have all."""


class Fx3Device(EmulatedDevice):
    """Emulates a DAVIS346, DVXplorer, Mini or Micro."""

    DATA = DATA_IN
    HONOURED = frozenset(("roi_x", "roi_y", "roi_width", "roi_height", "binning", "frames", "imu", "trigger_in"))

    def __init__(self, model: Model, identity: Identity, feed: Feed, faults: Faults) -> None:
        super().__init__(identity, feed, faults)
        self.model = model
        self.register_size = 8 if model.name == "dvxplorer_micro" else 4
        self.power_up()

    def power_up(self) -> None:
        logic = 11 if self.faults.unknown_firmware else 18
        fixed = {(6, 0): logic, (6, 7): 4, (6, 1): CHIPS.get(self.model.name, 1), (6, 2): 1, **CLOCKS}
        size = {
            (1, 0): self.model.width,
            (1, 1): self.model.height,
            (2, 0): self.model.width,
            (2, 1): self.model.height,
        }
        if self.faults.unknown_chip:
            size[1, 0] = 999
        self.fixed = size if self.model.name in MODULES else {**fixed, **size, (2, 6): 1}
        self.registers: dict[tuple[int, int], int] = {}
        self.writes: list[tuple[int, int, int]] = []
        self.registers_changed = True

    def streaming(self) -> bool:
        return all(self.registers.get(at, 0) == value for at, value in GATES[self.model.name].items())

    def vendor_in(self, request: int, value: int, index: int) -> bytes:
        if request != REGISTER or not self._has(value):
            stall()
        number = self.fixed.get((value, index), self.registers.get((value, index), 0))
        return number.to_bytes(self.register_size, "big")

    def vendor_out(self, request: int, value: int, index: int, data: bytes) -> None:
        if request == REGISTER and len(data) == self.register_size:
            self._store(value, index, int.from_bytes(data, "big"))
        elif request == SEVERAL and len(data) == 6 * value:
            for i in range(value):
                module, parameter, number = struct.unpack_from(">BBI", data, 6 * i)
                self._store(module, parameter, number)
        else:
            stall()

    def _store(self, module: int, parameter: int, number: int) -> None:
        if not self._has(module):
            stall()
        self.writes.append((module, parameter, number))
        self.registers[module, parameter] = number
        self.registers_changed = True
        if module == IMU:
            self.feed.imu_queue.expect(self._samples_run())

    def _samples_run(self) -> bool:
        """Tells whether any part of the inertial sensor is on."""
        return any(self.registers.get((IMU, p), 0) for p in (2, 3, 4))

    def readout(self) -> Readout:
        r, result = self.registers, Readout(self.counts, imu=self._samples_run())
        if self.model.name == "davis346":
            size = self.model.width, self.model.height
            result.columns = lines_between(r.get(FIRST_COLUMN, 0), r.get(LAST_COLUMN, size[0]), size[0])
            result.rows = lines_between(r.get(FIRST_ROW, 0), r.get(LAST_ROW, size[1]), size[1])
            result.frames = bool(r.get(FRAMES, 0))
        elif r.get((5, CROP), 1) == 0:
            result.columns, result.rows = self._cropped([r.get((5, CROP + i), 0) for i in range(9)])
        if r.get(BINNING):
            result.transform = self._binned
        return result

    def _cropped(self, crop: list[int]) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Returns the columns and rows that the cropper lets through. In a single group of rows the last mask
        counts."""
        _, top, first, bottom, last, *columns = crop
        groups = np.zeros(-(-self.model.height // 8), np.uint8)
        groups[top : bottom + 1] = 0xFF
        groups[top] &= first
        groups[bottom] = last if top == bottom else groups[bottom] & last
        rows = np.unpackbits(groups, bitorder="little")[: self.model.height].astype(bool)
        across = lines_between(columns[0] << 8 | columns[1], columns[2] << 8 | columns[3], self.model.width)
        flips = self.fixed.get((1, 2), 0)
        if across is not None and flips & FLIP_X:
            across = across[::-1]
        return across, None if rows.all() else rows[::-1] if flips & FLIP_Y else rows

    def _binned(self, events: Events) -> Events:
        """Merges two by two pixels into one; an axis that is read out from the far edge begins at half of the
        sensor."""
        flips = self.fixed.get((1, 2), 0)
        x = (events.x >> 1) + np.uint16(self.model.width // 2 if flips & FLIP_X else 0)
        y = (events.y >> 1) + np.uint16(self.model.height // 2 if flips & FLIP_Y else 0)
        return dataclasses.replace(events, x=x, y=y)

    def answer(self, timeout_s: float) -> bytes:
        """Returns a packet of a Mini's inertial samples while they are on; the debug endpoint of the others is
        silent."""
        runs = self.model.name in MODULES and self._samples_run()
        return self.feed.imu_queue.get(timeout_s) if runs else b""

    def _has(self, module: int) -> bool:
        """Tells whether the model has a module of registers."""
        return module in MODULES.get(self.model.name, (0, 1, 2, 3, 4, 5, 6, 9))


def make_device(model: Model, feed: Feed, faults: Faults, serial: str) -> Fx3Device:
    """Makes an emulated iniVation FX3 camera."""
    vendor, product = model.ids[0]
    bcd = 0x0001 if faults.unknown_firmware and model.name not in MODULES else FIRMWARE[model.name]
    maker, endpoints = "iniVation (emulated)", (DEBUG_IN, DATA_IN)
    identity = Identity(vendor, product, bcd, model.sensor, serial, endpoints, maker=maker, interrupt=(DEBUG_IN,))
    return Fx3Device(model, identity, feed, faults)
