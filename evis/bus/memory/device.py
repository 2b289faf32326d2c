"""Keeps arrays on their device between the nodes of one process.

A node that computes on a GPU loans Warp arrays there and publishes them as they are. Consumers of the process that
compute on the same device and say so (`Input.on_device`) get them by reference; everybody else gets a message of numpy
arrays, copied once and only where there is such a reader at that moment. A loan is one block of device memory, held and
freed as a slot of the host is: its message's `keep` and `release` pin it. All work on a device is on Warp's stream of
it, so what is launched after the last release comes after all that reads. Other processes on the same GPU that take
arrays there read them in place too (evis/bus/memory/cuda_ipc.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import replace
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.bus.memory.cuda_ipc import BLOCK, ArrayPlaces, ExportedBlock, Form
from evis.bus.memory.slots import Loans, Pinned, aligned, rounded
from msgs.codec import check_layout
from msgs.fields import array_specs
from msgs.header import Message

if TYPE_CHECKING:
    import warp as wp

_numbers = count(1)
MOST_VIEWS = 16
"""Layouts that a slot remembers; packets of events have another length every time."""

_latest: dict[type[Message], tuple[list[tuple[Any, ...]], int]] = {}
"""Last form of each type that has passed `check`, and its size [bytes]: most messages of a topic are alike."""

LoanRequest = Mapping[str, tuple[tuple[int, ...], Any]]
"""Name -> (shape, Warp dtype); vectors count as one element, [E, H, W] of vec3."""


def device_of(message: Message) -> Any:
    """Returns the device that the first of a message's Warp arrays lies on; None where there are none."""
    for name in array_specs(type(message)):
        value = getattr(message, name)
        if value is not None and not isinstance(value, np.ndarray) and hasattr(value, "numpy"):
            return value.device
    return None


def check(message: Message) -> int:
    """Checks a message with Warp arrays against its type, and returns its size [bytes]. Raises MessageError."""
    arrays = message.arrays()
    # A dtype of Warp is not compared with one of numpy: their arrays differ in type before.
    like = [(name, type(value), value.dtype, value.shape) for name, value in arrays.items()]
    if (latest := _latest.get(type(message))) is not None and latest[0] == like:
        return latest[1]
    forms: dict[str, Any] = {name: Form.of(value) for name, value in arrays.items()}
    check_layout(type(message), forms)
    size = sum(form.nbytes for form in forms.values())
    _latest[type(message)] = like, size
    return size


def on_host(message: Message, loan: Callable[..., Mapping[str, np.ndarray]]) -> Message:
    """Copies a message to the host: those of its arrays that were Warp's lie in a `loan`. Waits for the device.

    loan: of the publisher that will send it, name=(shape, dtype) -> name: array.
    """
    import warp as wp

    away = {name: value for name, value in message.arrays().items() if not isinstance(value, np.ndarray)}
    forms = {name: Form.of(value) for name, value in away.items()}
    here: Any = loan(**{name: (form.shape, form.dtype) for name, form in forms.items()})
    for name, value in away.items():
        target: wp.array = wp.array(here[name], dtype=value.dtype, shape=value.shape, copy=False, device="cpu")
        wp.copy(target, value)
    for value in away.values():
        if value.device.is_cuda:
            wp.synchronize_stream(value.device.stream)
    whole: Any = message
    moved: Message = replace(whole, **here)
    return moved


def without_arrays(message: Message) -> Message:
    """Makes the message of no environment with the same header, in numpy arrays, for a reader that reads none of its
    arrays.

    The first axis of all its arrays is the environments'.
    """
    forms = {name: Form.of(value) for name, value in message.arrays().items()}
    whole: Any = message
    empty: Message = replace(whole, **{name: np.empty((0, *f.shape[1:]), f.dtype) for name, f in forms.items()})
    return empty


class DeviceSlot(Pinned):
    """Owns one block of device memory."""

    def __init__(self, pool: DevicePool, kind: tuple[Any, int, bool]) -> None:
        """Allocates a block. kind: device, size [bytes], and whether other processes are to read it."""
        import warp as wp

        super().__init__(pool)
        self.kind = kind
        self.device, size, exported = kind
        self.size = -(-size // BLOCK) * BLOCK if exported else size
        with wp.ScopedMempool(self.device, False) if exported else nullcontext():
            self._memory: wp.array = wp.empty(self.size, dtype=wp.uint8, device=self.device)
        self.exported = ExportedBlock(self._memory, next(_numbers)) if exported else None
        """What lets other processes read it."""
        self._views: dict[Any, dict[str, Any]] = {}

    def arrays(self, asked: LoanRequest) -> dict[str, Any]:
        """Returns arrays behind each other in the slot; the same objects for the same question."""
        import warp as wp

        key = tuple((name, tuple(shape), dtype) for name, (shape, dtype) in asked.items())
        if key not in self._views:
            if len(self._views) >= MOST_VIEWS:
                self._views.clear()
            at, views = self._memory.ptr, {}
            for name, shape, dtype in key:
                array: Any = wp.array(ptr=at, shape=shape, dtype=dtype, device=self.device)
                array.owner_of_memory = self._memory
                views[name] = array
                at += aligned(array.capacity)
            self._views[key] = views
        return self._views[key]

    def placed(self, message: Message) -> ArrayPlaces | None:
        """Locates the arrays of a message for other processes; None where not all are in this slot."""
        return ArrayPlaces.of(message, self._memory.ptr, self.size) if self.exported is not None else None

    def holds(self, array: Any) -> bool:
        """Tells whether the array lies in this slot."""
        return not isinstance(array, np.ndarray) and 0 <= array.ptr - self._memory.ptr < self.size


class DevicePool(Loans[DeviceSlot]):
    """Owns the device slots of one topic, all of one device and size.

    A bigger message, another device or other readers have them anew.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._of: tuple[Any, int, bool] = (None, 0, False)
        self._free: list[DeviceSlot] = []
        self._past: list[DeviceSlot] = []
        """Slots no longer used that other processes may have open."""

    def loan(self, device: Any, asked: LoanRequest, exported: bool = False) -> dict[str, Any]:
        """Lends Warp arrays to write the next message into; they are valid until the next claim. Raises BusError.

        exported: other processes are to read them.
        """
        size = sum(aligned(_nbytes(shape, dtype)) for shape, dtype in asked.values())
        if (device, exported) != self._of[::2] or size > self._of[1]:
            self._of = device, rounded(size), exported
            for slot in self._free:
                self._retire(slot)
            self._free.clear()
        if not self._free:
            self._check_room()
            self._free.append(DeviceSlot(self, self._of))
            self.live += 1
        slot = self._free.pop()
        slot.pin()
        self._loans.append(slot)
        return slot.arrays(asked)

    def claim(self, message: Message) -> DeviceSlot | None:
        """Returns the loan in which the message's arrays lie, with its pin now the caller's; other loans end.

        Without loans it is one that messages share (`sharing_loans`), pinned once more.
        """
        loans, self._loans = self._loans, []
        claimed = None
        values = message.arrays().values() if loans or self._shared else ()
        if not loans:
            for slot in self._shared:
                if any(slot.holds(value) for value in values):
                    slot.pin()
                    return slot
        for slot in loans:
            if claimed is None and any(slot.holds(value) for value in values):
                claimed = slot
            else:
                slot.unpin()
        return claimed

    def give_back(self, slot: DeviceSlot) -> None:
        """Takes back a slot whose last pin is gone; called by the slot."""
        if slot.kind == self._of:
            self._free.append(slot)
        else:
            self._retire(slot)

    def _retire(self, slot: DeviceSlot) -> None:
        self.live -= 1
        if slot.exported is not None:
            self._past.append(slot)


def on_host_too(asked: LoanRequest) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Returns shapes and dtypes of the numpy arrays that hold what Warp's would. asked: of scalars."""
    import warp as wp

    return {name: (tuple(shape), np.dtype(wp.dtype_to_numpy(dtype))) for name, (shape, dtype) in asked.items()}


def _nbytes(shape: tuple[int, ...], dtype: Any) -> int:
    import warp as wp

    return math.prod(shape) * int(wp.types.type_size_in_bytes(dtype))
