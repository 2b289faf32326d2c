"""Describes the Sony/Prophesee IMX636 (EVK4, EVK3 HD, SilkyEvCam HD) and, with the same register map, Gen4.1: 1280x720,
EVT3."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nodes.camera.interface.settings import setting
from nodes.camera.treuzell.sensor import Registers, expect, span_words
from nodes.camera.usb.region import region_of, roi_columns, roi_differs, roi_left, roi_rows, roi_top
from nodes.camera.usb.settings import UsbSettings

WIDTH, HEIGHT = 1280, 720
BIAS = {
    "pr": 0x1000,
    "fo": 0x1004,
    "hpf": 0x100C,
    "diff_on": 0x1010,
    "diff": 0x1014,
    "diff_off": 0x1018,
    "refr": 0x1020,
}
CODES = "codes from the factory's"
BIAS_MODE = 0x11A1_0000
"""Enable, buffer and multiplexer bits that go with every bias code."""
ERC_PERIOD_US = 200
RATE_CONTROLLER = (0x6008, 0x600C, 0x6004, 0x6028, 0x6000)
"""Period, events in each, drop enable, enable, and the switch of all of it."""
TRIGGER_ENABLE = 1 << 10
OFFSETS = ("fo", "hpf", "diff_on", "diff_off", "refr")
"""Biases of the IMX636 that have a setting."""


@dataclass
class Imx636Settings(UsbSettings):
    """Holds an IMX636's settings; biases are offsets to the code that the factory set, as Prophesee's tools give
    them."""

    bias_fo: int = setting(0, "low-pass corner of the photoreceptor", CODES, -35, 55)
    bias_hpf: int = setting(0, "high-pass corner", CODES, 0, 120)
    bias_diff_on: int = setting(0, "contrast threshold ON: higher is less sensitive", CODES, -85, 140)
    bias_diff_off: int = setting(0, "contrast threshold OFF: higher is less sensitive", CODES, -35, 190)
    bias_refr: int = setting(0, "refractory period: higher is shorter", CODES, -20, 235)
    roi_x: int = roi_left(WIDTH)
    roi_y: int = roi_top(HEIGHT)
    roi_width: int = roi_columns(WIDTH)
    roi_height: int = roi_rows(HEIGHT)
    event_rate_limit: float = setting(0.0, "most events per second that the sensor sends; 0 = all", "1/s", 0, 1e9)
    trigger_in: bool = setting(False, "report edges of the trigger input")

    def check(self) -> None:
        super().check()
        check_common(self)


def check_common(settings: Imx636Settings | Gen41Settings) -> None:
    """Raises ValueError for a region outside of the sensor and for a rate limit below an event in each period."""
    region_of(settings, WIDTH, HEIGHT)
    limit = settings.event_rate_limit
    if limit and events_per_period(limit) < 1:
        raise ValueError(
            f"event_rate_limit is {limit:g} 1/s; the sensor counts events in each {ERC_PERIOD_US} us, so give "
            f"{1_000_000 // ERC_PERIOD_US} or more, or 0 for all"
        )


def check_chip(registers: Registers) -> None:
    """Raises TreuzellError unless this is an IMX636."""
    expect(registers, "IMX636", 0x14, 0xFFFF_FFFF, 0xA040_1806)
    expect(registers, "IMX636", 0xF128, 3, 0)


def check_gen41(registers: Registers) -> None:
    """Raises TreuzellError unless this is a Gen4.1."""
    expect(registers, "Gen4.1", 0x14, 0xFFFF_FFFF, 0xA030_1002, 0xA030_1003)


def check_codes(registers: Registers, settings: Imx636Settings) -> None:
    """Raises ValueError for an offset that leads out of the codes that there are, from this camera's factory codes."""
    for name in OFFSETS:
        offset = getattr(settings, f"bias_{name}")
        if offset and not 0 <= (code := _code(registers, name, offset)) <= 255:
            raise ValueError(
                f"bias_{name} is {offset}; with this camera's factory code it would be {code}, not 0 to 255"
            )


def _code(registers: Registers, name: str, offset: int) -> int:
    """Returns the code of a bias that lies `offset` above the factory's."""
    return (registers.original(BIAS[name]) & 0xFF) + offset


def apply(registers: Registers, settings: Imx636Settings, before: Imx636Settings | None) -> None:
    """Writes biases, region of interest, event rate limit and trigger, as far as they differ from `before`."""
    held = before or Imx636Settings()
    for name in OFFSETS:
        offset = getattr(settings, f"bias_{name}")
        if offset != getattr(held, f"bias_{name}"):
            registers.write(BIAS[name], BIAS_MODE | _code(registers, name, offset))
    apply_common(registers, settings, before)


def apply_common(
    registers: Registers, settings: Imx636Settings | Gen41Settings, before: Imx636Settings | Gen41Settings | None
) -> None:
    """Writes the settings that IMX636 and Gen4.1 share: region of interest, event rate limit and trigger."""
    held = before or type(settings)()
    if roi_differs(settings, held):
        region = region_of(settings, WIDTH, HEIGHT)
        whole = (region.width, region.height) == (WIDTH, HEIGHT)
        if not whole:
            # rows count from the bottom; a set bit lets a line through
            registers.write(0x2000, *span_words(region.left, region.width, 40))
            registers.write(0x4000, *span_words(HEIGHT - 1 - region.bottom, region.height, 23))
        registers.modify(0x4, 1 << 5, 0 if whole else 1 << 5)
    if settings.event_rate_limit != held.event_rate_limit:
        _write_rate_limit(registers, settings.event_rate_limit, held.event_rate_limit)
    if before is None or settings.trigger_in != before.trigger_in:
        registers.modify(0x7004, TRIGGER_ENABLE, TRIGGER_ENABLE if settings.trigger_in else 0)


def events_per_period(events_per_s: float) -> int:
    """Returns how many events a rate limit lets through in each period of the controller, which counts in 22 bits."""
    return min(math.floor(events_per_s * ERC_PERIOD_US / 1e6), (1 << 22) - 1)


def _write_rate_limit(registers: Registers, events_per_s: float, before: float | None) -> None:
    """Writes another limit where there was one before (None: that is not known); sets the controller up where it was
    off; without a limit, leaves it as the sensor's start list does."""
    originals = {address: registers.original(address) for address in RATE_CONTROLLER}
    if not events_per_s:
        registers.write(0x6000, 0x155400)  # off, while the others are written
        for address, value in originals.items():
            registers.write(address, value)
    elif before:
        registers.write(0x600C, events_per_period(events_per_s))
    else:
        set_rate_limit(registers, events_per_s)


def set_rate_limit(registers: Registers, events_per_s: float) -> None:
    """Sets the event rate controller to a largest number of events in each 200 us; the sensor drops the others."""
    registers.write(0x6000, 0x155400)
    registers.write(0x6008, ERC_PERIOD_US)
    registers.write(0x600C, events_per_period(events_per_s))
    registers.write(0x602C, 1)
    for i in range(230):
        registers.write(0x6800 + 4 * i, 0x0808_0808)
    registers.write(0x602C, 2)
    for i in range(256):
        registers.write(0x6400 + 4 * i, (2 * i + 1) << 16 | 2 * i)
    registers.write(0x6050, 0)
    registers.write(0x6060, 0)
    registers.write(0x6070, 0)
    registers.write(0x6004, 1)
    registers.write(0x6028, 3)
    registers.write(0x6000, 0x155401)


def temperature_c(registers: Registers) -> float | None:
    """Reads the die temperature [deg C]; None when the converter does not answer."""
    registers.modify(0x4C, 1 << 2, 1 << 2)
    for _ in range(5):
        value = registers.read(0x50)
        if value & 1 << 11:
            return 0.19 * (value & 0x3FF) - 56
        registers.wait(0.001)
    return None


@dataclass
class Gen41Settings(UsbSettings):
    """Holds a Gen4.1's settings; biases are the codes themselves."""

    bias_pr: int = setting(0x69, "photoreceptor", "code", 0, 255)
    bias_fo: int = setting(0x4A, "low-pass corner of the photoreceptor", "code", 0x2D, 0x6E)
    bias_hpf: int = setting(0, "high-pass corner", "code", 0, 0x78)
    bias_diff_on: int = setting(0x73, "contrast threshold ON, at least 15 above diff", "code", 0x5F, 255)
    bias_diff: int = setting(0x50, "reference of the thresholds", "code", 0x34, 0x64)
    bias_diff_off: int = setting(0x34, "contrast threshold OFF, at least 15 below diff", "code", 0x19, 0x55)
    bias_refr: int = setting(0x44, "refractory period", "code", 0x14, 0x64)
    roi_x: int = roi_left(WIDTH)
    roi_y: int = roi_top(HEIGHT)
    roi_width: int = roi_columns(WIDTH)
    roi_height: int = roi_rows(HEIGHT)
    event_rate_limit: float = setting(0.0, "most events per second that the sensor sends; 0 = all", "1/s", 0, 1e9)
    trigger_in: bool = setting(False, "report edges of the trigger input")

    def check(self) -> None:
        super().check()
        check_common(self)
        if self.bias_diff_on < self.bias_diff + 15 or self.bias_diff_off > self.bias_diff - 15:
            raise ValueError(
                f"bias_diff_on {self.bias_diff_on} and bias_diff_off {self.bias_diff_off} must lie at least 15 codes "
                f"above and below bias_diff {self.bias_diff}"
            )


def apply_gen41(registers: Registers, settings: Gen41Settings, before: Gen41Settings | None) -> None:
    """Writes biases, region of interest, event rate limit and trigger, as far as they differ from `before`."""
    for name, address in BIAS.items():
        code = getattr(settings, f"bias_{name}")
        if before is None or code != getattr(before, f"bias_{name}"):
            registers.write(address, BIAS_MODE | code)
    apply_common(registers, settings, before)
