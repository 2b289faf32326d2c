"""Processes that come at once to record under one name."""

import itertools
import subprocess
import sys
import time
from collections import Counter

import pytest

PROCESSES, NAMES, EVERY_S = 4, 100, 0.02
CLAIM = """
import os, sys, time
from pathlib import Path
from evis.bag import BagError
from evis.bag.mcap.claim import claim

me, folder, names, every_s = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
print("ready", flush=True)
begin = float(sys.stdin.readline())
for k in range(names):
    while time.time() < begin + k * every_s:
        pass
    try:
        os.write(claim(folder / f"{k}.mcap")[0], me.encode())
        print(k, me)
    except BagError as error:
        assert "another run is recording to it" in str(error), error
print("done", flush=True)
sys.stdin.read()
"""
"""It holds what it has got until it is told to end: with it would go its locks."""


@pytest.mark.parametrize("older", [False, True])
def test_one_of_several_that_come_at_once_gets_a_name(older, tmp_path):
    """The others are refused; an older file of that name is put aside once, and what is written lies under the name."""
    if older:
        for k in range(NAMES):
            (tmp_path / f"{k}.mcap").write_bytes(b"older")
    words = [str(tmp_path), str(NAMES), str(EVERY_S)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    runs = [subprocess.Popen([sys.executable, "-c", CLAIM, str(p), *words], **pipes) for p in range(PROCESSES)]
    assert [run.stdout.readline() for run in runs] == ["ready\n"] * PROCESSES
    begin = time.time() + EVERY_S
    for run in runs:
        run.stdin.write(f"{begin}\n")
        run.stdin.flush()
    told = [list(itertools.takewhile(lambda line: line != "done\n", run.stdout)) for run in runs]
    for run in runs:
        run.communicate()
    assert [run.returncode for run in runs] == [0] * PROCESSES
    got = [line.split() for lines in told for line in lines]
    assert Counter(k for k, _ in got) == {str(k): 1 for k in range(NAMES)}
    assert all((tmp_path / f"{k}.mcap").read_text() == me for k, me in got)
    left = {path.name: path.read_bytes() for path in tmp_path.glob("*.bak*")}
    assert left == ({f"{k}.mcap.bak": b"older" for k in range(NAMES)} if older else {})
