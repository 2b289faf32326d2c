"""CUDA contexts that are made before Warp is there."""

from __future__ import annotations

import ctypes
import subprocess
import sys

import pytest

from evis.gpu import early_context
from evis.gpu.early_context import begin_contexts


class Driver:
    """A driver with two devices, which notes what it was asked for. broken: it does not start."""

    def __init__(self, broken: bool = False) -> None:
        self.broken = broken
        self.retained: list[int] = []

    def cuInit(self, flags: int) -> int:
        return 999 if self.broken else 0

    def cuDeviceGet(self, device: object, number: int) -> int:
        if number > 1:
            return 101
        device._obj.value = 70 + number  # type: ignore[attr-defined]
        return 0

    def cuDevicePrimaryCtxRetain(self, context: object, device: ctypes.c_int) -> int:
        self.retained.append(device.value)
        return 0


@pytest.mark.parametrize(
    ("devices", "retained"),
    [
        (["cuda", "", "cuda:0", "cpu"], [70]),
        (["cuda:1"], [71]),
        (["cuda:1", "cuda:0", "cuda:9"], [70, 71]),
        (["cuda:x", "cuda:-1", "cuda:1"], [71]),
    ],
)
def test_each_gpu_gets_one_context(devices: list[str], retained: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Driver()
    monkeypatch.setattr(early_context.ctypes, "CDLL", lambda name: driver)
    thread = begin_contexts(devices)
    assert thread is not None
    thread.join(60)
    assert driver.retained == retained


@pytest.mark.parametrize("devices", [["cpu", "", "cpu"], ["cuda:x"], ["cudax"], ["cuda:1:2"]])
def test_without_the_name_of_a_gpu_no_thread_is_started(devices: list[str]) -> None:
    assert begin_contexts(devices) is None


@pytest.mark.parametrize("broken", [True, False])
def test_a_driver_that_is_not_there_or_does_not_start_is_no_error(
    broken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = Driver(broken=True)

    def load(name: str) -> Driver:
        if not broken:
            raise OSError(f"{name}: cannot open shared object file")
        return driver

    failed = []
    monkeypatch.setattr("threading.excepthook", failed.append)
    monkeypatch.setattr(early_context.ctypes, "CDLL", load)
    thread = begin_contexts(["cuda"])
    assert thread is not None
    thread.join(60)
    assert not failed and not driver.retained


@pytest.mark.gpu
def test_warp_works_in_a_context_that_was_there() -> None:
    """Its state is the driver's to tell, in a process that has none yet."""
    code = """
import ctypes
from evis.gpu.early_context import begin_contexts
driver, device, flags, active = ctypes.CDLL("libcuda.so.1"), ctypes.c_int(), ctypes.c_uint(), ctypes.c_int()
begin_contexts(["cuda"]).join()
assert driver.cuDeviceGet(ctypes.byref(device), 0) == 0
assert driver.cuDevicePrimaryCtxGetState(device, ctypes.byref(flags), ctypes.byref(active)) == 0
assert active.value == 1
import numpy as np, warp as wp
assert (wp.full(9, 3.0, dtype=float, device="cuda").numpy() == 3).all()
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=300)
