"""What the encoders write, the decoders give back: whole, in pieces, up to any cut, and over turns of the counters."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from codec_cases import ALL, LOSSLESS_BACKWARD, MESSAGES, WIRE, decoder, encoder, samples, stream, transport
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import same

from evis.events import Events, Frame, Triggers
from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.encoder import encoder_for

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
TURN_US = {"davis346": 1 << 15, "dvxplorer": 1 << 15, "dvxplorer_mini": 1000 << 22, "dvs128": 1 << 14}


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1 << 30), n=st.integers(1, 300), start=st.integers(0, 60_000_000), cuts=st.integers(1, 4))
@BOTH
@pytest.mark.parametrize("encoding", WIRE)
def test_cameras_words(encoding, backend, seed, n, start, cuts):
    """Events and triggers come back bit for bit and in order, however calls and buffers split them."""
    events = stream(encoding, seed, n, start_us=start, step_us=900, triggers=n // 10)
    edges = np.linspace(0, n, cuts + 1).astype(int)
    if encoding == "dvxplorer_mini":
        # a call is a whole number of readouts
        edges = np.unique([0, *(np.searchsorted(events.t, events.t[k]) for k in edges[1:-1]), n])
    pieces = [events[a:b] for a, b in itertools.pairwise(edges)]
    pieces[0].triggers = Triggers(*(getattr(events.triggers, k)[:3] for k in ("t", "id", "value")))
    pieces[0].triggers.t[:] = np.minimum(pieces[0].triggers.t, events.t[0])
    made = encoder(encoding)
    data = b"".join(made.encode(piece) for piece in pieces)
    expected = events[0:n]
    expected.triggers = pieces[0].triggers
    reader, rng = decoder(encoding, backend), np.random.default_rng(seed)
    at = [0, *np.sort(rng.integers(0, len(data) + 1, 4)).tolist(), len(data)]
    same(Events.concatenate([reader.decode(data[a:b]) for a, b in itertools.pairwise(at)]), expected)
    assert reader.counts == {} and reader.pending == 0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1 << 30), n=st.integers(1, 300), start=st.integers(0, 1 << 51), step=st.integers(8, 1 << 22))
@BOTH
@pytest.mark.parametrize("encoding", MESSAGES)
def test_messages(encoding, backend, seed, n, start, step):
    """Messages hold any times, as many messages as it takes; bases are theirs."""
    events = stream(encoding, seed, n, start_us=start, step_us=step)
    reader = decoder(encoding, backend)
    parts = [reader.decode_packet(data, base) for base, data in transport(encoding, events)]
    same(Events.concatenate(parts), events)
    assert reader.counts == {}


def test_mono_and_trigger_are_exact_to_the_nanosecond():
    """Times are not rounded to us."""
    events = Events.of([1_000_000_007, 1_000_000_123], [1, 2], [3, 4], [0, 1])
    ((base, data),) = encoder("mono").encode_packets(events)
    assert base == 1_000_000_007 and len(data) == 16
    same(decoder("mono").decode_packet(data, base), events)


@BOTH
@pytest.mark.parametrize("encoding", ALL)
def test_every_prefix_gives_all_events_before_the_cut(encoding, backend):
    """A stream that ends anywhere, also inside a word, gives what the words before the end say: a prefix that grows."""
    events = stream(encoding, 3, 60, triggers=4)
    ((base, data),) = transport(encoding, events)
    count = 0
    for end in range(len(data) + 1):
        made = decoder(encoding, backend)
        part = made.decode_packet(data[:end], base)
        n, m = len(part), len(part.triggers)
        same(part, _prefix(events, n, m))
        assert made.pending == end % made.word.itemsize
        assert n + m >= count
        count = n + m
    assert count == len(events) + len(events.triggers)


def _prefix(events: Events, n: int, m: int) -> Events:
    part, edges = events[0:n], events.triggers
    part.triggers = Triggers(edges.t[:m], edges.id[:m], edges.value[:m])
    return part


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1 << 30), limits=st.lists(st.integers(-5, 2_000_000), max_size=5))
@BOTH
@pytest.mark.parametrize("encoding", ALL)
def test_cuts_in_time(encoding, backend, seed, limits):
    """Each cut goes before the first event or trigger later than the limit, and nothing is lost."""
    events = stream(encoding, seed, 200)
    ((base, data),) = transport(encoding, events)
    all_t = events.triggers.t if encoding == "trigger" else events.t
    reader, at, parts, taken = decoder(encoding, backend), 0, [Events.empty()], b""
    reader.feed_packet(data, base)
    for limit in sorted(limits):
        part = reader.decode_until(limit)
        taken += reader.taken.tobytes()
        late = np.flatnonzero(all_t[at:] > limit)
        assert len(part) + len(part.triggers) == (late[0] if len(late) else len(all_t) - at)
        assert reader.at_cut == bool(len(late))
        assert reader.next_t_ns == (int(all_t[at + late[0]]) if len(late) else None)
        at += len(part) + len(part.triggers)
        parts.append(part)
    parts.append(reader.decode())
    same(Events.concatenate(parts), events)
    assert taken + reader.taken.tobytes() == data


@BOTH
@pytest.mark.parametrize("encoding", TURN_US)
def test_silences_of_many_turns(encoding, backend):
    """Gaps longer than the counter keep their length, also of thousands of turns."""
    turn = TURN_US[encoding]
    t_us = (np.array([0, 0.3, 1.5, 1.9, 2.05, 3.1, 7.7, 8.0, 9000.5]) * turn).astype(np.int64) + 5
    events = Events.of(t_us * 1000, np.arange(9), np.arange(9), np.zeros(9, np.uint8))
    same(decoder(encoding, backend).decode(encoder(encoding).encode(events)), events)


@BOTH
@pytest.mark.parametrize("encoding", WIRE)
def test_bare_time_words(encoding, backend):
    """`advance` writes what a sensor sends that sees nothing; events after it have the right times."""
    made, reader = encoder(encoding), decoder(encoding, backend)
    first = Events.of([1_000_000], [3], [4], [1])
    later = Events.of([90_000_000_000], [5], [6], [0])
    data = [made.encode(first), *(made.advance(s * 1_000_000_000) for s in range(1, 90)), made.encode(later)]
    assert made.advance(0) == b"" and any(data[1:-1])
    silent = [reader.decode(piece) for piece in data]
    assert [len(e) for e in silent] == [1, *[0] * 89, 1]
    same(Events.concatenate(silent), Events.concatenate([first, later]))


@pytest.mark.parametrize("encoding", sorted(set(WIRE) - {"dvxplorer_mini"}))
def test_resync_pieces_decode_alone(encoding):
    """With resync each call starts with its own time and address."""
    events = stream(encoding, 5, 400)
    made = encoder_for(encoding, resync=True)
    for a in range(0, 400, 50):
        piece = events[a : a + 50]
        decoded = decoder(encoding).decode(made.encode(piece))
        turn = TURN_US.get(encoding, 1 << 50) * 1000
        same(
            Events(decoded.t % turn, decoded.x, decoded.y, decoded.p), Events(piece.t % turn, piece.x, piece.y, piece.p)
        )


@BOTH
def test_davis_frames_samples_and_triggers_among_the_events(backend):
    """Everything a DAVIS sends, interleaved: pixels bit for bit, inertial samples to half a count, times exactly."""
    rng = np.random.default_rng(1)
    events = stream("davis346", 1, 3000, triggers=40)
    pixels = (rng.integers(0, 1024, (260, 346)) << 6).astype(np.uint16)
    small = (rng.integers(0, 1024, (40, 100)) << 6).astype(np.uint16)
    events.frames = [
        Frame(1_000_000, pixels, 1_200_000, 3_000_000, 0, 0, 5_000_000),
        Frame(6_000_000, small, 6_000_000, 7_000_000, 5, 10, 7_500_000),
        Frame(8_000_000, pixels[::-1].copy(), 8_000_000, 8_500_000, 0, 0, 200_000_000),
    ]
    events.imu = samples(2, np.arange(30) * 500)
    data = encoder("davis346").encode(events)
    reader, at = decoder("davis346", backend), [0, *np.sort(rng.integers(0, len(data), 40)).tolist(), len(data)]
    got = Events.concatenate([reader.decode(data[a:b]) for a, b in itertools.pairwise(at)])
    same(got, events)
    assert reader.counts == {} and len(got.frames) == 3
    for frame, sent in zip(got.frames, events.frames):
        np.testing.assert_array_equal(frame.pixels, sent.pixels)
        for name in ("t_ns", "exposure_start_ns", "exposure_end_ns", "exposure_ns", "x0", "y0", "end_ns"):
            assert getattr(frame, name) == getattr(sent, name), name
    check_imu(got.imu, events.imu, 2000 / 32768)


def check_imu(got, sent, dps_count: float) -> None:
    """Half a count: at most 16 g and the largest angular range over 2^15, 1/340 deg C."""
    np.testing.assert_array_equal(got.t, sent.t)
    np.testing.assert_allclose(got.acceleration, sent.acceleration, atol=0.51 * 9.80665 * 16 / 32768)
    np.testing.assert_allclose(got.angular_velocity, sent.angular_velocity, atol=0.51 * np.radians(dps_count))
    np.testing.assert_allclose(got.temperature, sent.temperature, atol=0.51 / 340)


@BOTH
def test_dvxplorer_inertial_samples(backend):
    """The Bosch chip's axes are exchanged on the wire and come back in order."""
    events = stream("dvxplorer", 1, 500, triggers=9)
    events.imu = samples(3, np.arange(30) * 90)
    got = decoder("dvxplorer", backend).decode(encoder("dvxplorer").encode(events))
    same(got, events)
    check_imu(got.imu, events.imu, 2000 / 32768)


@pytest.mark.parametrize("encoding", ALL)
def test_what_the_words_cannot_hold_is_named(encoding):
    """One line that says what does not fit and what to do."""
    made = encoder(encoding)
    good = {"t": [1_000_000], "x": [1], "y": [1], "p": [1]}
    with pytest.raises(ValueError, match=encoding if encoding != "trigger" else "trigger"):
        made.encode(Events.of(**good | {"c": [1]}))
    if encoding not in ("mono",):
        with pytest.raises(ValueError, match=r"holds x up to|holds y up to"):
            made.encode(Events.of(**good | {"x": [65000], "y": [65000]}))
    with pytest.raises(ValueError, match=r"negative|alone|holds x"):
        made.encode(Events.of(**good | {"t": [-5000]}))
    if encoding not in LOSSLESS_BACKWARD:
        with pytest.raises(ValueError, match=r"steps? back|alone|holds x"):
            made.encode(Events.of([10**9, 10**8], [1, 1], [1, 1], [1, 1]))
    with_frame = Events.of(**good)
    with_frame.frames = [Frame(0, np.zeros((4, 4, 3), np.uint8), 0, 1)]
    with pytest.raises(ValueError, match=r"frame|holds x"):
        made.encode(with_frame)
    if encoding in WIRE:
        with pytest.raises(ValueError, match="--rebase"):
            encoder(encoding).encode(Events.of(**good | {"t": [2**62]}))


def test_encoder_for_lists_the_known_ones():
    """As decoder_for."""
    with pytest.raises(ValueError, match="davis346"):
        encoder_for("davis347")
    assert decoder_for("davis346").width == 346
