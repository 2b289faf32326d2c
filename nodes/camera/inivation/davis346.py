"""Drives the iniVation DAVIS346: 346x260 events, frames, inertial samples and triggers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from nodes.camera.inivation.fx3 import APS, CHIP, DVS, IMU, INPUT, TRANSPOSED, Fx3Camera, sequences
from nodes.camera.interface.driver import DeviceInfo
from nodes.camera.interface.settings import Configuration, setting
from nodes.camera.usb.access import UNSUPPORTED, label
from nodes.camera.usb.region import region_of, roi_columns, roi_differs, roi_left, roi_rows, roi_top
from nodes.camera.usb.settings import UsbSettings

WIDTH, HEIGHT = 346, 260
FX3, OLDEST_FX3, OLDEST_FX2 = 0x841A, 6, 4
COARSE_PA = np.array([11, 94, 756, 6054, 48437, 387500, 3.1e6, 24.8e6])
"""Current of each coarse step [pA]; a bias is COARSE_PA[coarse] * fine / 255."""
N_TYPE, P_TYPE, CASCODE_N = 0xF, 0xD, 0xE
"""Low bits of a bias word: enable, transistor type, normal, normal level."""
FILTER_TICK_US = 250

BIASES = {
    "localbufbn": (8, 5, 164, N_TYPE),
    "padfollbn": (9, 7, 215, CASCODE_N),
    "diffbn": (10, 4, 39, N_TYPE),
    "onbn": (11, 5, 255, N_TYPE),
    "offbn": (12, 4, 1, N_TYPE),
    "pixinvbn": (13, 6, 144, N_TYPE),
    "prbp": (14, 2, 58, P_TYPE),
    "prsfbp": (15, 1, 16, P_TYPE),
    "refrbp": (16, 4, 25, P_TYPE),
    "readoutbufbp": (17, 6, 20, P_TYPE),
    "apsrosfbn": (18, 6, 219, N_TYPE),
    "adccompbp": (19, 5, 20, P_TYPE),
    "colsellowbn": (20, 0, 1, N_TYPE),
    "dacbufbp": (21, 6, 60, P_TYPE),
    "lcoltimeoutbn": (22, 5, 49, N_TYPE),
    "aepdbn": (23, 6, 91, N_TYPE),
    "aepuxbp": (24, 4, 80, P_TYPE),
    "aepuybp": (25, 7, 152, P_TYPE),
    "ifrefrbn": (26, 5, 255, N_TYPE),
    "ifthrbn": (27, 5, 255, N_TYPE),
    "biasbuffer": (34, 5, 254, N_TYPE),
}
"""Parameter in the chip's module, coarse and fine of the default, type bits."""

CHOSEN = {
    "diffbn": "bias_diff", "onbn": "bias_on", "offbn": "bias_off",
    "prbp": "bias_pr", "prsfbp": "bias_sf", "refrbp": "bias_refr",
}  # fmt: skip
"""Biases that have a setting."""


def bias_word(coarse: int, fine: int, kind: int) -> int:
    """Returns the register value of a coarse-fine bias."""
    return kind | fine << 4 | coarse << 12


def current_pa(coarse: int, fine: int) -> float:
    """Returns the current of a bias [pA]."""
    return float(COARSE_PA[coarse] * fine / 255)


@cache
def _table() -> np.ndarray:
    return COARSE_PA[:, None] * np.arange(256) / 255


def nearest_bias(picoampere: float) -> tuple[int, int]:
    """Returns (coarse, fine) of the current nearest to the given one [pA] in ratio."""
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(_table()) - np.log(picoampere))
    coarse, fine = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return int(coarse), int(fine)


def bias_setting(name: str, help: str) -> Any:
    """Makes the setting of a bias current, with the camera's default."""
    _, coarse, fine, _ = BIASES[name]
    return setting(round(current_pa(coarse, fine), 6), help, "pA", 0.05, 24.8e6)


@dataclass
class Davis346Settings(UsbSettings):
    """Holds a DAVIS346's settings; biases are currents, of which the nearest of the 2041 that the chip can make is
    set."""

    bias_diff: float = bias_setting("diffbn", "reference of the thresholds")
    bias_on: float = bias_setting("onbn", "contrast threshold ON: higher above diff is less sensitive")
    bias_off: float = bias_setting("offbn", "contrast threshold OFF: lower below diff is less sensitive")
    bias_pr: float = bias_setting("prbp", "photoreceptor bandwidth")
    bias_sf: float = bias_setting("prsfbp", "source follower bandwidth")
    bias_refr: float = bias_setting("refrbp", "refractory period: higher is shorter")
    roi_x: int = roi_left(WIDTH)
    roi_y: int = roi_top(HEIGHT)
    roi_width: int = roi_columns(WIDTH)
    roi_height: int = roi_rows(HEIGHT)
    background_filter_us: float = setting(
        0.0, "drop events without a neighbour in this time, in the camera; 0 = off", "us", 0, 1e6
    )
    refractory_filter_us: float = setting(0.0, "drop a pixel's events within this time; 0 = off", "us", 0, 1e6)
    frames: bool = setting(True, "send frames")
    exposure_us: float = setting(4000.0, "exposure of a frame", "us", 1, 1e6)
    frame_interval_us: float = setting(40_000.0, "time between frames", "us", 1000, 8e6)
    imu: bool = setting(True, "send inertial samples")
    trigger_in: bool = setting(False, "report edges of the trigger input")

    def check(self) -> None:
        super().check()
        region_of(self, WIDTH, HEIGHT)


class Camera(Fx3Camera):
    """Drives a DAVIS346 with FX3 or FX2."""

    SETTINGS: ClassVar[type[Configuration]] = Davis346Settings

    def _connect(self) -> DeviceInfo:
        details = self._claim(OLDEST_FX3 if self.device.idProduct == FX3 else OLDEST_FX2)
        details["logic"] = self._check_logic(1)
        r = self.registers
        size = r.read(DVS, 0), r.read(DVS, 1)
        if sorted(size) != [HEIGHT, WIDTH]:
            raise OSError(f"{self.name}: unknown sensor of {size[0]}x{size[1]} px, not {WIDTH}x{HEIGHT}; {UNSUPPORTED}")
        self._clocks = r.clocks()
        self._lists = sequences("davis346")
        self._global_shutter = r.read(APS, 6)
        details |= {"usb": label(self.device), "chip": r.read(6, 1), "aps_orientation": r.read(APS, 2)}
        details |= {"dvs_orientation": r.read(DVS, 2), "imu_orientation": r.read(IMU, 1)}
        self._transposed = bool(details["dvs_orientation"] & TRANSPOSED)
        return self.model.device_info(self.serial, details)

    def _apply(self, settings: Davis346Settings) -> None:
        """Leaves all to the start sequence, which writes the settings at its place."""

    def _change(self, settings: Davis346Settings, before: Davis346Settings) -> None:
        self._write_registers(settings, before)
        self._write_switches(settings, before)

    def _write_registers(self, s: Davis346Settings, before: Davis346Settings | None) -> None:
        """Writes biases, filters, region and exposure, as far as they differ from `before`; None: all of them."""

        def differs(name: str) -> bool:
            return before is None or getattr(s, name) != getattr(before, name)

        r = self.registers
        for name, (parameter, coarse, fine, kind) in BIASES.items():
            if (chosen := CHOSEN.get(name)) is not None:
                coarse, fine = nearest_bias(getattr(s, chosen))
            if before is None or (chosen is not None and differs(chosen)):
                r.write(CHIP, parameter, bias_word(coarse, fine, kind))
        for enable, name in ((31, "background_filter_us"), (33, "refractory_filter_us")):
            if differs(name):
                value = getattr(s, name)
                r.write(DVS, enable, int(value > 0))
                r.write(DVS, enable + 1, max(1, round(value / FILTER_TICK_US)))
        if before is None or roi_differs(s, before):
            region = region_of(s, WIDTH, HEIGHT)
            x_registers, y_registers = ((42, 44), (41, 43)) if self._transposed else ((41, 43), (42, 44))
            across, down = (region.left, region.right), (region.top, region.bottom)
            for parameter, value in (*zip(x_registers, across), *zip(y_registers, down)):
                r.write(DVS, parameter, value)
        for parameter, name in ((12, "exposure_us"), (13, "frame_interval_us")):
            if differs(name):
                r.write(APS, parameter, round(getattr(s, name) * self._clocks["AC"]))

    def _write_switches(self, s: Davis346Settings, before: Davis346Settings) -> None:
        """Switches frames, inertial samples and triggers on or off where that differs from `before`."""
        if s.frames != before.frames:
            self.registers.write(APS, 4, int(s.frames))
        if s.imu != before.imu:
            self._switch_samples(s.imu)
        if s.trigger_in != before.trigger_in:
            for parameter in (1, 2, 0):
                self.registers.write(INPUT, parameter, int(s.trigger_in))

    def _begin(self) -> None:
        s = self._settings
        hooks = {"halt": self._halt, "configuration": lambda: self._write_registers(s, None)}
        self.registers.run(self._lists["start"], {**self._clocks, "GS": self._global_shutter}, hooks)
        self._write_switches(s, Davis346Settings())  # the start sequence leaves them at their defaults

    def _prepare_decoder(self, decoder: Any) -> None:
        assert self._info is not None
        decoder.aps_orientation = self._info.details["aps_orientation"]
        decoder.imu_orientation = self._info.details["imu_orientation"]
        decoder.transposed = self._transposed
        decoder.reset()

    def _end(self) -> None:
        self.registers.run(self._lists["stop"], {}, {})
