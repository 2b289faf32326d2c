"""Calls functions of CUDA's driver that Warp has not, or whose failure it does not tell."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

PORTABLE = 1
"""CU_MEMHOSTREGISTER_PORTABLE: in all contexts."""
PEER_ACCESS = 1
"""CU_IPC_MEM_LAZY_ENABLE_PEER_ACCESS, without which no handle is opened."""
HANDLE_BYTES = 64
RESERVED, USED = 5, 7
"""CU_MEMPOOL_ATTR_RESERVED_MEM_CURRENT and CU_MEMPOOL_ATTR_USED_MEM_CURRENT."""


class _Handle(ctypes.Structure):
    """Holds a CUipcMemHandle, which is passed by value."""

    _fields_ = (("reserved", ctypes.c_ubyte * HANDLE_BYTES),)


def page_lock(device: Any, address: int, size: int) -> bool:
    """Keeps pages of the host in memory where a CUDA device can reach them. False where that cannot be had.

    It copies there at the bus's rate and in the background, and elsewhere by way of a buffer, with a processor's help.

    Args:
        device: a Warp device.
        address: of the first byte, at the start of a page.
        size: in bytes.
    """
    return _done(device, "cuMemHostRegister_v2", ctypes.c_void_p(address), ctypes.c_size_t(size), PORTABLE)


def page_unlock(device: Any, address: int) -> None:
    """Undoes `page_lock`, before the memory is given back."""
    _done(device, "cuMemHostUnregister", ctypes.c_void_p(address))


def handle_of(device: Any, address: int) -> bytes:
    """Gives the handle by which other processes open memory of a Warp device, of an allocation of its own.

    Raises RuntimeError where the driver gives none.
    """
    handle = _Handle()
    if not _done(device, "cuIpcGetMemHandle", ctypes.byref(handle), ctypes.c_uint64(address)):
        raise RuntimeError(f"{device}: the driver gives no handle for memory at {address:#x}")
    return bytes(handle.reserved)


def open_memory(device: Any, handle: bytes) -> int:
    """Gives the address of another process's memory on a Warp device by its handle of HANDLE_BYTES bytes.

    0 where it cannot be opened: the process is gone, it is this one, or the handle is none.
    """
    found = ctypes.c_uint64()
    passed = _Handle.from_buffer_copy(handle)
    opened = _done(device, "cuIpcOpenMemHandle_v2", ctypes.byref(found), passed, ctypes.c_uint(PEER_ACCESS))
    return found.value if opened else 0


def close_memory(device: Any, address: int) -> None:
    """Undoes `open_memory`."""
    _done(device, "cuIpcCloseMemHandle", ctypes.c_uint64(address))


def kept_memory(device: Any) -> int:
    """Gives the bytes that the memory pool of a Warp device holds for no array; 0 where the driver does not tell."""
    pool, reserved, used = ctypes.c_void_p(), ctypes.c_uint64(), ctypes.c_uint64()
    told = _done(device, "cuDeviceGetDefaultMemPool", ctypes.byref(pool), ctypes.c_int(device.ordinal))
    for attribute, value in ((RESERVED, reserved), (USED, used)):
        told = told and _done(device, "cuMemPoolGetAttribute", pool, ctypes.c_int(attribute), ctypes.byref(value))
    return max(reserved.value - used.value, 0) if told else 0


def _done(device: Any, name: str, *arguments: Any) -> bool:
    """Calls the driver in a device's context; False where it fails, or there is none."""
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
