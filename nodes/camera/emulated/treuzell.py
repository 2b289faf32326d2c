"""Emulates a Treuzell board with a sensor's register file behind it.

It streams only when the registers that gate the sensor's output hold what the sensor needs: what the driver writes is
judged by its effect and not against the driver's own lists.
"""

from __future__ import annotations

import errno
import struct
from collections import deque
from dataclasses import dataclass, field

from nodes.camera.emulated.device import EmulatedDevice, Identity, stall, timeout
from nodes.camera.emulated.faults import Faults
from nodes.camera.emulated.feed import Feed
from nodes.camera.emulated.readout import RateLimit, Readout, lines_of_masks
from nodes.camera.usb.models import Model

CONTROL_IN, CONTROL_OUT, DATA_IN = 0x82, 0x02, 0x81
WRITE, FAILURE = 0x4000_0000, 0x8000_0000
RELEASE = {"evk": (3, 9, 0), "old": (2, 1, 0)}


@dataclass(frozen=True)
class Gate:
    """Holds the register values (register, mask, value) that must all be set for the sensor to send.

    `initial`: what chips hold at power-up.
    """

    compatible: str
    chip: dict[int, int]
    needs: tuple[tuple[int, int, int], ...]
    initial: dict[int, int] = field(default_factory=dict)


IMX636_BIASES = {
    0x1000: 0x7C,
    0x1004: 0x53,
    0x100C: 0,
    0x1010: 0x66,
    0x1014: 0x4D,
    0x1018: 0x49,
    0x101C: 0x5B,
    0x1020: 0x14,
}
_ON = ((0x9028, 0x3, 0), (0x9008, 1, 1), (0x4, 1 << 10, 1 << 10))
"""Time base enabled, its reset released, readout on: IMX636 and Gen4.1."""
GATES = {
    "IMX636": Gate(
        "psee,ccam5_imx636",
        {0x14: 0xA040_1806, 0xF128: 0},
        (*_ON, (0xB000, 0x3FF, 0x2F9), (0x7000, 0xFFFF_FFFF, 0x7_0001), (0x8000, 0xFFFF_FFFF, 0x1_E085)),
        {a: 0x11A1_0000 | v for a, v in IMX636_BIASES.items()},
    ),
    "Gen4.1": Gate("psee,ccam5_gen41", {0x14: 0xA030_1003}, (*_ON, (0xB000, 0x3FF, 0x2D9))),
    "Gen3.1": Gate(
        "psee,ccam5_fpga",
        {0x800: 0x28, 0x804: 0x0003_0900, 0x218: 0x9020_0C02},
        ((0x0, 0xC_0007, 0xC_0007), (0x204, 0x2B, 0x2B), (0x238, 1, 1), (0x248, 1, 0), (0x8, 0x300, 0x300)),
    ),
    "GenX320": Gate(
        "psee,cx3_saphir", {0x14: 0x3050_1C01}, ((0x9028, 0x3, 0), (0x9008, 1, 1), (0x0, 1 << 10, 1 << 10))
    ),
}
TEMPERATURE_C = 41.0
REGION_MASKS = {
    "IMX636": ((0x2000, 40), (0x4000, 23)), "Gen4.1": ((0x2000, 40), (0x4000, 23)), "Gen3.1": ((0x400, 20), (0x500, 15))
}  # fmt: skip
"""Masks of columns and of rows: first register and registers."""
REGION_SWITCH = {"IMX636": 0x4, "Gen4.1": 0x4, "Gen3.1": 0x204}
"""Register whose bit 5 puts the masks into effect: while it is set, or (Gen3.1) when it becomes set."""
RATE_CONTROL, RATE_PERIOD, RATE_TARGET = 0x6000, 0x6008, 0x600C
"""The rate controller: on in bit 0, period [us], events in it."""


class TreuzellDevice(EmulatedDevice):
    """Emulates a Treuzell board: frames on the command endpoint, answers on the other, events on the third."""

    DATA = DATA_IN
    HONOURED = frozenset(
        ("roi_x", "roi_y", "roi_width", "roi_height", "event_rate_limit", "trigger_in", "legacy_writes")
    )

    def __init__(self, model: Model, identity: Identity, feed: Feed, faults: Faults) -> None:
        super().__init__(identity, feed, faults)
        self.gate, self.model = GATES[model.sensor], model
        self._answers: deque[bytes] = deque()
        self.power_up()

    def power_up(self) -> None:
        self.registers = {**self.gate.initial, **self.gate.chip}
        if self.faults.unknown_chip:
            self.registers[0x14] = self.registers[0x800] = 0xDEAD_BEEF
        self.writes: list[tuple[int, int]] = []
        self.latched: dict[int, int] = {}
        """Masks as they were when the switch was last set."""
        self.rate_set = False
        self._limit = RateLimit(0, 0)
        self.registers_changed = True
        self._answers.clear()

    def streaming(self) -> bool:
        return all(self.registers.get(a, 0) & mask == value for a, mask, value in self.gate.needs)

    def readout(self) -> Readout:
        sensor, result = self.model.sensor, Readout(self.counts)
        if sensor not in REGION_MASKS:
            return result
        below = sensor != "Gen3.1"
        masks = self.registers if below else self.latched
        if self.registers.get(REGION_SWITCH[sensor], 0) & 1 << 5:
            (column, columns), (row, rows) = REGION_MASKS[sensor]
            result.columns = lines_of_masks([masks.get(column + 4 * i) for i in range(columns)], self.model.width)
            result.rows = lines_of_masks([masks.get(row + 4 * i) for i in range(rows)], self.model.height)
            if below and result.rows is not None:
                result.rows = result.rows[::-1]  # they count from the bottom
        if below and self.rate_set and self.registers.get(RATE_CONTROL, 0) & 1:
            target, period_ns = self.registers[RATE_TARGET], self.registers[RATE_PERIOD] * 1000
            if (self._limit.most, self._limit.period_ns) != (target, period_ns):
                self._limit = RateLimit(target, period_ns)
            result.limit = self._limit
        return result

    def vendor_in(self, request: int, value: int, index: int) -> bytes:
        kinds = {"IMX636": b"\x31\0", "Gen4.1": b"\x30\0", "Gen3.1": b"\0\0", "GenX320": b"\x40\0"}
        if request != 0x72:
            stall()
        return next(kinds[name] for name, gate in GATES.items() if gate is self.gate)

    def vendor_out(self, request: int, value: int, index: int, data: bytes) -> None:
        stall()

    def answer(self, timeout_s: float) -> bytes:
        if not self._answers:
            timeout()
        return self._answers.popleft()

    def command(self, data: bytes) -> None:
        code, size = struct.unpack_from("<II", data)
        body = data[8 : 8 + size]
        if len(body) != size:
            self._reply(FAILURE, b"")
            return
        handlers = {
            0x72: lambda b: int(self.identity.serial, 16).to_bytes(8, "little"),
            0x79: lambda b: struct.pack("<I", self._release()),
            0x7A: lambda b: (1_700_000_000).to_bytes(8, "little"),
            0x1_0000: lambda b: struct.pack("<I", 2),
            0x1_0001: lambda b: b[:4] + (b"sensor\0", b"tmp103\0")[b[0]],
            0x1_0003: lambda b: b[:4] + (self._compatible(), b"ti,tmp103\0")[b[0]],
            0x1_0102: self._read,
            0x1_0102 | WRITE: self._write,
            0x55: lambda b: b[:4] + struct.pack("<I", self.registers.get(struct.unpack("<I", b[:4])[0], 0)),
            0x56 | WRITE: self._write_legacy,
        }
        if code not in handlers:
            self._reply(FAILURE, b"")
            return
        try:
            self._reply(code, handlers[code](body))
        except (struct.error, IndexError):
            self._reply(code | FAILURE, body[:8].ljust(8, b"\0") + struct.pack("<I", errno.EINVAL))

    def _reply(self, code: int, body: bytes) -> None:
        self._answers.append(struct.pack("<II", code, len(body)) + body)

    def _release(self) -> int:
        major, minor, patch = RELEASE["old" if self.faults.unknown_firmware else "evk"]
        return major << 16 | minor << 8 | patch

    def _compatible(self) -> bytes:
        known = self.gate.compatible.encode() + b"\0treuzell,streamer\0"
        # a board of a vendor with its own numbering of releases: what is unknown is the sensor's name
        return b"acme,new_sensor\0" if self.faults.unknown_firmware else known

    def _read(self, body: bytes) -> bytes:
        device, address, count = struct.unpack("<III", body)
        if device or not 0 < count <= 250:
            raise struct.error
        values = [self._value(address + 4 * i) for i in range(count)]
        return struct.pack(f"<II{count}I", device, address, *values)

    def _value(self, address: int) -> int:
        if address == 0x50 and self.registers.get(0x4C, 0) & 1 << 2:
            return 1 << 11 | round((TEMPERATURE_C + 56) / 0.19)
        return self.registers.get(address, 0)

    def _write(self, body: bytes) -> bytes:
        device, address, *values = struct.unpack(f"<{len(body) // 4}I", body)
        if device or not values:
            raise struct.error
        for i, value in enumerate(values):
            self._store(address + 4 * i, value)
        return struct.pack("<II", device, address)

    def _write_legacy(self, body: bytes) -> bytes:
        address, value = struct.unpack("<II", body)
        self._store(address, value)
        return body

    def _store(self, address: int, value: int) -> None:
        self.writes.append((address, value))
        if address == REGION_SWITCH.get(self.model.sensor) and ~self.registers.get(address, 0) & value & 1 << 5:
            self.latched = dict(self.registers)
        # As the start list of the Gen4.1 leaves it (20 Mev/s) a recording has gone through it already.
        self.rate_set |= address == RATE_CONTROL and not value & 1
        if address not in self.gate.chip:
            self.registers[address] = value
        self.registers_changed = True  # last: the thread that reads the data looks at the registers then


def make_device(model: Model, feed: Feed, faults: Faults, serial: str) -> TreuzellDevice:
    """Makes an emulated camera of one of the Treuzell models."""
    vendor, product = model.ids[0]
    names = {"silkyevcam": "SilkyEvCam Gen3.1 v03.09.00C", "silkyevcam_hd": "SilkyEvCam HD v03.09.00C"}
    name = names.get(model.name, model.title.removeprefix("Prophesee "))
    identity = Identity(vendor, product, 0x0309, name, serial, (CONTROL_IN, CONTROL_OUT, DATA_IN), 0x19, model.title)
    return TreuzellDevice(model, identity, feed, faults)
