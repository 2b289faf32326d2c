"""Drives the iniVation DVS128: 128x128 events over a few vendor requests. Facts from libcaer (BSD-2-Clause)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from nodes.camera.interface.driver import DeviceInfo
from nodes.camera.interface.settings import Configuration, setting
from nodes.camera.usb.access import CONTROL_MS, claim, label, string_descriptor
from nodes.camera.usb.driver import UsbDriver
from nodes.camera.usb.settings import UsbSettings

DATA_IN = 0x86
OLDEST = 14
OUT = 0x40
START, STOP, BIASES, RESET_TIME = 0xB3, 0xB4, 0xB8, 0xBB
ORDER = ("cas", "injgnd", "reqpd", "pux", "diffoff", "req", "refr", "puy", "diffon", "diff", "foll", "pr")
MOST = (1 << 24) - 1


@dataclass
class Dvs128Settings(UsbSettings):
    """Holds a DVS128's biases as codes of 24 bits, a current each, in the order in which the camera wants them."""

    bias_cas: int = setting(1992, "cascode of the photoreceptor", "code", 0, MOST)
    bias_injgnd: int = setting(1108364, "injected ground", "code", 0, MOST)
    bias_reqpd: int = setting(16777215, "request pull-down", "code", 0, MOST)
    bias_pux: int = setting(8159221, "x pull-up", "code", 0, MOST)
    bias_diffoff: int = setting(132, "contrast threshold OFF: lower is less sensitive", "code", 0, MOST)
    bias_req: int = setting(309590, "request", "code", 0, MOST)
    bias_refr: int = setting(969, "refractory period: higher is shorter", "code", 0, MOST)
    bias_puy: int = setting(16777215, "y pull-up", "code", 0, MOST)
    bias_diffon: int = setting(209996, "contrast threshold ON: higher is less sensitive", "code", 0, MOST)
    bias_diff: int = setting(13125, "reference of the thresholds", "code", 0, MOST)
    bias_foll: int = setting(271, "source follower", "code", 0, MOST)
    bias_pr: int = setting(217, "photoreceptor bandwidth", "code", 0, MOST)


class Camera(UsbDriver):
    """Drives a DVS128."""

    SETTINGS: ClassVar[type[Configuration]] = Dvs128Settings
    ENDPOINT = DATA_IN

    def _connect(self) -> DeviceInfo:
        claim(self.device, 0)
        firmware = self.device.bcdDevice & 0xFF
        if firmware < OLDEST:
            raise OSError(f"{self.name}: unknown firmware {firmware}; {OLDEST} or later is needed: update it with jAER")
        serial = string_descriptor(self.device, self.device.iSerialNumber)
        product = string_descriptor(self.device, self.device.iProduct)
        details = {"firmware": str(firmware), "product": product, "usb": label(self.device)}
        return self.model.device_info(serial, details)

    def _request(self, request: int, data: bytes | None = None) -> None:
        self.device.ctrl_transfer(OUT, request, 0, 0, data, CONTROL_MS)

    def _apply(self, settings: Any) -> None:
        values = [getattr(settings, f"bias_{name}") for name in ORDER]
        self._request(BIASES, b"".join(v.to_bytes(3, "big") for v in values))

    def _change(self, settings: Any, before: Any) -> None:
        self._apply(settings)  # the camera takes all biases or none

    def _begin(self) -> None:
        self.device.clear_halt(DATA_IN)
        self._request(RESET_TIME)
        self._request(START)

    def _end(self) -> None:
        self._request(STOP)
