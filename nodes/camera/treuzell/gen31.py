"""Describes the Prophesee Gen3.1 VGA (SilkyEvCam EvC3A, EVK3 Gen3.1): 640x480, EVT3."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from nodes.camera.interface.settings import setting
from nodes.camera.treuzell.sensor import Registers, expect, span_words
from nodes.camera.usb.region import region_of, roi_columns, roi_differs, roi_left, roi_rows, roi_top
from nodes.camera.usb.settings import UsbSettings

WIDTH, HEIGHT = 640, 480
BIAS = {
    "diff_off": (0x34C, "voltage"),
    "diff_on": (0x350, "voltage"),
    "diff": (0x354, "voltage"),
    "fo": (0x358, "fo"),
    "pr": (0x35C, "pr"),
    "refr": (0x360, "refr"),
    "hpf": (0x364, "pr"),
}
"""Register and table of each bias; a voltage has its code in bits 0-7, a current in bits 8-20."""
VOLTAGE_MASK, CURRENT_MASK = 0xFF, 0x1F_FF00


@dataclass
class Gen31Settings(UsbSettings):
    """Holds a Gen3.1's settings; biases are in mV, as Prophesee's tools give them.

    Only those that differ from the start list are written.

    pr and hpf go down to 1158 mV: below, the maker's tables change the circuit's mode and not only the code.
    """

    bias_diff: int = setting(299, "reference of the thresholds", "mV", 200, 400)
    bias_diff_on: int = setting(384, "contrast threshold ON, at least 75 above diff", "mV", 275, 400)
    bias_diff_off: int = setting(221, "contrast threshold OFF, at least 65 below diff", "mV", 100, 335)
    bias_fo: int = setting(1477, "low-pass corner of the photoreceptor", "mV", 1250, 1800)
    bias_hpf: int = setting(1499, "high-pass corner", "mV", 1158, 1800)
    bias_pr: int = setting(1250, "photoreceptor", "mV", 1158, 1800)
    bias_refr: int = setting(1500, "refractory period", "mV", 1300, 1800)
    roi_x: int = roi_left(WIDTH)
    roi_y: int = roi_top(HEIGHT)
    roi_width: int = roi_columns(WIDTH)
    roi_height: int = roi_rows(HEIGHT)
    trigger_in: bool = setting(False, "report edges of the trigger input")
    legacy_writes: bool = setting(
        False, "write registers by the older FPGA command (for a board that stays silent)", live=False
    )

    def check(self) -> None:
        super().check()
        region_of(self, WIDTH, HEIGHT)
        low = self.bias_fo < 1350
        on, off = (95, 85) if low else (75, 65)
        if self.bias_diff_on < self.bias_diff + on or self.bias_diff_off > self.bias_diff - off:
            raise ValueError(
                f"bias_diff_on {self.bias_diff_on} mV must lie {on} mV above and bias_diff_off {self.bias_diff_off} mV "
                f"{off} mV below bias_diff {self.bias_diff} mV"
            )
        if self.bias_fo < 1400 and self.bias_refr < 1350:
            raise ValueError(f"bias_refr {self.bias_refr} mV must be at least 1350 mV while bias_fo is below 1400 mV")


@cache
def tables() -> dict[str, tuple[int, np.ndarray]]:
    """Reads the tables of bias codes: name -> (first value [mV], code of each mV from there on)."""
    result = {}
    text = (Path(__file__).parent / "sequences" / "gen31_bias.txt").read_text()
    for section in text.split("[")[1:]:
        head, _, body = section.partition("]")
        name, first = head.split()
        runs = [word.partition("*") for word in body.split()]
        codes = np.repeat([int(code) for code, _, _ in runs], [int(count or 1) for _, _, count in runs])
        result[name] = (int(first), codes)
    return result


def code_of(table: str, millivolt: int) -> int:
    """Returns the code of a bias [mV]."""
    first, codes = tables()[table]
    return int(codes[millivolt - first])


def check_chip(registers: Registers) -> None:
    """Raises TreuzellError unless this is a Gen3.1 behind its FPGA; the chip id can be read only after init."""
    expect(registers, "Gen3.1", 0x800, 0xFF, 0x28)


def apply(registers: Registers, settings: Gen31Settings, before: Gen31Settings | None) -> None:
    """Writes biases, region of interest and trigger, as far as they differ from `before`."""
    standard = Gen31Settings()
    held = before or standard
    for name, (address, table) in BIAS.items():
        value = getattr(settings, f"bias_{name}")
        if value == getattr(held, f"bias_{name}"):
            continue
        mask = VOLTAGE_MASK if table == "voltage" else CURRENT_MASK
        original = registers.original(address)
        if value == getattr(standard, f"bias_{name}"):  # of hpf the start list has another code than the maker's table
            code = original
        else:
            code = code_of(table, value) << (0 if table == "voltage" else 8)
        registers.modify(address, mask, code)
    if roi_differs(settings, held):
        region = region_of(settings, WIDTH, HEIGHT)
        registers.write(0x400, *span_words(region.left, region.width, 20))
        registers.write(0x500, *span_words(region.top, region.height, 15))
        for value in (0, 1 << 5):  # the change of this bit applies the masks
            registers.modify(0x204, 1 << 5, value)
    if before is None or settings.trigger_in != before.trigger_in:
        registers.modify(0x1A0, 1, int(settings.trigger_in))
