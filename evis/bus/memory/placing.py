"""Places a message in a slot: its arrays where other processes can read them, and the header that locates them."""

from __future__ import annotations

import numpy as np

from evis.bus.memory.slots import Slot, SlotPool, aligned
from msgs.codec import Buffer, layout, pack_header, pack_moment, pack_scalars
from msgs.header import Message


def place(
    pool: SlotPool, message: Message, arrays: dict[str, np.ndarray], slot: Slot | None
) -> tuple[Slot, list[int], int]:
    """Copies arrays that are not there yet into the slot, or all into a new one when there is no room.

    slot: what was loaned, if anything; its pin goes over to the slot returned. Returns the slot, the offset of each
    array in it [bytes], and how many arrays were copied.
    """
    if slot is not None and slot.kind != "heap":
        at = [o for a in arrays.values() if (o := slot.offset(a)) is not None]
        if len(at) == len(arrays):
            return slot, at, 0
    foreign = {n: a for n, a in arrays.items() if slot is None or slot.offset(a) is None}
    room = sum(aligned(a.nbytes) for a in foreign.values())
    if slot is None or slot.kind == "heap" or slot.used + room > slot.size:
        loaned = slot
        foreign = arrays.copy()
        slot = pool.take(sum(aligned(a.nbytes) for a in foreign.values()))
    else:
        loaned = None
    for name, array in foreign.items():
        view = slot.place(array.shape, array.dtype)
        view[...] = array
        if isinstance(getattr(message, name), np.ndarray):
            setattr(message, name, view)  # consumers in this process are to see what the slot protects
        arrays[name] = view
    if loaned is not None:
        loaned.unpin()
    offsets = [slot.offset(a) for a in arrays.values()]
    return slot, [o for o in offsets if o is not None], len(foreign)


def describe(message: Message, arrays: dict[str, np.ndarray], slot: Slot, offsets: list[int]) -> list[Buffer]:
    """Packs the header; one that differs from the slot's last message only in its moment is not packed anew."""
    key = layout(arrays), offsets, message.header.clock, pack_scalars(message)
    last, header = slot.header
    if key == last:
        return [header, pack_moment(message.header)]
    header = pack_header(message, arrays, {"slot": slot.descriptor(offsets)})
    slot.header = key, header
    return [header]
