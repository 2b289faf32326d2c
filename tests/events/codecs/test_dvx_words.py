"""DVXplorer and DVXplorer Mini words written by hand."""

from __future__ import annotations

import numpy as np
import pytest

from evis.events.codecs.decoder import decoder_for

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])


def decode(encoding, words, backend, dtype="<u2"):
    decoder = decoder_for(encoding, backend=backend)
    return decoder.decode(np.array(words, dtype).tobytes()), decoder


def rows(events):
    return list(zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist()))


@BOTH
def test_groups_of_eight_rows(backend):
    """Code 3 is the first group, code 2 the second; 0 in bit 8 is ON; the second group lies before or after."""
    words = [0x8002, 0x1800 | 77, 0x4000 | 3 << 6 | 10, 0x3000 | 0b101, 0x2100 | 0x80, 0x4800 | 2 << 6 | 10, 0x2001]
    events, decoder = decode("dvxplorer", words, backend)
    assert rows(events) == [(2, 77, 80, 1), (2, 77, 82, 1), (2, 77, 111, 0), (2, 77, 64, 1)]
    assert decoder.counts == {}


@BOTH
def test_groups_off_the_sensor_are_counted(backend):
    """Above the first row, below the last, beyond the last column."""
    words = [
        0x8002,
        0x1000 | 5,
        0x4800 | 9 << 6 | 4,
        0x20FF,
        0x4000 | 31 << 6 | 63,
        0x3003,
        0x2001,
        0x1000 | 700,
        0x3001,
    ]
    events, decoder = decode("dvxplorer", words, backend)
    assert rows(events) == []
    assert decoder.counts == {"outside": 12}


def reference(ms: int) -> int:
    return 1 << 27 | ms


def column(x: int, sub: int | None = None) -> int:
    return 1 << 26 | x | (0 if sub is None else 1 << 21 | sub << 11)


def groups(first: int, step: int = 0, masks: int = 1, off: int = 0) -> int:
    return 1 << 31 | step << 26 | first << 18 | off << 16 | masks


@BOTH
def test_mini_readouts(backend):
    """Two groups a word, a time for the whole readout, padding between."""
    words = [reference(7), 0, column(3, 250), groups(2, 4, 0x8001, 0b10), 0, column(9), groups(1, masks=2, off=1)]
    events, decoder = decode("dvxplorer_mini", words, backend, "<u4")
    assert rows(events) == [(7250, 3, 16, 1), (7250, 3, 55, 0), (7250, 9, 9, 0)]
    assert decoder.counts == {}


@BOTH
def test_mini_waits_for_a_reference_and_a_readout(backend):
    """Before a reference, and before the start of a readout, nothing has a time."""
    words = [groups(1), column(5, 3), groups(1), reference(1), column(6), groups(1), column(7, 4), groups(1)]
    events, decoder = decode("dvxplorer_mini", words, backend, "<u4")
    assert rows(events) == [(1004, 7, 8, 1)]
    assert decoder.counts == {"untimed": 5}


@BOTH
def test_mini_reference_overflows_after_70_minutes(backend):
    """22 bits of ms; the same reference twice is no overflow."""
    top = (1 << 22) - 1
    words = [reference(top), column(1, 0), groups(0), reference(0), column(1, 1), groups(0)]
    words += [reference(0), column(1, 2), groups(0)]
    events, _ = decode("dvxplorer_mini", words, backend, "<u4")
    assert (events.t // 1000).tolist() == [top * 1000, (top + 1) * 1000 + 1, (top + 1) * 1000 + 2]


@BOTH
def test_mini_losses_are_noticed(backend):
    """A sub-time that does not rise, or a column that does not: wait for the next reference and readout, and count."""
    words = [reference(1), column(1, 9), groups(0), column(1, 9), groups(0)]
    words += [
        reference(2),
        column(4, 9),
        groups(0),
        column(4),
        groups(0),
        column(5, 11),
        reference(3),
        column(0, 9),
        groups(0),
    ]
    events, decoder = decode("dvxplorer_mini", words, backend, "<u4")
    assert (events.t // 1000).tolist() == [1009, 2009, 3009]
    assert decoder.counts == {"lost_references": 1, "lost_columns": 1, "untimed": 3}


@BOTH
def test_dvs128_words(backend):
    """Both axes from the far corner, polarity inverted, wraps of 2^14 us, reset, edges of the input."""
    words = [
        1 << 16 | 0,
        2 << 16 | 1 | 3 << 1 | 5 << 8,
        1 << 31,
        3 << 16 | 127 << 1,
        4 << 16 | 1 << 15,
        1 << 30,
        5 << 16,
    ]
    events, decoder = decode("dvs128", words, backend, "<u4")
    assert rows(events) == [(1, 127, 127, 1), (2, 124, 122, 0), (0x4003, 0, 127, 1), (5, 127, 127, 1)]
    edges = events.triggers
    assert (edges.t.tolist(), edges.id.tolist(), edges.value.tolist()) == ([0x4004 * 1000], [0], [1])
    assert decoder.counts == {"timestamp_resets": 1}
