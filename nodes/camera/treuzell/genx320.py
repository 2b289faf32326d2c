"""Describes the Prophesee GenX320 (EVK3): 320x320, EVT2.1. Two chip revisions with their own start lists."""

from __future__ import annotations

from dataclasses import dataclass

from nodes.camera.interface.settings import setting
from nodes.camera.treuzell.sensor import Registers
from nodes.camera.usb.settings import UsbSettings

WIDTH, HEIGHT = 320, 320
ES_CHIP = 0x3050_1C01
BIAS = {"fo": 0x1004, "hpf": 0x1100, "diff_on": 0x1104, "diff": 0x1108, "diff_off": 0x110C}
_SINGLE = 1 << 28
"""Makes the sensor take over one changed bias."""


@dataclass
class GenX320Settings(UsbSettings):
    """Holds a GenX320's settings; biases are codes of 7 bits, and one that is not given stays as the start list sets
    it."""

    bias_fo: int | None = setting(None, "low-pass corner of the photoreceptor; recommended 19 to 39", "code", 0, 127)
    bias_hpf: int | None = setting(None, "high-pass corner", "code", 0, 127)
    bias_diff_on: int | None = setting(None, "contrast threshold ON; recommended 24 to 60", "code", 0, 127)
    bias_diff: int | None = setting(None, "reference of the thresholds; recommended 41 to 51", "code", 0, 127)
    bias_diff_off: int | None = setting(None, "contrast threshold OFF; recommended 19 to 50", "code", 0, 127)


def apply(registers: Registers, settings: GenX320Settings, before: GenX320Settings | None) -> None:
    """Writes the biases that differ from `before`."""
    held = before or GenX320Settings()
    for name, address in BIAS.items():
        code = getattr(settings, f"bias_{name}")
        if code != getattr(held, f"bias_{name}"):
            original = registers.original(address)
            code = original & 0x7F if code is None else code
            registers.modify(address, 0x7F | _SINGLE, code | _SINGLE)
