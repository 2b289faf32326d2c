"""Limits how much a reader may unpack for what it was given: a small file must not cost gigabytes.

Every reader of packed data (compressed recordings and chunks, pictures, meshes, arrays whose header states their size)
asks here before it unpacks and while it does, and raises its own error with the text of the refusal.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

RATIO = 100
"""Bytes unpacked per byte read. Event recordings pack 2 to 30 times, linear EXR 2 to 10; a bomb of zeros 1,000 to
30,000 times."""
BASE = 256 << 20
"""What may be unpacked whatever was read [bytes]: a picture of one colour packs 1,000 times and stays small."""
CAP = 32 << 30
"""Most that is unpacked of one file unless EVIS_UNPACK_LIMIT says otherwise [bytes]."""
VARIABLE = "EVIS_UNPACK_LIMIT"


class AllowanceError(ValueError):
    """Reports that more would be unpacked than allowed: how much, how much is allowed, and how to allow more."""


def limit_from_environment() -> int | None:
    """Returns the bytes that EVIS_UNPACK_LIMIT allows; None where it is not set.

    Raises AllowanceError for a text that is no whole number of bytes (K, M, G, T as endings).
    """
    text = os.environ.get(VARIABLE, "").strip()
    if not text:
        return None
    ending = "KMGT".find(text[-1].upper()) + 1
    digits = text[:-1] if ending else text
    if not (digits.isascii() and digits.isdigit()):
        raise AllowanceError(f"{VARIABLE} is '{text}', must be a number of bytes such as 500M or 64G")
    return int(digits) << (10 * ending)


@dataclass
class Allowance:
    """Counts what is unpacked of one file against what its size allows.

    read: bytes of the packed data [bytes]. ratio, base: see RATIO and BASE. The limit is base + ratio * read, at most
    CAP; EVIS_UNPACK_LIMIT, where it is set, replaces all three.
    """

    read: int
    ratio: int = RATIO
    base: int = BASE
    taken: int = 0

    @property
    def limit(self) -> int:
        """Returns the most that may be unpacked [bytes]."""
        chosen = limit_from_environment()
        return min(CAP, self.base + self.ratio * self.read) if chosen is None else chosen

    def check(self, size: int) -> None:
        """Raises AllowanceError when `size` bytes more than were taken so far are not allowed; takes nothing."""
        limit = self.limit
        if self.taken + size > limit:
            raise AllowanceError(
                f"{_bytes(self.read)} would unpack to {_bytes(self.taken + size)} or more, over the limit of "
                f"{_bytes(limit)}; if that is what it should be, set {VARIABLE}={_suggested(self.taken + size)}"
            )

    def take(self, size: int) -> None:
        """Counts `size` bytes as unpacked. Raises AllowanceError as `check` does."""
        self.check(size)
        self.taken += size


def _bytes(size: int) -> str:
    """Returns a number of bytes for people: 65 kB, 2.1 GB."""
    if size < 1000:
        return f"{size} bytes"
    power = min(4, (len(str(size)) - 1) // 3)
    value = size / 1000**power
    return f"{value:.1f} {' kMGT'[power]}B" if value < 10 else f"{value:.0f} {' kMGT'[power]}B"


def _suggested(size: int) -> str:
    """Returns the next power of two at or above twice the size, in GiB: the size so far may be only a beginning."""
    gib = 1
    while gib << 30 < 2 * size:
        gib *= 2
    return f"{gib}G"
