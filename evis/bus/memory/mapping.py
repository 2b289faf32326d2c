"""Reads another process's shared memory: opens the publisher's slots, maps each once, views the arrays in place."""

from __future__ import annotations

import fcntl
import mmap
import os
import stat
from collections.abc import Sequence
from typing import Any

import numpy as np

from msgs.codec import WireHeader, attach, decode_moment, nbytes
from msgs.fields import MessageError
from msgs.header import Message

MOST_HEADERS = 64
"""Message headers remembered; a topic whose arrays keep their shapes has one per slot."""


def open_memfd(pid: int, fd: int) -> int:
    """Opens another process's memfd for reading. Raises OSError when it cannot be reached or is not one."""
    handle = os.open(f"/proc/{pid}/fd/{fd}", os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        # Without the seal its owner could shrink the file, and reading the lost pages is a SIGBUS.
        regular = stat.S_ISREG(os.fstat(handle).st_mode)
        if not regular or not fcntl.fcntl(handle, fcntl.F_GET_SEALS) & fcntl.F_SEAL_SHRINK:
            raise OSError("not a sealed memfd")
    except OSError:
        os.close(handle)
        raise
    return handle


def reachable(pid: int, fd: int, token: bytes) -> bool:
    """Tells whether the publisher's probe opens here and holds its token: same host, pid namespace and user."""
    try:
        handle = open_memfd(pid, fd)
    except OSError:
        return False
    try:
        return os.pread(handle, len(token), 0) == token
    finally:
        os.close(handle)


class SlotReader:
    """Maps slots by their descriptors and keeps the maps of the current generation.

    A header that comes again, byte for byte, has been checked: it names the same arrays in the same slot.
    """

    def __init__(self) -> None:
        self._generation = -1
        self._maps: dict[int, memoryview] = {}
        self._known: dict[bytes, tuple[type[Message], str, dict[str, np.ndarray], dict[str, Any]]] = {}

    def recall(self, frames: Sequence[bytes]) -> Message | None:
        """Returns the message of a header that is the same as before but for its moment. Raises MessageError."""
        known = self._known.get(frames[0])
        if known is None or len(frames) != 2:
            return None
        message_type, clock, arrays, scalars = known
        header = decode_moment(frames[1], clock)
        # Views of their own: whoever changes the shape of one in place changes no other message's.
        return message_type(header, **{n: a.view() for n, a in arrays.items()}, **scalars)  # type: ignore[call-arg]

    def attach(self, wire: WireHeader, descriptor: Any, frames: Sequence[bytes]) -> Message:
        """Makes the message whose arrays a descriptor names. Raises MessageError, or OSError when the slot is gone."""
        if len(frames) > 2:
            raise MessageError(f"{wire.message_type.__name__}: a slot descriptor where the arrays should be")
        if len(frames) == 2:
            wire.header = decode_moment(frames[1], wire.header.clock)
        message = attach(wire, self.buffers(wire, descriptor))
        if not any(type(value) in (list, dict) for value in wire.scalars.values()):  # two messages cannot share those
            if len(self._known) >= MOST_HEADERS:
                self._known.clear()
            arrays = {name: array.view() for name, array in message.arrays().items()}
            self._known[frames[0]] = wire.message_type, wire.header.clock, arrays, wire.scalars
        return message

    def buffers(self, wire: WireHeader, descriptor: Any) -> list[memoryview]:
        """Returns the memory of each array of a message, in place.

        Raises MessageError, or OSError when the slot is gone.
        """
        pid, fd, slot, generation, size, offsets = _checked(descriptor, wire)
        if generation != self._generation:  # views that are kept hold their map alive by themselves
            self._maps.clear()
            self._known.clear()
            self._generation = generation
        memory = self._maps.get(slot)
        if memory is None:
            memory = self._maps[slot] = _map(pid, fd, size)
        ends = [start + nbytes(array) for start, array in zip(offsets, wire.arrays)]
        if any(end > len(memory) for end in ends):
            raise MessageError(f"{wire.message_type.__name__}: an array reaches beyond its slot of {len(memory)} bytes")
        return [memory[start:end] for start, end in zip(offsets, ends)]


def _checked(descriptor: Any, wire: WireHeader) -> tuple[int, int, int, int, int, Sequence[int]]:
    name = wire.message_type.__name__
    if not isinstance(descriptor, list) or len(descriptor) != 7 or descriptor[0] != "memfd":
        raise MessageError(f"{name}: slot descriptor {descriptor!r:.80} is of no kind that this side can read")
    *numbers, offsets = descriptor[1:]
    if not isinstance(offsets, list) or len(offsets) != len(wire.arrays):
        raise MessageError(f"{name}: slot descriptor {descriptor!r:.80} does not fit its arrays")
    if any(type(n) is not int or n < 0 for n in (*numbers, *offsets)):
        raise MessageError(f"{name}: slot descriptor {descriptor!r:.80} holds something that is not a count")
    pid, fd, slot, generation, size = numbers
    return pid, fd, slot, generation, size, offsets


def _map(pid: int, fd: int, size: int) -> memoryview:
    handle = open_memfd(pid, fd)
    try:
        actual = os.fstat(handle).st_size
        if actual != size or not size:
            raise MessageError(f"slot of {actual} bytes where {size} were announced")
        return memoryview(mmap.mmap(handle, size, prot=mmap.PROT_READ))
    finally:
        os.close(handle)
