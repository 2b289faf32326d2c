"""Drives the iniVation DVXplorer, Lite, Mini and Micro: events and inertial samples, and triggers of the first two."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar

from evis.events.codecs.inivation.dvxplorer_mini_imu import MiniImu
from nodes.camera.inivation import dvxplorer_micro
from nodes.camera.inivation.fx3 import CHIP, DEBUG_IN, DVS, IMU, INPUT, SYSTEM, TRANSPOSED, Fx3Camera, sequences
from nodes.camera.interface.driver import DeviceInfo
from nodes.camera.interface.settings import Configuration, setting
from nodes.camera.usb.access import UNSUPPORTED, label
from nodes.camera.usb.imu_endpoint import ImuEndpointReader
from nodes.camera.usb.models import MODELS
from nodes.camera.usb.region import region_of, roi_columns, roi_differs, roi_left, roi_rows, roi_top
from nodes.camera.usb.settings import UsbSettings

WIDTH, HEIGHT = 640, 480
LITE_WIDTH, LITE_HEIGHT = 320, 240
OLDEST = 8
MINI = 4
"""High byte of bcdDevice of a Mini (MIPI behind a CX3): its firmware starts the chip, it has no multiplexer."""
LITE = 19
"""Chip identifier of a Lite: a quarter of the pixels; its subsampling registers count from 1."""
SENSITIVITY = {
    "very_low": (6, 125, 6, 2),
    "low": (6, 125, 3, 5),
    "default": (6, 125, 0, 8),
    "high": (4, 127, 5, 3),
    "very_high": (4, 127, 2, 6),
}
"""Values of the chip registers 0x0B, 0x12, 0x1C (ON) and 0x1E (OFF)."""
CROP, BINNING, SUBSAMPLING = 0x3300, 0x3202, 0x3204
FLIP_X, FLIP_Y = 2, 1
"""Bits of the orientation register: the chip counts from the far edge."""
IMU_PAUSE_S = 0.0005


@dataclass
class MicroSettings(UsbSettings):
    """Holds a Micro's settings; contrast thresholds are presets of the chip."""

    sensitivity: str = setting("default", f"contrast sensitivity: {', '.join(SENSITIVITY)}")
    imu: bool = setting(True, "send inertial samples", live=False)

    def check(self) -> None:
        super().check()
        if self.sensitivity not in SENSITIVITY:
            raise ValueError(f"sensitivity is '{self.sensitivity}', must be one of {', '.join(SENSITIVITY)}")


@dataclass
class MiniSettings(MicroSettings):
    """Holds a Mini's settings, which has a region of interest or binning too."""

    roi_x: int = roi_left(WIDTH)
    roi_y: int = roi_top(HEIGHT)
    roi_width: int = roi_columns(WIDTH)
    roi_height: int = roi_rows(HEIGHT)
    binning: bool = setting(False, f"one pixel of two by two: {WIDTH // 2}x{HEIGHT // 2}", live=False)

    def check(self) -> None:
        super().check()
        region_of(self, WIDTH, HEIGHT)
        if self.binning and (self.roi_x or self.roi_y or self.roi_width or self.roi_height):
            raise ValueError("binning and a region of interest are given; the camera does one of them")


@dataclass
class DvxplorerSettings(MiniSettings):
    """Holds a DVXplorer's settings, which has a trigger input too and sends inertial samples beside the events."""

    imu: bool = setting(True, "send inertial samples")
    trigger_in: bool = setting(False, "report edges of the trigger input")


@dataclass
class LiteSettings(MicroSettings):
    """Holds a Lite's settings, with a region of interest within its smaller size and without binning."""

    imu: bool = setting(True, "send inertial samples")
    roi_x: int = roi_left(LITE_WIDTH)
    roi_y: int = roi_top(LITE_HEIGHT)
    roi_width: int = roi_columns(LITE_WIDTH)
    roi_height: int = roi_rows(LITE_HEIGHT)
    trigger_in: bool = setting(False, "report edges of the trigger input")

    def check(self) -> None:
        super().check()
        region_of(self, LITE_WIDTH, LITE_HEIGHT)


class Camera(Fx3Camera):
    """Drives a DVXplorer, a Mini or a Micro (a Mini with firmware from 10 on is the same), told apart by bcdDevice; or
    a Lite, told by its chip.
    """

    SETTINGS: ClassVar[type[Configuration]] = DvxplorerSettings

    def _connect(self) -> DeviceInfo:
        self.mini = self.device.bcdDevice >> 8 == MINI
        self.micro = self.mini and self.device.bcdDevice & 0xFF >= dvxplorer_micro.FIRMWARE
        self.model = MODELS["dvxplorer_micro" if self.micro else "dvxplorer_mini" if self.mini else "dvxplorer"]
        details = self._claim(0 if self.mini else OLDEST, 8 if self.micro else 4)
        self._clocks = {"LC": 0.0, "UC": 0.0}
        self._lists = sequences("dvxplorer")
        if not self.mini:
            details["logic"] = self._check_logic(2)
            self._clocks = self.registers.clocks()
        self.lite = not self.mini and self.registers.read(SYSTEM, 1) == LITE
        if self.lite:
            self.model = MODELS["dvxplorer_lite"]
        m = self.model
        size = self.registers.read(DVS, 0), self.registers.read(DVS, 1)
        if sorted(size) != [m.height, m.width]:
            raise OSError(
                f"{self.name}: unknown sensor of {size[0]}x{size[1]} px, not {m.width}x{m.height}; {UNSUPPORTED}"
            )
        details["usb"] = label(self.device)
        details["dvs_orientation"] = self.registers.read(DVS, 2)
        details["imu_orientation"] = 0 if self.micro else self.registers.read(IMU, 1)
        self._orientation = 0 if self.micro else details["dvs_orientation"]  # a Micro's firmware turns the image itself
        return self.model.device_info(self.serial, details)

    def _initialise(self) -> None:
        if not self.mini:
            self._run("init")

    def _run(self, phase: str) -> None:
        """Runs a phase of the register sequences; on a Mini only what concerns the chip and the inertial sensor."""
        words = self._lists[phase]
        if self.mini:
            words = tuple(w for w in words if w[0] == "d" or w.startswith((f"{CHIP},", f"{IMU},")) or w == "halt")
        self.registers.run(words, self._clocks, {"halt": self._halt})

    def _write(self, writes: dvxplorer_micro.Writes) -> None:
        for module, parameter, value in writes:
            self.registers.write(module, parameter, value)

    def settings_type(self) -> type[Configuration]:
        if self._info is None:
            return self.SETTINGS
        return (
            MicroSettings if self.micro else MiniSettings if self.mini else LiteSettings if self.lite else self.SETTINGS
        )

    def _apply_micro(self, s: MicroSettings) -> None:
        """Writes the settings of a Micro."""
        assert self._info is not None
        orientation = self._info.details["dvs_orientation"]
        self._write(dvxplorer_micro.configuration(s.sensitivity, WIDTH, HEIGHT, orientation))

    def _apply(self, settings: Any) -> None:
        s, r = settings, self.registers
        if self.micro:
            self._apply_micro(s)
            return
        width, height, binning = self.model.width, self.model.height, getattr(s, "binning", False)
        self._run("default_configuration")
        current = r.read(CHIP, 0x3200)
        r.write(CHIP, 0x3200, current | 6)
        self._write_sensitivity(s)
        r.write(CHIP, BINNING, int(binning))
        if self.lite:
            r.write(CHIP, SUBSAMPLING, 0b001_001)  # none, in both directions
        factor = 2 if binning else 1
        self._info = dataclasses.replace(self.info(), width=width // factor, height=height // factor)
        if s.roi_x or s.roi_y or s.roi_width or s.roi_height:
            self._crop(s)

    def _change(self, settings: Any, before: Any) -> None:
        s = settings
        if s.sensitivity != before.sensitivity:
            self._write_sensitivity(s)
        if self.micro:
            return
        if roi_differs(s, before):
            if s.roi_x or s.roi_y or s.roi_width or s.roi_height:
                self._crop(s)
            else:
                self.registers.write(CHIP, CROP, 1)  # the cropper lets all through
        if not self.mini:
            self._write_switches(s, before)

    def _write_sensitivity(self, s: MicroSettings) -> None:
        """Writes the preset of the contrast thresholds."""
        if self.micro:
            self._write(dvxplorer_micro.thresholds(s.sensitivity))
            return
        for address, value in zip((0x0B, 0x12, 0x1C, 0x1E), SENSITIVITY[s.sensitivity]):
            self.registers.write(CHIP, address, value)

    def _write_switches(self, s: Any, before: Any) -> None:
        """Switches inertial samples and triggers on or off where that differs from `before`."""
        if s.imu != before.imu:
            self._switch_samples(s.imu)
        if getattr(s, "trigger_in", False) != getattr(before, "trigger_in", False):
            for parameter in (1, 2):
                self.registers.write(INPUT, parameter, int(s.trigger_in))

    def _crop(self, s: Any) -> None:
        """Writes the region of interest: the first and last column, and groups of eight rows with a mask in the first
        and last.

        It counts as the chip does, before the image is flipped. Where first and last group are the same, the chip looks
        at the mask of the last alone.
        """
        columns, rows = self.model.width, self.model.height
        region = region_of(s, columns, rows)
        across, down = (region.left, region.right), (region.top, region.bottom)
        if self._orientation & TRANSPOSED:
            across, down, columns, rows = down, across, rows, columns
        left, right = (columns - 1 - across[1], columns - 1 - across[0]) if self._orientation & FLIP_X else across
        top, bottom = (rows - 1 - down[1], rows - 1 - down[0]) if self._orientation & FLIP_Y else down
        first, last = 0xFF << top % 8 & 0xFF, 0xFF >> 7 - bottom % 8
        if top // 8 == bottom // 8:
            first, last = 0xFF, first & last
        values = (0, top // 8, first, bottom // 8, last, left >> 8, left & 0xFF, right >> 8, right & 0xFF)
        for i, value in enumerate(values):
            self.registers.write(CHIP, CROP + i, value)

    def _prepare_decoder(self, decoder: Any) -> None:
        assert self._info is not None
        decoder.transposed = bool(self._orientation & TRANSPOSED)
        decoder.binned = getattr(self._settings, "binning", False)
        if not self.mini:
            decoder.imu_orientation = self._info.details["imu_orientation"]
        decoder.reset()

    def _make_imu_reader(self) -> ImuEndpointReader | None:
        """Makes the reader of a Mini's inertial samples, which come on the debug endpoint."""
        if not self.mini or not self._settings.imu:
            return None
        assert self._info is not None
        imu = MiniImu(self.micro, self._info.details["imu_orientation"])

        def read(buffer: Any, timeout_ms: int) -> int:
            size: int = self.device.read(DEBUG_IN, buffer, timeout_ms)
            return size

        pause_s = 0.0 if self.bus.emulated else IMU_PAUSE_S
        return ImuEndpointReader(read, lambda: self.device.clear_halt(DEBUG_IN), imu, pause_s)

    def _begin(self) -> None:
        if self.micro:
            self._halt()
            self._write(dvxplorer_micro.running(True, self._settings.imu))
            return
        self._run("start")
        self._write_switches(self._settings, self.settings_type()())  # the start sequence leaves them at their defaults

    def _end(self) -> None:
        if self.micro:
            self._write(dvxplorer_micro.running(False, False))
        else:
            self._run("stop")

    def _disconnect(self) -> None:
        if not self.mini:
            self._run("close")
