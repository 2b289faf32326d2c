"""Seeded damage to the bytes of a file.

`python tests/adversary/mutations.py FILE SEED OUT [OTHER]` writes the input that a campaign names by file and seed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "events"))

NUMBERS = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**62, 2**63, 2**64 - 1]
"""Lengths and counts that readers trip over: signs, limits, far too many."""


def flips(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """1 to 16 single bits."""
    for at in rng.integers(0, len(data), rng.integers(1, 17)):
        data[at] ^= 1 << int(rng.integers(8))


def flips_in_head(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """The same in the first 4 kB, where lengths and names are."""
    for at in rng.integers(0, min(len(data), 4096), rng.integers(1, 9)):
        data[at] ^= 1 << int(rng.integers(8))


def cut(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """The end is missing."""
    del data[int(rng.integers(1, len(data) + 1)) :]


def gap(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """A stretch in the middle is missing."""
    at = int(rng.integers(len(data)))
    del data[at : at + int(rng.integers(1, 1 << rng.integers(1, 17)))]


def zeros(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """A stretch of zeros, as file systems leave after a crash."""
    at, size = int(rng.integers(len(data))), int(rng.integers(1, 1 << rng.integers(1, 17)))
    data[at : at + size] = bytes(len(data[at : at + size]))


def splice(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """A stretch of another place or another file, inserted or written over."""
    source = other if len(other) and rng.random() < 0.5 else bytes(data)
    size = int(rng.integers(1, 1 << rng.integers(1, 17)))
    start, at = int(rng.integers(len(source))), int(rng.integers(len(data)))
    piece = source[start : start + size]
    data[at : at + (len(piece) if rng.random() < 0.5 else 0)] = piece


def lengths(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """Hostile integers, inserted or written over, half of them in the first 4 kB."""
    for _ in range(rng.integers(1, 5)):
        width, order = int(rng.choice([1, 2, 4, 8])), str(rng.choice(["little", "big"]))
        number = NUMBERS[rng.integers(len(NUMBERS))] % (1 << 8 * width)
        at = int(rng.integers(min(len(data), 4096) if rng.random() < 0.5 else len(data)))
        data[at : at + (width if rng.random() < 0.7 else 0)] = number.to_bytes(width, order)


def digits(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """Numbers of a text made long, negative, huge or no numbers."""
    places = np.flatnonzero((np.frombuffer(data, np.uint8) >= 0x30) & (np.frombuffer(data, np.uint8) <= 0x39))
    texts = [b"9" * 30, b"-1", b"1e308", b"nan", b"-inf", b"0", b"65536", b"4294967296", b"0x7f", b"", b"a"]
    for _ in range(rng.integers(1, 4)):
        if len(places):
            at = int(places[rng.integers(len(places))])
            data[at : at + 1] = texts[rng.integers(len(texts))]


def edits(data: bytearray, other: bytes, rng: np.random.Generator) -> None:
    """Those of tests/events/file_damage.py."""
    from file_damage import damage

    data[:] = damage(bytes(data), rng)


KINDS: list[Callable[[bytearray, bytes, np.random.Generator], None]] = [
    flips, flips_in_head, cut, gap, zeros, splice, lengths, digits, edits,
]  # fmt: skip


def mutate(data: bytes, seed: list[int], other: bytes = b"") -> tuple[bytes, str]:
    """The damaged bytes, never none, and the kind of damage."""
    rng = np.random.default_rng(seed)
    kind = KINDS[rng.integers(len(KINDS))]
    out = bytearray(data)
    kind(out, other, rng)
    return bytes(out) or b"\0", kind.__name__


if __name__ == "__main__":
    file, numbers, target, *rest = sys.argv[1:]
    damaged, name = mutate(
        Path(file).read_bytes(), [int(n) for n in numbers.split(",")], Path(rest[0]).read_bytes() if rest else b""
    )
    Path(target).write_bytes(damaged)
    print(name)
