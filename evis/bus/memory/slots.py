"""Tracks where the arrays of a message lie, and how many users they have.

A slot is one block of memory with a pin count: the loan, each remote consumer and each `keep` hold one pin, and the
slot is written again only when all are gone. `HeapSlot` serves consumers of this process; `MemorySlot` is a memfd that
other processes map through /proc/<pid>/fd, so that no kind of death leaves anything behind. Slots on a GPU, for the
nodes of one process, are in evis/bus/memory/device.py.
"""

from __future__ import annotations

import fcntl
import itertools
import math
import mmap
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from evis.bus.errors import BusError

ALIGN = 64
"""Alignment of every array in a slot [bytes]: a cache line, and the widest vector register."""
SLACK = 1 << 14
"""Room behind a loan for small arrays that were not loaned (stamps, offsets) [bytes]."""
SMALLEST = 1 << 16
MOST_SLOTS = 64
"""Slots of one topic; more means that somebody keeps messages and never releases them."""

_ids = itertools.count(1)


class Pool(Protocol):
    """Owns blocks of memory of one topic."""

    name: str

    def give_back(self, slot: Any) -> None:
        """Takes back a block whose last pin is gone."""


class Pinned:
    """Counts the users of a block of memory in `pins`. At zero the block goes back to its pool."""

    def __init__(self, pool: Pool) -> None:
        self.pool = pool
        self.pins = 0

    def pin(self) -> None:
        """Keeps the contents for one more user."""
        self.pins += 1

    def unpin(self) -> None:
        """Takes one user away. Raises BusError when there was none."""
        if self.pins <= 0:
            raise BusError(f"{self.pool.name}: a message was released more often than it was kept")
        self.pins -= 1
        if not self.pins:
            self.pool.give_back(self)


S = TypeVar("S", bound=Pinned)


class Loans(Generic[S]):
    """Holds the loans of one topic: slots that were lent to be written, and that no message has claimed yet.

    live: slots that exist. Where several messages are sent from one loan, `_shared` holds it while they are sent.
    """

    def __init__(self, name: str) -> None:
        """Takes the topic's name, for errors."""
        self.name = name
        self.live = 0
        self._loans: list[S] = []
        self._shared: list[S] = []

    @contextmanager
    def sharing_loans(self) -> Iterator[None]:
        """Lets any number of messages sent within the block claim the loans made before it. Blocks may be nested."""
        loans, self._loans = self._loans, []
        outer, self._shared = self._shared, self._shared + loans
        try:
            yield
        finally:
            self._shared = outer
            for slot in loans:
                slot.unpin()

    def part_with(self, slot: S) -> None:
        """Leaves a slot to the holder of its only pin: its arrays stay as they are while something refers to them."""
        slot.pins = 0
        self.live -= 1

    def _check_room(self) -> None:
        """Raises BusError where a topic has MOST_SLOTS slots already."""
        if self.live >= MOST_SLOTS:
            raise BusError(
                f"{self.name}: all {self.live} slots are kept by consumers: a node calls keep() without release()"
            )


class Slot(Pinned):
    """Owns one block of host memory."""

    kind: ClassVar[str] = "heap"

    def __init__(self, pool: SlotPool, generation: int, memory: np.ndarray) -> None:
        super().__init__(pool)
        self.generation = generation
        self.memory = memory
        self.size = memory.nbytes
        self.address = address(memory)
        self.used = 0
        self.header: tuple[Any, bytes] = None, b""
        """All but the moment of the last message that was sent from here, and its packed header."""
        self.placed: list[tuple[np.ndarray, int]] = []
        """Arrays given out since it was taken, and where they are."""

    def place(self, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
        """Returns the next aligned array of this shape behind those already placed."""
        view: np.ndarray = np.ndarray(shape, dtype, buffer=self.memory.data, offset=self.used)
        self.placed.append((view, self.used))
        self.used = aligned(self.used + view.nbytes)
        return view

    def offset(self, array: np.ndarray) -> int | None:
        """Returns where an array lies in this slot [bytes]; None when it does not."""
        for view, at in self.placed:  # by far the usual case, and asking numpy for an address takes a microsecond
            if view is array:
                return at
        start = address(array) - self.address
        return start if 0 <= start and start + array.nbytes <= self.size else None

    def descriptor(self, offsets: list[int]) -> list[Any] | None:
        """Returns what another process needs to map the arrays; None where it cannot."""
        return None

    def close(self) -> None:
        """Gives the memory back, once nothing in this process reads it."""


class HeapSlot(Slot):
    """Owns memory of this process alone."""

    def __init__(self, pool: SlotPool, generation: int, size: int) -> None:
        raw = np.empty(size + ALIGN, np.uint8) if pool.written_by is None else _pinned(size + ALIGN)
        start = -address(raw) % ALIGN
        super().__init__(pool, generation, raw[start : start + size])


class MemorySlot(Slot):
    """Owns anonymous shared memory.

    Its pages are reserved here: a full machine is an error now and not a SIGBUS later.
    """

    kind: ClassVar[str] = "memfd"

    def __init__(self, pool: SlotPool, generation: int, size: int) -> None:
        self.id = next(_ids)
        self.fd = reserve(pool.name, size)
        super().__init__(pool, generation, np.frombuffer(mmap.mmap(self.fd, size), np.uint8))
        self._locked_for = None
        if pool.written_by is not None:
            from evis.gpu.driver import page_lock

            if page_lock(pool.written_by, self.address, size):
                self._locked_for = pool.written_by

    def descriptor(self, offsets: list[int]) -> list[Any]:
        return [self.kind, os.getpid(), self.fd, self.id, self.generation, self.size, offsets]

    def close(self) -> None:
        if self._locked_for is not None:
            from evis.gpu.driver import page_unlock

            page_unlock(self._locked_for, self.address)
            self._locked_for = None
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1


def _pinned(size: int) -> np.ndarray:
    """Allocates page-locked memory of this process, which a GPU writes to several times as fast."""
    import warp as wp

    memory: wp.array = wp.empty(size, dtype=wp.uint8, device="cpu", pinned=True)
    view: np.ndarray = memory.numpy()
    return view


def reserve(name: str, size: int) -> int:
    """Makes a memfd of `size` bytes whose pages exist and that can never shrink. Raises BusError where memory
    is short."""
    fd = os.memfd_create(f"evis{name.replace('/', '-')}", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    try:
        os.posix_fallocate(fd, 0, size)
        fcntl.fcntl(fd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW)
    except OSError as error:
        os.close(fd)
        raise BusError(
            f"no room for {size / 1e6:.1f} MB of shared memory for {name} ({error.strerror}): "
            "free memory, raise its limit, or use a smaller image or window"
        ) from None
    return fd


def address(array: np.ndarray) -> int:
    """Returns the address of an array's first byte."""
    return array.__array_interface__["data"][0]


def aligned(size: int) -> int:
    """Returns the next multiple of ALIGN."""
    return -(-size // ALIGN) * ALIGN


def rounded(size: int) -> int:
    """Returns the slot size for a message: whole pages, in quarter octaves, so that growing ones seldom need more."""
    step = 1 << max(12, (size - 1).bit_length() - 3)
    return max(SMALLEST, -(-size // step) * step)


class SlotPool(Loans[Slot]):
    """Owns the slots of one topic: `slots` of them, all of one size and kind.

    A bigger message starts a new generation; older slots are closed when their last pin goes. When every slot is pinned
    one more is made (`spares` counts them), up to MOST_SLOTS.
    """

    def __init__(self, name: str, slots: int, *, shared: bool = False) -> None:
        super().__init__(name)
        self.slots = slots
        self.shared = shared
        self.written_by: Any = None
        """A Warp device, a GPU, that writes into slots: they are made for that."""
        self.spares = 0
        self.generation = 0
        self._size = 0
        self._made = 0
        self._free: list[Slot] = []

    def loan(self, arrays: Mapping[str, tuple[tuple[int, ...], Any]]) -> dict[str, np.ndarray]:
        """Returns aligned arrays to write the next message into, name -> (shape, dtype), until the next claim."""
        wanted = [(name, tuple(shape), np.dtype(dtype)) for name, (shape, dtype) in arrays.items()]
        slot = self.take(sum([aligned(math.prod(shape) * dtype.itemsize) for _, shape, dtype in wanted]))
        self._loans.append(slot)
        return {name: slot.place(shape, dtype) for name, shape, dtype in wanted}

    def claim(self, arrays: Mapping[str, np.ndarray]) -> Slot | None:
        """Returns the loaned slot in which (most of) the arrays lie, its pin now the caller's; other loans end.

        Without loans it is one that messages share (`sharing_loans`), pinned once more.
        """
        if not self._loans:
            return self._claim_shared(arrays) if self._shared else None
        loans, self._loans = self._loans, []
        if len(loans) == 1:  # by far the usual case: one array in it decides
            for array in arrays.values():
                if array.nbytes and loans[0].offset(array) is not None:
                    return loans[0]
        bytes_in = [sum(a.nbytes for a in arrays.values() if s.offset(a) is not None) for s in loans]
        best = max(range(len(loans)), key=bytes_in.__getitem__)
        for i, slot in enumerate(loans):
            if i != best or not bytes_in[best]:
                slot.unpin()
        return loans[best] if bytes_in[best] else None

    def _claim_shared(self, arrays: Mapping[str, np.ndarray]) -> Slot | None:
        for slot in self._shared:
            if any(array.nbytes and slot.offset(array) is not None for array in arrays.values()):
                slot.pin()
                return slot
        return None

    def ready(self) -> bool:
        """Tells whether a slot is free."""
        return bool(self._free)

    def take(self, size: int) -> Slot:
        """Returns a free slot of `size` bytes (and SLACK) or more, pinned once.

        Raises BusError: out of memory or slots.
        """
        size += SLACK
        if size > self._size:
            self._size = rounded(size)
            self._renew()
        if not self._free:
            self._check_room()
            self._free.append((MemorySlot if self.shared else HeapSlot)(self, self.generation, self._size))
            self.live += 1
            self._made += 1
            self.spares += self._made > self.slots
        slot = self._free.pop()
        slot.used = 0
        slot.placed.clear()
        slot.pin()
        return slot

    def share(self, shared: bool) -> None:
        """Chooses between heap and shared memory for the slots to come."""
        if shared != self.shared:
            self.shared = shared
            self._renew()

    def write_from(self, device: Any) -> None:
        """Prepares the slots for a GPU, a Warp device, to write into, from now on."""
        if self.written_by is None:
            self.written_by = device
            self._renew()

    def _renew(self) -> None:
        self.generation += 1
        self._made = 0
        self._drop_free()

    def _drop_free(self) -> None:
        for slot in self._free:
            slot.close()
        self.live -= len(self._free)
        self._free.clear()

    def give_back(self, slot: Slot) -> None:
        """Takes back a slot whose last pin is gone; called by the slot."""
        if slot.generation == self.generation:
            self._free.append(slot)
        else:
            slot.close()
            self.live -= 1

    def close(self) -> None:
        """Closes what is free; pinned slots close with their last pin."""
        for slot in self._loans:
            slot.unpin()
        self._loans.clear()
        self._renew()
