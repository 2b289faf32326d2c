"""Makes CUDA contexts in the background, while Python still imports and reads. A context takes the driver tenths of a
second, in which it does not need the interpreter. Warp then finds them there.
"""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Iterable


def begin_contexts(devices: Iterable[str]) -> threading.Thread | None:
    """Begins to make the primary contexts of devices, named as Warp names them; None where none of them is a GPU.

    Without a driver, or for a device that is not there or no device's name, nothing is made: who asks for the device
    is told so.
    """
    named = (re.fullmatch(r"cuda(?::(\d{1,3}))?", name) for name in devices)
    numbers = sorted({int(match[1] or 0) for match in named if match})
    if not numbers:
        return None
    thread = threading.Thread(target=_make, args=(numbers,), name="contexts", daemon=True)
    thread.start()
    return thread


def _make(numbers: list[int]) -> None:
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return
    if driver.cuInit(0):
        return
    for number in numbers:
        device, context = ctypes.c_int(), ctypes.c_void_p()
        if not driver.cuDeviceGet(ctypes.byref(device), number):
            # Kept to the end of the process, as Warp keeps it.
            driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)
