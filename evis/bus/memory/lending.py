"""Lends memory of a topic to its publisher, which writes messages into it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from evis.bus.memory.device import DevicePool, DeviceSlot, LoanRequest, device_of, on_host_too
from evis.bus.memory.slots import Slot, SlotPool
from msgs.header import Message


class Lender:
    """Lends slots of a topic's pools, of the host and of a device; the base of all publishers."""

    _pool: SlotPool
    _on_device: DevicePool

    def loan(self, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, np.ndarray]:
        """Returns aligned arrays to write the next message into, name -> (shape, dtype); valid until `send`."""
        return self._pool.loan(arrays)

    def loan_from(self, device: Any, asked: LoanRequest) -> dict[str, np.ndarray]:
        """Returns numpy arrays as `loan` does, of (shape, Warp dtype), in memory that the device writes to fast."""
        if device.is_cuda:
            self._pool.write_from(device)
        return self.loan(**on_host_too(asked))

    def claim_on(self, message: Message) -> DeviceSlot | None:
        """Returns the slot of `loan_on` that a message's Warp arrays lie in, pinned once for the caller.

        None = in none.
        """
        return self._on_device.claim(message)

    @contextmanager
    def sharing_loans(self) -> Iterator[None]:
        """Lets the messages sent within the block lie in the loans made before it, several in one."""
        with self._pool.sharing_loans(), self._on_device.sharing_loans():
            yield

    def lend(self, message: Message) -> Slot | DeviceSlot | None:
        """Returns the loan that another topic's message lies in, pinned once for the caller; within `sharing_loans`."""
        if device_of(message) is not None:
            return self._on_device.claim(message)
        return self._pool.claim(message.arrays())
