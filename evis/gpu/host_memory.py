"""Host memory that others have made, prepared for copies from a GPU: the driver copies to it at the bus's rate and in the
background, and to other memory by way of a buffer of its own, with a processor's help.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

PORTABLE = 1
"""CU_MEMHOSTREGISTER_PORTABLE: in all contexts."""


def page_lock(device: Any, address: int, size: int) -> bool:
    """Keeps pages in memory where a CUDA device can reach them. False where that cannot be had: copies are slower then.

    Args:
        device: a Warp device.
        address: of the first byte, at the start of a page.
        size: in bytes.
    """
    return _in_context(device, "cuMemHostRegister_v2", ctypes.c_void_p(address), ctypes.c_size_t(size), PORTABLE)


def page_unlock(device: Any, address: int) -> None:
    """Undoes `page_lock`, before the memory is given back."""
    _in_context(device, "cuMemHostUnregister", ctypes.c_void_p(address))


def _in_context(device: Any, name: str, *arguments: Any) -> bool:
    driver = _driver()
    if driver is None or driver.cuCtxPushCurrent_v2(ctypes.c_void_p(device.context)):
        return False
    try:
        return not getattr(driver, name)(*arguments)
    finally:
        driver.cuCtxPopCurrent_v2(ctypes.byref(ctypes.c_void_p()))


@cache
def _driver() -> Any:
    try:
        return ctypes.CDLL("libcuda.so.1")
    except OSError:
        return None
