"""A disk that is really full: one line, nothing half-written, and --resume goes on elsewhere."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from in_this_process import InThisProcess
from small_disk import on_a_small_disk
from small_recipe import checksums, write

from evis.dataset.layouts.npz.growing_npy import GrowingNpy
from evis.dataset.making.make import make
from evis.dataset.recipe_file import read_recipe


@pytest.mark.parametrize(("layout", "batch"), [("npz", 2), pytest.param("dsec", 1, marks=pytest.mark.slow)])
def test_a_full_disk_ends_the_run_in_one_line(layout: str, batch: int, tmp_path: Path) -> None:
    """What was there is whole, and the whole data set comes of it where there is room."""
    path = write(tmp_path, ("layout: npz", f"layout: {layout}\nlabels: [forward_flow]"))
    recipe, disk, kept, whole = read_recipe(path), tmp_path / "disk", tmp_path / "kept", tmp_path / "whole"
    make(recipe, str(whole), InThisProcess)
    room = sum(4 * -(-file.stat().st_size // 4096) for file in whole.rglob("*") if file.is_file())
    words = ["dataset", "make", str(path), "--workers", "1", "--batch", str(batch), "--out", str(disk / "d")]
    command = shlex.join([sys.executable, "-m", "evis", *words])
    done = on_a_small_disk(disk, room * 7 // 10, f"({command}; status=$?; cp -r {disk}/d {kept}; exit $status)")
    assert done.returncode == 1, done.stderr
    told = [line for line in done.stderr.splitlines() if line.startswith("evis")]
    assert len(told) == 1 and "No space left on device" in told[0] and "--resume goes on" in told[0]
    assert "Traceback" not in done.stderr
    assert 1 <= len(list(kept.glob("*/*/sequence.json"))) < 5 and not list(kept.glob("*/.*"))
    before = {name: digest for name, digest in checksums(kept).items() if name.count("/")}
    assert make(recipe, str(kept), InThisProcess, resume=True).there == 5
    assert before.items() <= checksums(kept).items() and checksums(kept) == checksums(whole)


def test_an_array_that_the_disk_refuses_is_named(tmp_path: Path) -> None:
    """While it grows, and at its end; /dev/full refuses all that is written to it."""
    path = tmp_path / "t.npy"
    path.symlink_to("/dev/full")
    for rows in (np.zeros((1 << 20, 2)), np.zeros((1, 2))):
        file = GrowingNpy(path, (2,), np.dtype(np.float64))
        with pytest.raises(OSError, match=r"No space left on device: '.*/t\.npy'"):
            file.append(rows)
            file.close()
