"""Single flipped bits in every real recording and in the made formats: events, or a RecordingError; nothing else.

`pytest -m slow tests/events/damage/test_bit_flips.py` flips EVIS_FUZZ (300) bits in each file, in a process with
limits.
"""

from __future__ import annotations

import os
import resource
from pathlib import Path

import numpy as np
import pytest
from file_cases import save
from real_recordings import DATA
from small_files import CASES, EVENTS, OTHERS

from evis.events import RecordingError, open_recording

REAL = sorted(
    str(path.relative_to(DATA))
    for path in DATA.glob("*/*")
    if path.suffix in (".raw", ".dat", ".es", ".aedat", ".aedat4", ".bag", ".db3", ".bin", ".txt", ".hdf5")
)
LONG = int(os.environ.get("EVIS_FUZZ", "300"))
MEMORY = 4 << 30
"""RLIMIT_AS while a damaged file is read [bytes]."""


@pytest.fixture(autouse=True)
def _limits():
    """No damaged file may ask for gigabytes."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def read(path: Path) -> int:
    """Read all in blocks, and seek; the number of events. Anything but a RecordingError passes on."""
    count = 0
    try:
        with open_recording(path, "numpy") as recording:
            for block in recording.blocks():
                count += len(block)
            recording.seek(0)
            recording.read_until(1000)
            assert recording.next_t_ns is None or isinstance(recording.next_t_ns, int)
    except RecordingError as error:
        assert str(path) in str(error) and "\n" not in str(error), error
    return count


def flipped(data: bytes, rng: np.random.Generator, near: int) -> bytes:
    """One bit turned over, in every second case one of the first `near` bytes or the last, where the headers are."""
    out = bytearray(data)
    at = int(rng.integers(0, len(out)))
    if rng.random() < 0.5:
        at = int(rng.integers(0, min(near, len(out)))) * (1 if rng.random() < 0.5 else -1)
    out[at] ^= 1 << int(rng.integers(0, 8))
    return bytes(out)


def flip_many(name: str, data: bytes, path: Path, many: int) -> None:
    """Read the file with each of `many` bits turned over."""
    for seed in range(many):
        try:
            read(save(path, flipped(data, np.random.default_rng([seed, len(data)]), 4096)))
        except BaseException:
            print(f"{name}: seed {seed}")
            raise


@pytest.mark.parametrize("name", REAL)
def test_flipped_bits_of_real_recordings(name, tmp_path):
    """A few of each."""
    flip_many(name, (DATA / name).read_bytes(), tmp_path / f"a{Path(name).suffix}", 1 if name.endswith(".txt") else 3)


@pytest.mark.parametrize("name", sorted(CASES | OTHERS))
def test_flipped_bits_of_made_files(name, tmp_path):
    """Many: they are small."""
    make, suffix = (CASES | OTHERS)[name]
    flip_many(name, make(tmp_path), tmp_path / f"a{suffix}", 8 if name.startswith("hdf5") else 60)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", REAL)
def test_flipped_bits_at_length(name, tmp_path):
    """Many of each real recording."""
    flip_many(name, (DATA / name).read_bytes(), tmp_path / f"a{Path(name).suffix}", LONG)


def test_a_damaged_archive_gives_what_comes_before(tmp_path):
    """Whatever bit of the packed times is turned over, the events before the damage are those of the file."""
    n = 20_000
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.integers(0, 5000, n))
    np.savez_compressed(tmp_path / "whole.npz", t=t, x=np.arange(n) % 34, y=np.arange(n) % 30, p=np.arange(n) % 2)
    data = bytearray((tmp_path / "whole.npz").read_bytes())
    at = data.index(b"t.npy") + 30_000
    data[at : at + 40] = b"\xff" * 40
    with open_recording(save(tmp_path / "a.npz", bytes(data)), size=(34, 34)) as recording:
        events = recording.read()
    assert recording.info.truncated and any("damaged" in text for text in recording.info.warnings)
    assert 0 < len(events) < n
    sound = len(events) * 9 // 10
    np.testing.assert_array_equal(events.t[:sound], t[:sound])


def test_a_wrong_checksum_is_said(tmp_path):
    """All is there, and a warning says that some of it is wrong."""
    np.savez(tmp_path / "whole.npz", t=EVENTS.t, x=EVENTS.x, y=EVENTS.y, p=EVENTS.p, width=34, height=34)
    data = bytearray((tmp_path / "whole.npz").read_bytes())
    data[data.index(EVENTS.t.tobytes()) + 8] ^= 1
    with open_recording(save(tmp_path / "a.npz", bytes(data))) as recording:
        assert len(recording.read()) == len(EVENTS)
    assert any("CRC" in text for text in recording.info.warnings), recording.info.warnings


def test_mistakes_of_the_program_are_not_hidden(tmp_path, monkeypatch):
    """A lookup that fails in a reader is no fault of the file; a number that cannot be is, and shows its cause."""
    from evis.events.files.es import reader as es

    path = save(tmp_path / "a.es", CASES["es"][0](tmp_path))
    for mistake in (KeyError("x"), IndexError("x"), TypeError("x"), AttributeError("x"), AssertionError("x")):
        monkeypatch.setattr(es.EsDecoder, "decode", lambda self, data, mistake=mistake: (_ for _ in ()).throw(mistake))
        with pytest.raises(type(mistake)), open_recording(path) as recording:
            recording.read()
    fault = OverflowError("too large")
    monkeypatch.setattr(es.EsDecoder, "decode", lambda self, data: (_ for _ in ()).throw(fault))
    with pytest.raises(RecordingError, match=r"a\.es: too large") as refused, open_recording(path) as recording:
        recording.read()
    assert refused.value.__cause__ is fault
