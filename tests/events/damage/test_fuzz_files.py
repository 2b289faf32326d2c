"""Damaged, spliced and invented files: events of the right types and range, or a RecordingError; never anything else.

`pytest -m slow tests/events/damage/test_fuzz_files.py` runs EVIS_FUZZ (20000) inputs for each format.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from file_cases import save
from file_damage import check, damage
from hypothesis import given, settings
from hypothesis import strategies as st
from small_files import CASES, OTHERS

FILES = CASES | OTHERS
LONG = int(os.environ.get("EVIS_FUZZ", "20000"))
MAGICS = [
    b"% ", b"% Data file", b"PK\x03\x04", b"#!AER-DAT2.0\r\n", b"#!AER-DAT3.1\r\n", b"#!AER-DAT4.0\r\n",
    b"Event Stream\x02\x00\x00\x01", b"#ROSBAG V2.0\n", b"SQLite format 3\x00", b"\x89MCAP0\r\n", b"0.1 1 1 1\n", b"",
]  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The undamaged bytes of each format."""
    made: dict[str, bytes] = {}

    def get(name: str) -> bytes:
        if name not in made:
            made[name] = FILES[name][0](tmp_path_factory.mktemp("whole"))
        return made[name]

    return get


@pytest.mark.parametrize("name", [n for n in FILES if not n.startswith("hdf5")])
@settings(max_examples=120, deadline=None)
@given(seed=st.integers(0, 2**63))
def test_damaged_files(name, whole, tmp_path_factory, seed):
    """A few edits of a good file."""
    folder = tmp_path_factory.getbasetemp()
    check(save(folder / f"fuzz{FILES[name][1]}", damage(whole(name), np.random.default_rng(seed))))


@settings(max_examples=600, deadline=None)
@given(magic=st.sampled_from(MAGICS), data=st.binary(max_size=400))
def test_invented_files(magic, data, tmp_path_factory):
    """Any bytes behind each signature."""
    check(save(tmp_path_factory.getbasetemp() / "invented", magic + data or b"\0"))


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", [n for n in FILES if not n.startswith("hdf5")])
def test_damaged_files_at_length(name, whole, tmp_path):
    """Many inputs, none of which may take long."""
    slowest, data = 0.0, whole(name)
    for seed in range(LONG):
        broken = damage(data, np.random.default_rng([seed, len(data)]))
        start = time.process_time()
        try:
            check(save(tmp_path / f"a{FILES[name][1]}", broken))
        except BaseException:
            print(f"{name}: seed {seed}")
            raise
        slowest = max(slowest, time.process_time() - start)
    assert slowest < 5


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", ["hdf5 ecf", "hdf5 plain"])
def test_damaged_hdf5_at_length(name, whole, tmp_path):
    """In processes of their own, as the HDF5 library itself crashes or hangs on some: never where we call it."""
    (tmp_path / "whole.h5").write_bytes(whole(name))
    code = (
        "import sys, pathlib, numpy as np\n"
        "sys.path.insert(0, sys.argv[1])\n"
        "from file_damage import check, damage\n"
        "folder, first, last = pathlib.Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])\n"
        "data = (folder / 'whole.h5').read_bytes()\n"
        "for seed in range(first, last):\n"
        "    (folder / 'seed').write_text(str(seed))\n"
        "    (folder / 'a.h5').write_bytes(damage(data, np.random.default_rng(seed)))\n"
        "    check(folder / 'a.h5')\n"
    )
    first, deaths = 0, 0
    while first < LONG // 10:
        last = min(first + 200, LONG // 10)
        arguments = [sys.executable, "-c", code, str(Path(__file__).parents[1]), str(tmp_path), str(first), str(last)]
        try:
            done = subprocess.run(arguments, capture_output=True, text=True, timeout=1200)
            assert done.returncode <= 0, done.stderr
            died = done.returncode < 0
        except subprocess.TimeoutExpired:
            died = True
        deaths += died
        first = int((tmp_path / "seed").read_text()) + 1 if died else last
    assert deaths == 0
