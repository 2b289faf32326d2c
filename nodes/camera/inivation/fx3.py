"""Implements the register protocol of iniVation's FX3 cameras: 32-bit registers by module and parameter, over vendor
requests.

Facts from the public sources of libcaer (BSD-2-Clause).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from nodes.camera.usb.access import CONTROL_MS, claim, drain, string_descriptor
from nodes.camera.usb.driver import UsbDriver

DATA_IN, DEBUG_IN = 0x82, 0x81
REGISTER = 0xBF
OUT, IN = 0x40, 0xC0
MULTIPLEXER, DVS, APS, IMU, INPUT, CHIP, SYSTEM, USB = 0, 1, 2, 3, 4, 5, 6, 9
IMU_RUN = (2, 3, 4)
"""Parameters of the module IMU that switch on acceleration, rotation and temperature."""
LOGIC_VERSION = 18
TRANSPOSED = 4
"""Bit of a sensor's orientation register: its columns are read out as rows."""
_WRITE = re.compile(r"(\d+),(\d+)=(\d+|(?:(\d+)\*)?(LC|UC|GS))|d(\d+)")


class Registers:
    """Reads and writes the registers of one camera. sleep [s]. size: bytes of a register on the wire."""

    def __init__(self, device: Any, sleep: Callable[[float], None], size: int = 4) -> None:
        self._device, self._sleep, self._size = device, sleep, size

    def read(self, module: int, parameter: int) -> int:
        """Reads one register. Raises usb.core.USBError, OSError for an answer that is too short."""
        body = bytes(self._device.ctrl_transfer(IN, REGISTER, module, parameter, self._size, CONTROL_MS))
        if len(body) != self._size:
            raise OSError(f"register {module},{parameter}: an answer of {len(body)} bytes, not {self._size}")
        return int.from_bytes(body, "big")

    def write(self, module: int, parameter: int, value: int) -> None:
        """Writes one register."""
        body = value.to_bytes(self._size, "big")
        self._device.ctrl_transfer(OUT, REGISTER, module, parameter, body, CONTROL_MS)

    def run(self, words: tuple[str, ...], values: Mapping[str, float], hooks: Mapping[str, Callable[[], None]]) -> None:
        """Runs a sequence of writes, waits and named steps (`halt`, `configuration`).

        values: clocks in MHz (LC, UC), GS.
        """
        for word in words:
            if word in hooks:
                hooks[word]()
                continue
            found = _WRITE.fullmatch(word)
            if found is None:
                raise ValueError(f"no register write: {word}")
            module, parameter, value, factor, name, wait = found.groups()
            if wait:
                self._sleep(int(wait) / 1e6)
            else:
                number = round(int(factor or 1) * values[name]) if name else int(value)
                self.write(int(module), int(parameter), number)

    def clocks(self) -> dict[str, float]:
        """Returns the logic, ADC and USB clocks [MHz] by name."""
        deviation = self.read(SYSTEM, 6) / 1000
        return {name: self.read(SYSTEM, p) * deviation for name, p in (("LC", 3), ("AC", 4), ("UC", 5))}


@cache
def sequences(name: str) -> dict[str, tuple[str, ...]]:
    """Reads the phases of a camera's register sequences from sequences/<name>.txt."""
    sections = (Path(__file__).parent / "sequences" / f"{name}.txt").read_text().split("[")[1:]
    return {s.partition("]")[0]: tuple(s.partition("]")[2].split()) for s in sections}


class Fx3Camera(UsbDriver):
    """Opens, starts and stops the FX3 bridge that DAVIS346 and DVXplorer share."""

    ENDPOINT = DATA_IN
    registers: Registers

    def _claim(self, oldest: int, register_size: int = 4) -> dict[str, Any]:
        """Claims the device and checks its firmware; returns the first details of its description. Raises OSError."""
        claim(self.device, 0)
        self.registers = Registers(self.device, self.bus.sleep, register_size)
        firmware = self.device.bcdDevice & 0xFF
        if firmware < oldest:
            raise OSError(f"{self.name}: unknown firmware {firmware}; {oldest} or later is needed: update it with DV")
        self.serial = string_descriptor(self.device, self.device.iSerialNumber)
        product = string_descriptor(self.device, self.device.iProduct)
        return {"firmware": str(firmware), "product": product}

    def _check_logic(self, least_patch: int) -> str:
        """Checks that the FPGA's logic is a known one, and returns its version. Raises OSError."""
        version, patch = self.registers.read(SYSTEM, 0), self.registers.read(SYSTEM, 7)
        if version != LOGIC_VERSION or patch < least_patch:
            raise OSError(
                f"{self.name}: unknown firmware: logic {version}.{patch}; {LOGIC_VERSION}.{least_patch} is needed: "
                "update it with DV"
            )
        return f"{version}.{patch}"

    def _switch_samples(self, on: bool) -> None:
        """Switches inertial samples on or off."""
        for parameter in IMU_RUN:
            self.registers.write(IMU, parameter, int(on))

    def _halt(self) -> None:
        """Discards what an earlier program left in the camera's buffers."""
        drain(self.device, DATA_IN, 1 << 14)
