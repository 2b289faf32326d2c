"""Every codec on any words: against a word-by-word machine, and its kernel against its numpy twin."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from codec_cases import ALL, SIZES, decoder
from codec_machines import MACHINES
from hypothesis import given, settings
from hypothesis import strategies as st
from likely_words import likely_words
from stream_cases import same

from evis.events import Events
from evis.events.codecs.decoder import decoder_for

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
WITH_KERNEL = [name for name in ALL if decoder(name).kernel]


def check_machine(encoding: str, backend: str, data: bytes) -> None:
    width, height = SIZES.get(encoding, (640, 480))
    made = decoder_for(encoding, width, height, backend)
    words = np.frombuffer(data, made.word, len(data) // made.word.itemsize).tolist()
    rows, edges, counts = MACHINES[encoding](words, width, height)
    events = made.decode(data)
    assert list(zip((events.t // 1000).tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist())) == rows
    triggers = events.triggers
    assert list(zip((triggers.t // 1000).tolist(), triggers.id.tolist(), triggers.value.tolist())) == edges
    ours = {k: v for k, v in made.counts.items() if k not in ("imu_damaged", "frames_damaged")}
    assert ours == {k: v for k, v in counts.items() if v}
    assert made.pending == len(data) % made.word.itemsize


@settings(max_examples=40, deadline=None)
@given(data=st.binary(max_size=300))
@BOTH
@pytest.mark.parametrize("encoding", MACHINES)
def test_any_bytes_decode_as_the_machine(encoding, backend, data):
    """Whatever bytes come, both back ends do what the description says."""
    check_machine(encoding, backend, data)


@BOTH
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("encoding", MACHINES)
def test_likely_words_decode_as_the_machine(encoding, backend, seed):
    """Long streams with every kind of word, wraps, resets and addresses outside."""
    check_machine(encoding, backend, likely_words(encoding, seed, 4000))


def identical(a: Events, b: Events) -> None:
    """Everything that a decoder gives is the same."""
    same(a, b)
    for name in ("t", "acceleration", "angular_velocity", "temperature"):
        np.testing.assert_array_equal(getattr(a.imu, name), getattr(b.imu, name))
    assert len(a.frames) == len(b.frames)
    for one, other in zip(a.frames, b.frames):
        np.testing.assert_array_equal(one.pixels, other.pixels)
        assert (one.t_ns, one.end_ns, one.x0, one.y0) == (other.t_ns, other.end_ns, other.x0, other.y0)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 1 << 30),
    cuts=st.lists(st.integers(0, 3000), max_size=6),
    limits=st.lists(st.integers(-1, 1 << 24), max_size=3),
)
@BOTH
@pytest.mark.parametrize("encoding", ALL)
def test_pieces_and_time_cuts_give_what_the_whole_gives(encoding, backend, seed, cuts, limits):
    """Cut anywhere, stopped at any time, resumed: same events, samples, state and counters as numpy on the whole."""
    data = likely_words(encoding, seed, 800)
    whole = decoder(encoding)
    expected = whole.decode(data)
    made = decoder(encoding, backend)
    edges = [0, *sorted(c for c in cuts if c < len(data)), len(data)]
    parts = [Events.empty()]
    for a, b in itertools.pairwise(edges):
        made.feed(data[a:b])
        for limit in limits:
            parts.append(made.decode_until(limit * 1000))
            assert len(parts[-1]) == 0 or int(parts[-1].t.max()) <= limit * 1000
            assert (made.next_t_ns is None) == (not made.at_cut)
        parts.append(made.decode())
    identical(Events.concatenate(parts), expected)
    np.testing.assert_array_equal(made.state, whole.state)
    assert made.counts == whole.counts and made.pending == whole.pending == len(data) % made.word.itemsize


@pytest.mark.parametrize("encoding", WITH_KERNEL)
def test_more_than_one_launch_holds(encoding):
    """The kernel goes on where its scratch was full, whichever of events, triggers and side words fills it."""
    data = likely_words(encoding, 5, 900_000)
    one, other = decoder(encoding), decoder(encoding, "warp")
    identical(other.decode(data), one.decode(data))
    np.testing.assert_array_equal(one.state, other.state)


@BOTH
@pytest.mark.parametrize("encoding", ALL)
def test_resync_keeps_the_turns_and_drops_what_is_half_read(encoding, backend):
    """After a gap nothing pending is left, counters go on, and the time does not start again at 0."""
    data = likely_words(encoding, 2, 3000)
    made = decoder(encoding, backend)
    made.decode(data + b"\x01")
    before, last = dict(made.counts), made.state.copy()
    made.resync()
    assert made.pending == 0 and made.counts == before
    after = made.decode(data)
    assert all(made.counts.get(kind, 0) >= n for kind, n in before.items())
    if encoding in ("evt21", "evt21_legacy", "evt2", "evt3", "evt4", "dvxplorer_mini"):
        assert made.state[2] >= last[2]
        assert len(after) and after.t[0] >= 0
    made.reset()
    assert made.counts == {} and not made.state[0]


def test_unknown_names_are_refused():
    """One line that lists what there is."""
    with pytest.raises(ValueError, match="evt21_legacy"):
        decoder_for("evt9")
    with pytest.raises(ValueError, match="backend"):
        decoder_for("evt3", backend="cuda")
