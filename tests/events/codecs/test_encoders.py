"""Encoders: what they write, the decoders give back; what they cannot write, they name."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import random_events, same

from evis.events import Events, Triggers
from evis.events.codecs.prophesee import evt2, evt3

CODECS = {"evt2": evt2, "evt3": evt3}
CODEC = pytest.mark.parametrize("codec", ["evt2", "evt3"])


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 400), start=st.integers(0, 60_000_000), cuts=st.integers(1, 5))
@CODEC
def test_round_trip(codec, seed, n, start, cuts):
    """Events and triggers come back bit for bit, in order, however they are split over calls."""
    events = random_events(seed, n, start_us=start, step_us=900, triggers=n // 10)
    encoder, edges = CODECS[codec].Encoder(), np.linspace(0, n, cuts + 1).astype(int)
    pieces = [events[a:b] for a, b in itertools.pairwise(edges)]
    pieces[0].triggers = Triggers(*(getattr(events.triggers, k)[:3] for k in ("t", "id", "value")))
    data = b"".join(encoder.encode(piece) for piece in pieces)
    decoded = CODECS[codec].Decoder(640, 480).decode(data)
    expected = events[0:n]
    expected.triggers = pieces[0].triggers
    same(decoded, expected)


@pytest.mark.parametrize(("codec", "turn_us"), [("evt3", 2**24), ("evt2", 2**34)])
@pytest.mark.parametrize("start", [0.0, 0.6, 1.2, 30.7])
def test_jumps_over_many_turns(codec, turn_us, start):
    """Silences longer than the counter's turn keep their length: the encoder counts the turns out."""
    t_us = np.array([0, 0.3, 0.49, 1.5, 1.9, 2.05, 3.1, 7.7, 7.70001, 99.5]) * turn_us + start * turn_us
    events = Events.of(t_us.astype(np.int64) * 1000, np.arange(10), np.arange(10), np.zeros(10, np.uint8))
    data = CODECS[codec].Encoder().encode(events)
    decoded = CODECS[codec].Decoder(640, 480).decode(data)
    # turns before the first TIME_HIGH are written out too, so that absolute times hold
    same(decoded, events)


@pytest.mark.parametrize(("codec", "bits"), [("evt3", 12), ("evt2", 28)])
@pytest.mark.parametrize("step", [0.0137, 0.49, 0.51, 1.7])
@pytest.mark.parametrize("silent", [False, True])
def test_turns_that_other_readers_see(codec, bits, step, silent):
    """Sparse events keep their times where a turn is a fall of TIME_HIGH by all of its range but 10.

    That is the rule of openeb's EVT2 and of the decoders among Metavision's samples, which sees every value.
    """
    kind, low_bits = CODECS[codec], {"evt3": 12, "evt2": 6}[codec]
    t_us = (np.arange(1, 40) * step * (1 << bits + low_bits)).astype(np.int64)
    n = len(t_us)
    events = Events.of(t_us * 1000, np.full(n, 3), np.full(n, 4), np.ones(n, np.uint8))
    encoder = kind.Encoder()
    data = b""
    for i in range(n):
        data += encoder.advance(int(t_us[i]) * 1000) if silent else b""
        data += encoder.encode(events[i : i + 1])
    words = np.frombuffer(data, kind.Encoder.word).astype(np.int64)
    found, turns, high = [], 0, 0
    of, value = words >> kind.Encoder.word.itemsize * 8 - 4, words & (1 << bits) - 1
    for word, v in zip(of.tolist(), value.tolist()):
        if word == kind.TIME_HIGH:
            turns += high - v >= (1 << bits) - 1 - 10
            high = v
        elif word == {"evt3": evt3.ADDR_X, "evt2": evt2.ON}[codec]:
            found.append((turns << bits) + high)
    assert found == (t_us >> low_bits).tolist()


@CODEC
def test_resync_pieces_decode_alone(codec):
    """With resync each piece starts with its own time and row."""
    events = random_events(5, 500)
    encoder = CODECS[codec].Encoder(resync=True)
    for a in range(0, 500, 50):
        piece = events[a : a + 50]
        same(CODECS[codec].Decoder(640, 480).decode(encoder.encode(piece)), piece)


def test_dense_rows_become_vectors():
    """32 neighbours of one time take a base and three vector words, as from a sensor."""
    events = Events.of(np.full(32, 5000), np.arange(64, 96), np.full(32, 9), np.ones(32, np.uint8))
    words = np.frombuffer(evt3.Encoder().encode(events), "<u2").tolist()
    assert words == [0x8000, 0x6005, 0x0009, 0x3840, 0x4FFF, 0x4FFF, 0x50FF]


@CODEC
@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"x": [2048]}, "x up to 2047"),
        ({"y": [3000]}, "y up to 2047"),
        ({"t": [-1]}, "negative"),
        ({"t": [10**18]}, "--rebase"),
        ({"c": [1]}, "colour"),
    ],
)
def test_what_the_words_cannot_hold_is_named(codec, change, text):
    """One line that says what does not fit, and what to do."""
    values = {"t": [1000], "x": [1], "y": [1], "p": [1]} | change
    with pytest.raises(ValueError, match=text):
        CODECS[codec].Encoder().encode(Events.of(**values))


def test_long_steps_back_are_refused():
    """A step back of more than half a turn would come out as a turn forward."""
    back = Events.of([20_000_000_000, 2_000_000_000], [1, 1], [1, 1], [1, 1])
    with pytest.raises(ValueError, match="step back"):
        evt3.Encoder().encode(back)


def test_events_that_do_not_fit_their_types_are_refused():
    """No silent wrap to 16 bits."""
    with pytest.raises(ValueError, match="x runs from 0 to 70000"):
        Events.of([1, 2], [0, 70000], [0, 0], [0, 1])
    with pytest.raises(ValueError, match="equal length"):
        Events.of([1, 2], [0], [0, 0], [0, 1])
    with pytest.raises(ValueError, match="whole numbers"):
        Events.of([1.5], [0], [0], [0])
    with pytest.raises(ValueError, match="p must be 0"):
        Events.of([1], [0], [0], [2])
