"""Lets nodes of several processes share arrays on a GPU in place, by CUDA's IPC handles of memory and events.

A slot of the device has memory of an allocation of its own, whose handle goes with every message, and an event that is
recorded behind what writes it: the reader's stream waits for that, and no host does. The slot is free again when the
reader's work has passed the message's last release. Until a publisher closes, it keeps every slot that it has exported.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from evis.gpu.driver import HANDLE_BYTES, close_memory, handle_of, open_memory
from msgs.codec import WireHeader, check_layout, pack_header
from msgs.fields import MessageError
from msgs.header import Message

KIND = "cuda"
"""Key in the `extra` of a header."""
BLOCK = 1 << 21
"""Smaller allocations share one, and its handle is of them all [bytes]."""
MOST_INLINE = 1 << 16
"""Bytes of the small arrays of a message that are the host's (stamps, episodes), which travel in the header."""
_LETTERS = {"float16": "h", "float32": "f", "float64": "d", "int32": "i", "int64": "l", "uint8": "ub", "uint16": "us"}


@dataclass(frozen=True)
class Form:
    """Describes dtype and shape of an array in numpy's terms."""

    dtype: np.dtype
    shape: tuple[int, ...]

    @staticmethod
    def of(array: Any) -> Form:
        """Makes the form of a numpy or Warp array, whose vectors become one more axis."""
        if isinstance(array, np.ndarray):
            return Form(array.dtype, array.shape)
        dtype, inner = _element(array.dtype)
        return Form(dtype, array.shape + inner)

    @property
    def nbytes(self) -> int:
        """Returns the size of such an array [bytes]."""
        return math.prod(self.shape) * self.dtype.itemsize


@cache
def _element(dtype: Any) -> tuple[np.dtype, tuple[int, ...]]:
    """Returns numpy's dtype and the shape of one element of a Warp dtype."""
    import warp as wp

    scalar = getattr(dtype, "_wp_scalar_type_", dtype)
    return np.dtype(wp.dtype_to_numpy(scalar)), tuple(getattr(dtype, "_shape_", ()))


def uuid_of(device: str) -> str:
    """Returns the UUID of the GPU on which arrays of other processes can be read; "" where `device`, as Warp names it,
    is none."""
    if not device.startswith("cuda"):
        return ""
    from evis.gpu.devices import device_named

    found = device_named(device)
    return str(found.uuid) if found.is_ipc_supported is not False else ""


class ExportedBlock:
    """Holds the handles by which other processes read one block of device memory."""

    def __init__(self, memory: Any, number: int) -> None:
        """Makes the handles. memory: Warp array of uint8, an allocation of its own outside Warp's pool. number: of the
        slot."""
        import warp as wp

        self._device: Any = memory.device
        self._event = wp.Event(self._device, interprocess=True)
        handle = handle_of(self._device, memory.ptr)
        self.handles = [str(self._device.uuid), number, memory.capacity, handle, self._event.ipc_handle()]

    def written(self) -> None:
        """Records the event for which readers wait: after all that was launched so far."""
        self._device.stream.record_event(self._event)


@dataclass(frozen=True)
class ArrayPlaces:
    """Locates the arrays of a message in a block.

    places: offset in the slot [bytes] and length of vectors, 0 = scalars. inline: those of the host.
    """

    forms: dict[str, Form]
    places: dict[str, list[int]]
    inline: dict[str, bytes]

    @staticmethod
    def of(message: Message, start: int, size: int) -> ArrayPlaces | None:
        """Finds the arrays of a message in the device memory [start, start + size); None where one is not there, or too
        large for a header. Raises MessageError."""
        forms: dict[str, Form] = {}
        places: dict[str, list[int]] = {}
        inline: dict[str, bytes] = {}
        for name, value in message.arrays().items():
            form = forms[name] = Form.of(value)
            if isinstance(value, np.ndarray):
                inline[name] = value.tobytes()
                continue
            vector = getattr(value.dtype, "_shape_", ())
            at = (value.ptr or start) - start
            if len(vector) > 1 or not value.is_contiguous or not 0 <= at <= at + form.nbytes <= size:
                return None
            places[name] = [at, vector[0] if vector else 0]
        if sum(map(len, inline.values())) > MOST_INLINE:
            return None
        checked: Any = forms
        check_layout(type(message), checked)
        return ArrayPlaces(forms, places, inline)

    def packed(self, message: Message, exported: ExportedBlock) -> bytes:
        """Packs the header, with which the whole message travels."""
        forms: Any = self.forms
        return pack_header(message, forms, {KIND: [*exported.handles, self.places, self.inline]})


class ImportedSlots:
    """Opens the slots of one publisher on this process's GPU, each once."""

    def __init__(self, device: str) -> None:
        """Takes the device by Warp's name."""
        from evis.gpu.devices import device_named

        self.device: Any = device_named(device)
        self._open: dict[int, tuple[Any, Any]] = {}

    def close(self) -> None:
        """Closes all slots, once nothing in this process reads them."""
        self._open.clear()

    def attach(self, wire: WireHeader, descriptor: Any) -> Message:
        """Makes the message whose arrays a descriptor names. Raises MessageError for an invalid descriptor."""
        number, size, places, inline = self._checked(wire, descriptor)
        memory, event = self._open[number]
        arrays: dict[str, Any] = {}
        for name, dtype, shape in wire.arrays:
            where = f"{wire.message_type.__name__}.{name}"
            form = Form(dtype, shape)
            if (there := inline.get(name)) is not None:
                if type(there) is not bytes or len(there) != form.nbytes:
                    raise MessageError(f"{where}: {dtype.name} {shape} does not fit what came with the header")
                arrays[name] = np.frombuffer(there, dtype).reshape(shape)
                continue
            place = places.get(name)
            if type(place) is not list or [type(n) for n in place] != [int, int] or min(place) < 0:
                raise MessageError(f"{where}: {place!r:.80} is no place in device memory")
            at, vector = place
            if at + form.nbytes > size or (vector and shape[-1:] != (vector,)):
                raise MessageError(f"{where}: {dtype.name} {shape} at byte {at} is not within {size} bytes")
            arrays[name] = self._array(memory, at, form, vector)
        forms: Any = {name: Form.of(value) for name, value in arrays.items()}
        check_layout(wire.message_type, forms)
        self.device.stream.wait_event(event)
        return wire.message_type(wire.header, **arrays, **wire.scalars)  # type: ignore[call-arg]

    def _close(self, start: int, size: int) -> None:
        close_memory(self.device, start)

    def _array(self, memory: Any, at: int, form: Form, vector: int) -> Any:
        import warp as wp

        dtype, shape = wp.dtype_from_numpy(form.dtype), form.shape
        if vector:
            named = f"vec{vector}{_LETTERS.get(form.dtype.name, '?')}"
            dtype = getattr(wp, named, None) or wp.types.vector(length=vector, dtype=dtype)
            shape = shape[:-1]
        array: Any = wp.array(ptr=memory.ptr + at, shape=shape, dtype=dtype, device=self.device)
        array.owner_of_memory = memory
        return array

    def _checked(self, wire: WireHeader, descriptor: Any) -> tuple[int, int, Mapping[str, Any], Mapping[str, Any]]:
        """Opens the slot of a descriptor; returns its number and size, and where each array is."""
        import warp as wp

        name = wire.message_type.__name__
        kinds = [str, int, int, bytes, bytes, dict, dict]
        if not isinstance(descriptor, list) or [type(part) for part in descriptor] != kinds:
            raise MessageError(f"{name}: {descriptor!r:.80} describes no arrays on a GPU")
        uuid, number, size, memory, event, places, inline = descriptor
        if uuid != self.device.uuid or len(memory) != HANDLE_BYTES or len(event) != HANDLE_BYTES or size <= 0:
            raise MessageError(f"{name}: its arrays are on GPU {uuid:.80}, and {self.device.uuid} is this side's")
        if number not in self._open:
            start = open_memory(self.device, memory)
            if not start:
                raise MessageError(f"{name}: its arrays on GPU {uuid} cannot be opened: their process may be gone")
            there: Any = wp.array(ptr=start, shape=(size,), dtype=wp.uint8, device=self.device, deleter=self._close)
            behind = wp.event_from_ipc_handle(event, self.device)
            if not behind.cuda_event:
                raise MessageError(f"{name}: the event behind its arrays on GPU {uuid} cannot be opened")
            self._open[number] = there, behind
        return number, size, places, inline


def without_rows(wire: WireHeader) -> Message:
    """Makes the message of no environment, for a reader that reads none of its arrays."""
    arrays = {name: np.empty((0, *shape[1:]), dtype) for name, dtype, shape in wire.arrays}
    return wire.message_type(wire.header, **arrays, **wire.scalars)  # type: ignore[call-arg]
