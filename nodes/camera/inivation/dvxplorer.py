"""iniVation DVXplorer and DVXplorer Mini: 640x480 events; inertial samples and triggers of the former."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from nodes.camera.driver import Configuration, DeviceInfo, setting
from nodes.camera.inivation.fx3 import CHIP, IMU, INPUT, Fx3Camera, sequences
from nodes.camera.usb.access import label
from nodes.camera.usb.driver import UsbSettings
from nodes.camera.usb.models import MODELS

WIDTH, HEIGHT = 640, 480
OLDEST = 8
MINI = 4
"""High byte of bcdDevice of a Mini (MIPI behind a CX3): its firmware starts the chip, it has no multiplexer."""
SENSITIVITY = {
    "very_low": (6, 125, 6, 2),
    "low": (6, 125, 3, 5),
    "default": (6, 125, 0, 8),
    "high": (4, 127, 5, 3),
    "very_high": (4, 127, 2, 6),
}
"""Values of the chip registers 0x0B, 0x12, 0x1C (ON) and 0x1E (OFF)."""
CROP = 0x3300


@dataclass
class DvxplorerSettings(UsbSettings):
    """The chip's own presets for the contrast thresholds."""

    sensitivity: str = setting("default", f"contrast sensitivity: {', '.join(SENSITIVITY)}")
    roi_x: int = setting(0, "left column of the region of interest", "px", 0, WIDTH - 1)
    roi_y: int = setting(0, "top row of the region of interest", "px", 0, HEIGHT - 1)
    roi_width: int = setting(0, "its width; 0 = to the right edge", "px", 0, WIDTH)
    roi_height: int = setting(0, "its height; 0 = to the bottom edge", "px", 0, HEIGHT)
    imu: bool = setting(True, "send inertial samples")
    trigger_in: bool = setting(False, "report edges of the trigger input")

    def check(self) -> None:
        super().check()
        if self.sensitivity not in SENSITIVITY:
            raise ValueError(f"sensitivity is '{self.sensitivity}', must be one of {', '.join(SENSITIVITY)}")
        if self.roi_x + (self.roi_width or 1) > WIDTH or self.roi_y + (self.roi_height or 1) > HEIGHT:
            raise ValueError(
                f"roi {self.roi_x},{self.roi_y} {self.roi_width}x{self.roi_height} px does not lie inside "
                f"{WIDTH}x{HEIGHT}"
            )


class Camera(Fx3Camera):
    """A DVXplorer or a Mini, told apart by bcdDevice."""

    SETTINGS: ClassVar[type[Configuration]] = DvxplorerSettings

    def _connect(self) -> DeviceInfo:
        self.mini = self.device.bcdDevice >> 8 == MINI
        m = self.model = MODELS["dvxplorer_mini" if self.mini else "dvxplorer"]
        details = self._take(0 if self.mini else OLDEST)
        self._clocks = {"LC": 0.0, "UC": 0.0}
        self._lists = sequences("dvxplorer")
        if not self.mini:
            details["logic"] = self._check_logic(2)
            self._clocks = self.registers.clocks()
        size = self.registers.read(1, 0), self.registers.read(1, 1)
        if sorted(size) != [HEIGHT, WIDTH]:
            raise OSError(f"{self.name}: unknown sensor of {size[0]}x{size[1]} px, not {WIDTH}x{HEIGHT}")
        details["usb"] = label(self.device)
        details |= {"dvs_orientation": self.registers.read(1, 2), "imu_orientation": self.registers.read(IMU, 1)}
        return DeviceInfo(
            m.name, self.serial, m.sensor, m.width, m.height, m.encoding, f"device:{self.serial}", details
        )

    def _initialise(self) -> None:
        if not self.mini:
            self._run("init")

    def _run(self, phase: str) -> None:
        """A phase; for the Mini only what concerns the chip and the inertial sensor."""
        words = self._lists[phase]
        if self.mini:
            words = tuple(w for w in words if w[0] == "d" or w.startswith((f"{CHIP},", f"{IMU},")) or w == "halt")
        self.registers.run(words, self._clocks, {"halt": self._halt})

    def _apply(self, settings: Any) -> None:
        s, r = settings, self.registers
        self._run("default_configuration")
        current = r.read(CHIP, 0x3200)
        r.write(CHIP, 0x3200, current | 6)
        for address, value in zip((0x0B, 0x12, 0x1C, 0x1E), SENSITIVITY[s.sensitivity]):
            r.write(CHIP, address, value)
        if s.roi_x or s.roi_y or s.roi_width or s.roi_height:
            self._crop()

    def _crop(self) -> None:
        """The chip's cropper: columns as numbers, rows as groups of eight with a mask in the first and last."""
        s, r = self._settings, self.registers
        left, top = s.roi_x, s.roi_y
        right = left + s.roi_width - 1 if s.roi_width else WIDTH - 1
        bottom = top + s.roi_height - 1 if s.roi_height else HEIGHT - 1
        first, last = 0xFF << top % 8 & 0xFF, 0xFF >> 7 - bottom % 8
        values = (0, top // 8, first, bottom // 8, last, left >> 8, left & 0xFF, right >> 8, right & 0xFF)
        for i, value in enumerate(values):
            r.write(CHIP, CROP + i, value)

    def _prepare(self, decoder: Any) -> None:
        assert self._info is not None
        if not self.mini:
            decoder.imu_orientation = self._info.details["imu_orientation"]
            decoder.reset()

    def _begin(self) -> None:
        self._run("start")
        s, r = self._settings, self.registers
        if not s.imu:
            for parameter in (2, 3, 4):
                r.write(IMU, parameter, 0)
        if s.trigger_in and not self.mini:
            for parameter in (1, 2):
                r.write(INPUT, parameter, 1)

    def _end(self) -> None:
        self._run("stop")

    def _disconnect(self) -> None:
        self._run("close")
