"""EVT2 and EVT3 decoders against other readers, a word-by-word machine and each other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stream_cases import random_events, same, sha256_us
from word_machines import run_evt2, run_evt3

from evis.events import Events, Triggers
from evis.events.codecs.prophesee import evt2, evt3
from evis.events.files.prophesee.raw_header import read_header

CODECS = {"evt2": evt2, "evt3": evt3}
MACHINES = {"evt2": run_evt2, "evt3": run_evt3}
REAL = {"evt3": "derived/gen31_vga_from_bag1.raw", "evt2": "prophesee/faery_evt2.raw"}
BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
CODEC = pytest.mark.parametrize("codec", ["evt2", "evt3"])


def words_of(path) -> bytes:
    with path.open("rb") as file:
        read_header(file)
        return file.read()


@BOTH
@CODEC
def test_real_recording_gives_the_hash_of_other_readers(codec, backend, truth, recording_path):
    """Every event of the real recordings is as three other readers found it."""
    known = truth[REAL[codec]]
    decoder = CODECS[codec].Decoder(640, 480, backend)
    events = decoder.decode(words_of(recording_path(REAL[codec])))
    assert len(events) == known["n"]
    assert sha256_us(events) == known["sha256"]
    assert (decoder.outside, decoder.pending) == (0, 0)


@BOTH
def test_triggers_of_the_real_recording(backend, truth, recording_path):
    """The 4157 trigger edges have the times and channel that the recording's authors publish."""
    known = truth["ros/event_camera_py_test_events_1.bag"]
    triggers = evt3.Decoder(640, 480, backend).decode(words_of(recording_path(REAL["evt3"]))).triggers
    assert len(triggers) == known["n_triggers"]
    assert int((triggers.t // 1000).sum()) == known["sum_t_triggers"]
    first = [[int(triggers.t[i]) // 1000, int(triggers.id[i]), int(triggers.value[i])] for i in range(2)]
    assert first == known["first_triggers"]


def check_against_machine(codec: str, data: bytes, backend: str, width: int, height: int) -> None:
    dtype = CODECS[codec].Decoder.word
    words = np.frombuffer(data, dtype, len(data) // dtype.itemsize).tolist()
    rows, edges, outside, untimed = MACHINES[codec](words, width, height)
    decoder = CODECS[codec].Decoder(width, height, backend)
    events = decoder.decode(data)
    got = list(zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist()))
    assert got == rows
    triggers = events.triggers
    assert list(zip((triggers.t // 1000).tolist(), triggers.id.tolist(), triggers.value.tolist())) == edges
    assert (decoder.outside, decoder.untimed) == (outside, untimed)
    assert decoder.pending == len(data) % dtype.itemsize


SIZES = st.sampled_from([(0, 0), (640, 480), (1280, 720)])


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=400), size=SIZES)
@BOTH
@CODEC
def test_any_bytes_decode_as_the_word_machine(codec, backend, data, size):
    """Whatever bytes come, both back ends do what the rules say."""
    check_against_machine(codec, data, backend, *size)


@BOTH
@CODEC
@pytest.mark.parametrize("seed", range(4))
def test_random_words_decode_as_the_word_machine(codec, backend, seed):
    """Long random streams with every word type, turns of the counter and addresses outside."""
    rng = np.random.default_rng(seed)
    dtype = CODECS[codec].Decoder.word
    bits = 8 * dtype.itemsize
    kinds = np.array([0, 2, 3, 4, 5, 6, 8, 10, 14] if codec == "evt3" else [0, 0, 1, 1, 8, 10, 14])
    words = rng.choice(kinds, 5000) << (bits - 4) | rng.integers(0, 1 << bits - 4, 5000)
    check_against_machine(codec, words.astype(dtype).tobytes(), backend, 640, 480 if seed % 2 else 0)


@settings(max_examples=40, deadline=None)
@given(data=st.binary(max_size=600), cuts=st.lists(st.integers(0, 600), max_size=8))
@BOTH
@CODEC
def test_pieces_give_what_the_whole_gives(codec, backend, data, cuts):
    """Cut anywhere, also inside a word, the events, the state and the counters are the same."""
    whole = CODECS[codec].Decoder(640, 480, "numpy")
    expected = whole.decode(data)
    decoder = CODECS[codec].Decoder(640, 480, backend)
    edges = [0, *sorted(c for c in cuts if c < len(data)), len(data)]
    parts = [decoder.decode(data[a:b]) for a, b in itertools.pairwise(edges)]
    same(Events.concatenate([Events.empty(), *parts]), expected)
    np.testing.assert_array_equal(decoder.state, whole.state)
    assert decoder.pending == whole.pending


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1000), limits=st.lists(st.integers(-5, 2_000_000), max_size=6))
@BOTH
@CODEC
def test_cuts_in_time(codec, backend, seed, limits):
    """Each cut goes before the first event later than the limit; nothing is lost, and the bytes taken are all bytes."""
    events = random_events(seed, 300)
    data = CODECS[codec].Encoder().encode(events)
    decoder = CODECS[codec].Decoder(640, 480, backend)
    decoder.feed(data)
    parts, taken, at = [Events.empty()], [], 0
    for limit in sorted(limits):
        part = decoder.decode_until(limit)
        taken.append(decoder.taken.tobytes())
        late = np.flatnonzero(events.t[at:] > limit)
        assert len(part) == (late[0] if len(late) else len(events) - at)
        assert decoder.at_cut == bool(len(late))
        if len(late):
            assert decoder.next_t_ns == events.t[at + late[0]]
        at += len(part)
        parts.append(part)
    parts.append(decoder.decode())
    taken.append(decoder.taken.tobytes())
    same(Events.concatenate(parts), events)
    assert b"".join(taken) == data


@BOTH
@CODEC
def test_cut_goes_before_a_later_trigger(codec, backend):
    """A trigger later than the limit stays for the next call, as an event does."""
    events = Events.of([1_000, 9_000], [1, 2], [3, 3], [1, 1])
    events.triggers = Triggers(np.array([2_000, 5_000]), np.array([1, 1], np.uint8), np.array([1, 0], np.uint8))
    decoder = CODECS[codec].Decoder(640, 480, backend)
    decoder.feed(CODECS[codec].Encoder().encode(events))
    first = decoder.decode_until(4_999)
    assert (first.t.tolist(), first.triggers.t.tolist(), decoder.next_t_ns) == ([1_000], [2_000], 5_000)
    rest = decoder.decode_until(10_000)
    assert (rest.t.tolist(), rest.triggers.t.tolist(), decoder.at_cut) == ([9_000], [5_000], False)


@CODEC
def test_more_events_than_one_launch_holds(codec):
    """The kernel goes on where its scratch was full, also in the triggers."""
    events = random_events(3, 700_000, triggers=20_000)
    data = CODECS[codec].Encoder().encode(events)
    same(CODECS[codec].Decoder(640, 480, "warp").decode(data), events)


def test_vectors_at_the_end_of_one_launch():
    """A vector that does not fit the kernel's scratch any more waits for the next launch."""
    n = 32 * 20_000
    events = Events.of(
        np.concatenate([[0], np.arange(n) // 32 + 1]) * 1000,
        np.concatenate([[3], np.arange(n) % 32 + 64]),
        np.full(n + 1, 9),
        np.ones(n + 1, np.uint8),
    )
    data = evt3.Encoder().encode(events)
    assert len(data) < 12 * n // 32
    same(evt3.Decoder(640, 480, "warp").decode(data), events)


@BOTH
@pytest.mark.parametrize(("codec", "half"), [("evt3", 1 << 11), ("evt2", 1 << 27)])
def test_a_fall_by_half_the_range_is_a_turn(codec, half, backend):
    """TIME_HIGH that falls by exactly half its range has turned; by one less it has stepped back."""
    top = np.dtype(CODECS[codec].Decoder.word).itemsize * 8 - 4
    event = [0x2001] if codec == "evt3" else [0x10000801]
    for fall, turned in ((half, 1), (half - 1, 0)):
        words = [8 << top | half + 5, *event, 8 << top | half + 5 - fall, *event]
        decoder = CODECS[codec].Decoder(640, 480, backend)
        t = decoder.decode(np.array(words, decoder.word).tobytes()).t
        unit = 4_096_000 if codec == "evt3" else 64_000
        assert t[1] - t[0] == turned * 2 * half * unit - fall * unit


def test_counter_turns_after_16_777216_s():
    """Words written by hand around the turn of EVT3's 24-bit counter."""
    words = [0x8FFF, 0x6FFF, 0x0007, 0x2805, 0x8000, 0x2806, 0x6003, 0x2007]
    for backend in ("numpy", "warp"):
        events = evt3.Decoder(640, 480, backend).decode(np.array(words, "<u2").tobytes())
        assert events.t.tolist() == [16_777_215_000, 16_777_216_000, 16_777_219_000]
        assert (events.x.tolist(), events.y.tolist(), events.p.tolist()) == ([5, 6, 7], [7, 7, 7], [1, 1, 0])


def test_time_low_that_steps_back_is_kept_and_high_sets_it_to_zero():
    """openeb's rules, by hand: no clamp of small steps back, low = 0 after a new TIME_HIGH, repeats change nothing."""
    words = [0x2001, 0x8001, 0x6005, 0x2001, 0x6003, 0x2001, 0x8001, 0x2001, 0x8002, 0x2001]
    for backend in ("numpy", "warp"):
        decoder = evt3.Decoder(640, 480, backend)
        events = decoder.decode(np.array(words, "<u2").tobytes())
        assert (events.t // 1000).tolist() == [4101, 4099, 4099, 8192]
        assert decoder.untimed == 1


@BOTH
def test_evt3_library_agrees_over_a_turn(backend):
    """The evt3 package reads the same events from a stream that passes 16.8 s, with vectors and steps back."""
    library = pytest.importorskip("evt3")
    events = random_events(11, 40_000, start_us=16_000_000, step_us=400)
    data = evt3.Encoder().encode(events)
    ours = evt3.Decoder(640, 480, backend).decode(data)
    same(ours, events)
    theirs = library.Decoder(640, 480).feed(data)
    assert int(ours.t.max()) > 16_777_216_000
    np.testing.assert_array_equal(theirs.t.astype(np.int64) * 1000, ours.t)
    np.testing.assert_array_equal(theirs.x, ours.x)
    np.testing.assert_array_equal(theirs.y, ours.y)
    np.testing.assert_array_equal(theirs.p, ours.p)


def test_reset_waits_for_the_next_time():
    """After lost bytes nothing is decoded with an old time."""
    decoder = evt3.Decoder(640, 480)
    words = np.array([0x8001, 0x6001, 0x2001], "<u2")
    assert len(decoder.decode(words.tobytes())) == 1
    decoder.reset()
    assert len(decoder.decode(words[1:].tobytes())) == 0
