"""The kernels take runs of EVT words at once: buffers that end anywhere, runs of all lengths, cuts in time, edges of
the sensor; always against the numpy reference."""

from __future__ import annotations

import numpy as np
import pytest
from stream_cases import random_events, same

from evis.events import Events
from evis.events.codecs.buffer import EventBuffer
from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.encoder import encoder_for

CODECS = ["evt2", "evt21", "evt21_legacy", "evt3"]


def words(encoding: str, kind: str) -> bytes:
    """Singles, vectors or both, with triggers; `long`: runs of several thousand words without a turn of the time."""
    if kind == "long":
        events = random_events(1, 9000, step_us=1)
        events.t[:] = np.sort(events.t) // 64_000 * 64_000
    else:
        events = random_events(2, 4000, triggers=40)
    if kind != "mixed":
        events.x[:] = (events.x * 7 if kind != "vectors" else events.x) % 640
    return encoder_for(encoding).encode(events)


def reference(encoding: str, size: tuple[int, int], data: bytes) -> tuple[Events, np.ndarray]:
    decoder = decoder_for(encoding, *size, "numpy")
    return decoder.decode(data), decoder.state


@pytest.mark.parametrize("encoding", CODECS)
@pytest.mark.parametrize("kind", ["mixed", "vectors", "long"])
@pytest.mark.parametrize("size", [(640, 480), (637, 300), (1, 480), (0, 0)])
def test_buffers_of_any_size(encoding, kind, size):
    """The kernel stops where the buffer ends and goes on in the next one."""
    data = words(encoding, kind)
    expected, state = reference(encoding, size, data)
    for room in (64, 101, 1500):
        decoder = decoder_for(encoding, *size, "warp")
        decoder.feed(data)
        parts = []
        while decoder.pending >= decoder.word.itemsize:
            buffer = EventBuffer(room)
            before = decoder.pending
            other, _ = decoder._launch(2**62, buffer)
            part = buffer.events()
            if other is not None:
                part.triggers = other.triggers
            parts.append(part)
            assert decoder.pending < before
        same(Events.concatenate(parts), expected)
        np.testing.assert_array_equal(decoder.state, state)


@pytest.mark.parametrize("encoding", CODECS)
@pytest.mark.parametrize("kind", ["mixed", "long"])
def test_cuts_in_time(encoding, kind):
    """Windows of many lengths: the same events in each, and the same time at the cut."""
    data = words(encoding, kind)
    one, other = (decoder_for(encoding, 637, 470, backend) for backend in ("numpy", "warp"))
    rng = np.random.default_rng(3)
    for decoder in (one, other):
        decoder.feed(data)
    t_ns = 0
    while one.pending >= one.word.itemsize:
        same(one.decode_until(t_ns), other.decode_until(t_ns))
        assert (one.next_t_ns, one.pending, one.at_cut) == (other.next_t_ns, other.pending, other.at_cut)
        np.testing.assert_array_equal(one.state, other.state)
        t_ns += int(rng.choice([1000, 3000, 64_000, 200_000, 5_000_000]))


@pytest.mark.parametrize("encoding", CODECS)
def test_a_large_block(encoding):
    """More words than are decoded by way of scratch: several turns of the time, and what is given stays as it is."""
    events = random_events(5, 150_000, step_us=40, triggers=300)
    data = encoder_for(encoding).encode(events)
    decoder = decoder_for(encoding, 640, 480, "warp")
    first = decoder.decode(data)
    kept = Events(*(a.copy() for a in (first.t, first.x, first.y, first.p)), triggers=first.triggers)
    decoder.decode(data)
    same(first, kept)
    same(first, reference(encoding, (640, 480), data)[0])
