"""Hostile bytes for every decoder: no crash, no hang, nothing read or written beyond, numpy and kernel alike.

The quick run takes a few thousand inputs. The long one (`pytest -m slow tests/events/codecs/test_fuzz_codec.py`) takes
EVIS_FUZZ_INPUTS of them (1,000,000 unless given) spread over all decoders and prints how many.
"""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from both_decoders import SIZES, run
from codec_cases import ALL, MESSAGES, WIRE, encoder, stream
from hypothesis import given, settings
from hypothesis import strategies as st
from likely_words import likely_words

PARTS = st.lists(st.one_of(st.binary(max_size=40), st.integers(0, 1 << 20)), max_size=6)


def material(encoding: str) -> list[bytes]:
    """What inputs are made of: whole streams, likely words."""
    if encoding in MESSAGES:
        valid = [encoder(encoding).encode_packets(stream(encoding, seed, 60))[0][1] for seed in range(4)]
    else:
        valid = [encoder(encoding).encode(stream(encoding, seed, 60, triggers=5)) for seed in range(4)]
    return valid + [likely_words(encoding, seed, 80) for seed in range(4)]


def mutate(rng: np.random.Generator, pool: list[bytes]) -> bytes:
    """A piece of the pool with bytes changed, removed, doubled, or with another piece behind it."""
    data = bytearray(pool[rng.integers(len(pool))])
    a, b = sorted(rng.integers(0, len(data) + 1, 2))
    data = data[a : min(b, a + 160)]
    for _ in range(rng.integers(0, 4)):
        if data:
            at = int(rng.integers(len(data)))
            data[at] = int(rng.choice([0, 0x7F, 0x80, 0xFF, rng.integers(256)]))
    kind = rng.integers(4)
    if kind == 0 and data:
        del data[int(rng.integers(len(data)))]
    elif kind == 1:
        data += data[: int(rng.integers(0, 40))]
    elif kind == 2:
        data += rng.bytes(int(rng.integers(0, 24)))
    return bytes(data)


@settings(max_examples=120, deadline=None)
@given(parts=PARTS, size=st.sampled_from(SIZES), limit=st.integers(-10, 1 << 40), gap=st.integers(0, 8))
@pytest.mark.parametrize("encoding", ALL)
def test_any_pieces(encoding, parts, size, limit, gap):
    """Bytes that hypothesis makes up, with valid streams among them."""
    pool = material_of(encoding)
    pieces = [p if isinstance(p, bytes) else mutate(np.random.default_rng(p), pool) for p in parts]
    run(encoding, size, pieces, limit, gap)


_POOLS: dict[str, list[bytes]] = {}


def material_of(encoding: str) -> list[bytes]:
    if encoding not in _POOLS:
        _POOLS[encoding] = material(encoding)
    return _POOLS[encoding]


def campaign(encoding: str, inputs: int, seed: int = 0) -> int:
    """Mutated inputs for one decoder pair: the number of inputs, each decoded by numpy and by the kernel."""
    rng, pool = np.random.default_rng(seed), material_of(encoding)
    for batch in itertools.count():
        done = batch * 4
        if done >= inputs:
            return done
        pieces = [mutate(rng, pool) for _ in range(4)]
        limit = int(rng.integers(-10, 1 << 34)) if batch % 4 == 0 else None
        run(encoding, SIZES[rng.integers(4)], pieces, limit, int(rng.integers(0, 8)))
    return 0


@pytest.mark.parametrize("encoding", ALL)
def test_mutated_streams(encoding):
    """A few hundred damaged streams for each decoder."""
    assert campaign(encoding, 200) >= 200


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_a_million_mutated_streams(capsys):
    """The long run over all decoders."""
    inputs = int(os.environ.get("EVIS_FUZZ_INPUTS", "1000000"))
    total = sum(campaign(encoding, -(-inputs // len(ALL)), seed=1) for encoding in ALL)
    with capsys.disabled():
        print(f"\n{total} inputs over {len(ALL)} decoders, each by numpy and by the kernel where there is one")
    assert total >= inputs and len(WIRE) + len(MESSAGES) == len(ALL)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("encoding", ALL)
def test_coverage_guided(encoding, tmp_path):
    """Atheris, EVIS_ATHERIS_INPUTS (20,000) for each decoder, from the same material."""
    pytest.importorskip("atheris")
    for i, data in enumerate(material_of(encoding)):
        (tmp_path / str(i)).write_bytes(bytes(14) + data[:400])
    inputs = os.environ.get("EVIS_ATHERIS_INPUTS", "20000")
    script = [sys.executable, str(Path(__file__).with_name("fuzz_atheris.py")), encoding, f"-runs={inputs}"]
    done = subprocess.run([*script, "-max_len=600", "-timeout=20", str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0 and f"Done {inputs} runs" in done.stderr, done.stderr[-2000:]
