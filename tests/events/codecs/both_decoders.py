"""Both back ends of a decoder on the same bytes, for the tests with bytes that nobody has encoded: they must agree."""

from __future__ import annotations

import functools

import numpy as np

from evis.events import Events
from evis.events.codecs.decoder import Decoder, decoder_for

SIZES = [(0, 0), (1, 1), (640, 480), (2048, 2048)]
"""Widths and heights of sensors; 0: not known."""


def consistent(events: Events, width: int, height: int) -> None:
    """Arrays of one length and their types, inside the sensor, triggers and samples alike."""
    assert len(events.t) == len(events.x) == len(events.y) == len(events.p)
    assert (events.t.dtype, events.x.dtype, events.y.dtype, events.p.dtype) == (
        np.int64,
        np.uint16,
        np.uint16,
        np.uint8,
    )
    if len(events):
        assert events.p.max() <= 1 and events.t.min() >= 0
        assert not width or events.x.max() < width
        assert not height or events.y.max() < height
    assert len(events.triggers.t) == len(events.triggers.id) == len(events.triggers.value)
    assert events.imu.acceleration.shape == events.imu.angular_velocity.shape == (len(events.imu.t), 3)


def contents(events: Events) -> list[object]:
    """Every bit that a decoder gives."""
    groups = (events, events.triggers, events.imu)
    names = ("txyp", ("t", "id", "value"), ("t", "acceleration", "angular_velocity", "temperature"))
    arrays = [getattr(group, name).tobytes() for group, of in zip(groups, names) for name in of]
    return arrays + [(f.pixels.tobytes(), f.t_ns, f.end_ns, f.x0, f.y0) for f in events.frames]


@functools.cache
def fresh(encoding: str, size: tuple[int, int]) -> tuple[Decoder, Decoder]:
    """One decoder of each back end, made once: making them costs more than an input."""
    return decoder_for(encoding, *size, "numpy"), decoder_for(encoding, *size, "warp")


def pair(encoding: str, size: tuple[int, int]) -> tuple[Decoder, Decoder]:
    """The decoders of both back ends, reset."""
    both = fresh(encoding, size)
    for made in both:
        made.reset()
        assert made.counts == {} and made.pending == 0
    return both


def run(encoding: str, size: tuple[int, int], pieces: list[bytes], limit_ns: int | None, gap: int) -> None:
    """Both back ends on the same pieces, with a stop in time and a gap; they must agree in everything."""
    one, other = pair(encoding, size)
    for i, piece in enumerate(pieces):
        results = []
        for made in (one, other):
            if i == gap:
                made.resync()
            made.feed(piece)
            first = [] if limit_ns is None else [made.decode_until(limit_ns)]
            results.append([*first, made.decode()])
        for a, b in zip(*results):
            assert contents(a) == contents(b)
            consistent(a, one.width, one.height)
    assert one.state.tobytes() == other.state.tobytes()
    assert one.counts == other.counts and one.pending == other.pending < one.word.itemsize
