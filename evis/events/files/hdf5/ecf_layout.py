"""Describes the layout of Prophesee's ECF compression of HDF5 chunks (filter 0x8ECF), at most 65535 events a chunk.

u32 = events << 2 | yxp packed << 1 | xp packed; u64 first time [us]. Then the times as bytes (step << 4 | count): a
count of 15 is followed by the count as u16, a step of 15 adds the low nibble to the next step, least nibble first. Then
either three words of 4 events each (y << 12 | x << 1 | p, 24 bits), or runs of rows as u16 (y << 5 | count, 31: a u16
follows) and columns: 12-bit (x << 1 | p), 4 in three u16, or u16 (x << 5 | mask of the 5 pixels behind it, first pixel
in the highest bit) with runs of polarity as bytes (p << 7 | count, 127: a u16 follows). In packed words an event that
does not fit has its low bits at the end of one word and its high bits at the start of the next.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

FILTER = 0x8ECF
MAX_EVENTS = 65535
MAX_SIDE = 2048
"""Packed words hold coordinates below this."""
HEAD = struct.Struct("<Iq")
HEAD_BYTES = HEAD.size

COUNT_SHIFT, PACKED_EVENTS, PACKED_COLUMNS = 2, 2, 1
"""Of the first word: bits below the number of events, and the bits that say what is packed."""
STEP_BITS, STEP_MAX, LAST_SHIFT = 4, 15, 56
"""Of the times: bits of a step and of a count, the value that stands for a longer one, the last nibble's place."""
GROUP, EVENT_GROUP_BYTES, COLUMN_GROUP_BYTES = 4, 12, 6
"""Events of a group of packed words, and its bytes with rows and without them."""
X_SHIFT, Y_SHIFT, SIDE_MASK = 1, 12, MAX_SIDE - 1
"""Of a packed event; its polarity is the lowest bit."""
ROW_COUNT_BITS, POLARITY_COUNT_BITS = 5, 7
"""Bits of the count in a run of events in one row, and of one polarity; all ones: the count follows as u16."""
MASK_BITS = 5
"""Pixels behind a column that its mask tells of."""


class Head(NamedTuple):
    """Describes how a chunk is stored. n: events. t0: first time [us]. yxp, xp: packed events, packed columns."""

    n: int
    t0: int
    yxp: bool
    xp: bool


def read_head(data: bytes) -> Head | None:
    """Reads the head of a chunk; None where it is cut inside it."""
    if len(data) < HEAD_BYTES:
        return None
    word, t0 = HEAD.unpack_from(data)
    return Head(word >> COUNT_SHIFT, t0, bool(word & PACKED_EVENTS), bool(word & PACKED_COLUMNS))
