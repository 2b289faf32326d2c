"""EVT2.1 in both word orders; gaps and unknown words in all Prophesee encodings."""

from __future__ import annotations

import numpy as np
import pytest
from stream_cases import random_events, same, sha256_us

from evis.events import Events
from evis.events.codecs.decoder import decoder_for
from evis.events.codecs.encoder import encoder_for
from evis.events.files.prophesee.raw_header import read_header

BOTH = pytest.mark.parametrize("backend", ["numpy", "warp"])
REAL = "derived/hd_from_evt3_sample_evt21_little.raw"


def words_of(path) -> bytes:
    with path.open("rb") as file:
        read_header(file)
        return file.read()


def swapped(data: bytes) -> bytes:
    return np.frombuffer(data, "<u4").reshape(-1, 2)[:, ::-1].tobytes()


@BOTH
@pytest.mark.parametrize("encoding", ["evt21", "evt21_legacy"])
def test_recording_gives_the_hash_of_other_readers(encoding, backend, truth, recording_path):
    """60,000 events of an HD sensor; in legacy order the halves of each word are exchanged."""
    data = words_of(recording_path(REAL))
    decoder = decoder_for(encoding, 1280, 720, backend)
    events = decoder.decode(data if encoding == "evt21" else swapped(data))
    assert (len(events), sha256_us(events)) == (truth[REAL]["n"], truth[REAL]["sha256"])
    assert decoder.counts == {}


@BOTH
def test_masks_triggers_and_addresses_outside(backend):
    """Bit i of the mask is the pixel i right of the base; the trigger's fields are in the upper half."""
    words = [
        8 << 60 | 2 << 32,
        1 << 60 | 3 << 54 | 1270 << 43 | 9 << 32 | 0x80000401,
        10 << 60 | 5 << 54 | 17 << 40 | 1 << 32,
    ]
    words += [5 << 60, 1 << 60 | 720 << 32 | 0xF]
    decoder = decoder_for("evt21", 1280, 720, backend)
    events = decoder.decode(np.array(words, np.uint64).tobytes())
    assert (events.t.tolist(), events.x.tolist()) == ([131_000], [1270])
    edges = events.triggers
    assert (edges.t.tolist(), edges.id.tolist(), edges.value.tolist()) == ([133_000], [17], [1])
    assert decoder.counts == {"outside": 6, "unknown": 1}


@BOTH
def test_dense_rows_share_words(backend):
    """32 neighbours of one time take one word."""
    events = Events.of(np.full(64, 5000), np.tile(np.arange(64, 96), 2), np.repeat([9, 10], 32), np.ones(64, np.uint8))
    data = encoder_for("evt21").encode(events)
    assert np.frombuffer(data, "<u8").tolist() == [
        8 << 60,
        1 << 60 | 5 << 54 | 64 << 43 | 9 << 32 | 0xFFFFFFFF,
        1 << 60 | 5 << 54 | 64 << 43 | 10 << 32 | 0xFFFFFFFF,
    ]
    same(decoder_for("evt21", 640, 480, backend).decode(data), events)
    assert encoder_for("evt21_legacy").encode(events) == swapped(data)


@BOTH
@pytest.mark.parametrize(("encoding", "bits"), [("evt3", 24), ("evt2", 34), ("evt21", 34), ("evt21_legacy", 34)])
def test_turns_go_on_over_a_gap(encoding, bits, backend):
    """`resync` waits for the next TIME_HIGH and counts a turn that the gap hides; `reset` starts at turn 0."""
    turn = (1 << bits) * 1000
    early = random_events(1, 20, start_us=int(1.9 * (1 << bits)))
    late = random_events(2, 20, start_us=int(2.1 * (1 << bits)))
    encoder = encoder_for(encoding)
    one = encoder.encode(early)
    two = encoder_for(encoding).encode(late)
    word = decoder_for(encoding).word.itemsize
    # the late stream alone starts with the TIME_HIGH words that count out its turns: only the last of them was seen
    kind = np.frombuffer(two, decoder_for(encoding).word)
    highs = _time_highs(kind, encoding)
    lead = int(np.argmax(~highs)) - 1
    decoder = decoder_for(encoding, 640, 480, backend)
    same(decoder.decode(one), early)
    decoder.feed(one[: word - 1])
    decoder.resync()
    cut = two[lead * word :]
    same(decoder.decode(cut), late)
    decoder.reset()
    alone = decoder.decode(cut)
    np.testing.assert_array_equal(alone.t, late.t - 2 * turn)


def _time_highs(words: np.ndarray, encoding: str) -> np.ndarray:
    if encoding == "evt21_legacy":
        return words >> np.uint64(28) & np.uint64(15) == 8
    return words >> np.asarray(words.dtype.itemsize * 8 - 4, words.dtype) == 8


@BOTH
def test_words_of_no_known_type_are_counted(backend):
    """Reserved types are counted, system words (OTHERS, CONTINUED) are not."""
    decoder = decoder_for("evt3", 640, 480, backend)
    decoder.decode(np.array([0x1000, 0x8001, 0x1000, 0x9000, 0xB000, 0xC000, 0xD000, 0x7000, 0xE000, 0xF000], "<u2"))
    assert decoder.counts == {"untimed": 1, "unknown": 5}
    decoder = decoder_for("evt2", 640, 480, backend)
    decoder.decode(np.array([k << 28 for k in [8, 2, 3, 4, 5, 6, 7, 9, 11, 12, 13, 14, 15]], "<u4"))
    assert decoder.counts == {"unknown": 10}
