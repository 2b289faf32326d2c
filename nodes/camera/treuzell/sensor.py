"""Describes a sensor on a Treuzell board by its register sequences."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from nodes.camera.treuzell.protocol import Board, TreuzellError

_OPERATION = re.compile(r"(\?)?([0-9A-F]+)([=~])([0-9A-F]+)(?:/([0-9A-F]+))?|d(\d+)")


@dataclass(frozen=True)
class Operation:
    """Describes one register operation; kind: `write`, `modify` (the bits of mask), `read` or `wait` (value = us)."""

    kind: str
    address: int
    value: int
    mask: int = 0xFFFF_FFFF


@cache
def sequences(name: str) -> dict[str, tuple[Operation, ...]]:
    """Reads the phases `init`, `start`, `stop`, `destroy` of a sensor from sequences/<name>.txt."""
    result: dict[str, tuple[Operation, ...]] = {}
    for section in (Path(__file__).parent / "sequences" / f"{name}.txt").read_text().split("[")[1:]:
        phase, _, body = section.partition("]")
        result[phase] = tuple(_operation(word) for word in body.split())
    return result


def _operation(word: str) -> Operation:
    found = _OPERATION.fullmatch(word)
    if found is None:
        raise ValueError(f"no register operation: {word}")
    question, address, sign, value, mask, wait = found.groups()
    if wait:
        return Operation("wait", 0, int(wait))
    kind = "read" if question else "modify" if sign == "~" else "write"
    return Operation(kind, int(address, 16), int(value, 16), int(mask or "FFFFFFFF", 16))


class Registers:
    """Reads and writes the registers of one sub-device. legacy: write by the older FPGA property. sleep [s]."""

    def __init__(self, board: Board, sub_device: int, sleep: Callable[[float], None], legacy: bool = False) -> None:
        self.board, self.sub_device, self._sleep, self.legacy = board, sub_device, sleep, legacy
        self._originals: dict[int, int] = {}

    def read(self, address: int) -> int:
        """Reads a register."""
        return self.board.read(self.sub_device, address)

    def original(self, address: int) -> int:
        """Returns what a register held when it was first asked for here, which must be before a setting is written to
        it: the factory's or the start list's value."""
        if address not in self._originals:
            self._originals[address] = self.read(address)
        return self._originals[address]

    def write(self, address: int, *values: int) -> None:
        """Writes consecutive registers from an address."""
        if self.legacy:
            for i, value in enumerate(values):
                self.board.write_legacy(address + 4 * i, value)
        else:
            self.board.write(self.sub_device, address, *values)

    def modify(self, address: int, mask: int, value: int) -> None:
        """Sets the bits of mask to those of value."""
        self.write(address, self.read(address) & ~mask & 0xFFFF_FFFF | value & mask)

    def run(self, operations: tuple[Operation, ...]) -> None:
        """Runs the operations of a phase, in order."""
        for o in operations:
            if o.kind == "write":
                self.write(o.address, o.value)
            elif o.kind == "modify":
                self.modify(o.address, o.mask, o.value)
            elif o.kind == "read":
                self.read(o.address)
            else:
                self._sleep(o.value / 1e6)

    def wait(self, seconds: float) -> None:
        """Waits for the sensor to settle [s]."""
        self._sleep(seconds)


def expect(registers: Registers, sensor: str, address: int, mask: int, *values: int) -> None:
    """Raises TreuzellError unless a register holds one of the values, by which the chip is recognised."""
    got = registers.read(address) & mask
    if got not in values:
        wanted = " or ".join(f"{v:#x}" for v in values)
        raise TreuzellError(f"unknown chip: register {address:#x} of the {sensor} reads {got:#x}, not {wanted}")


def span_words(start: int, size: int, words: int) -> list[int]:
    """Returns bit masks of 32 columns (or rows) per word with the bits start .. start + size - 1 set."""
    bits = ((1 << size) - 1) << start
    return [bits >> 32 * i & 0xFFFF_FFFF for i in range(words)]
