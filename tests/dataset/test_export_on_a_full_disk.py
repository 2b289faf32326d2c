"""`evis bag export --layout` on a disk that is full: one line that names the folder, and nothing is left."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_disk import on_a_small_disk

from evis.bag import BagError
from evis.bag.writer import BagWriter
from evis.dataset.bag_sequence import export
from evis.dataset.layouts import LayoutError
from msgs.camera import CameraInfo, EventPacket
from msgs.header import Header


def bag(path: Path, episodes: int = 1) -> Path:
    """A bag of a camera's events, which no layout makes small."""
    rng, n = np.random.default_rng(0), 20_000
    with BagWriter(path) as writer:
        info = CameraInfo(Header(0), k=np.array([[90.0, 0, 32], [0, 90, 24], [0, 0, 1]]), distortion=np.zeros(5))
        info.width, info.height, info.keyframe_rate = 64, 48, 30.0
        writer.write("/cam0/info", info)
        for k in range(episodes):
            t = np.sort(rng.integers(0, 10**7, n)) + k * 10**7
            x, y = rng.integers(0, 64, n).astype(np.uint16), rng.integers(0, 48, n).astype(np.uint16)
            packet = EventPacket(Header((k + 1) * 10**7, k, episode=k), np.array([0, n]), t, x, y)
            packet.p = rng.integers(0, 2, n).astype(np.uint8)
            packet.width, packet.height, packet.t0_ns = 64, 48, k * 10**7
            writer.write("/cam0/events", packet)
    return path


@pytest.mark.parametrize("layout", ["dsec", "mvsec", "npz"])
@pytest.mark.parametrize("there", [True, False])
def test_one_line_and_nothing_is_left(tmp_path: Path, layout: str, there: bool) -> None:
    """HDF5 itself ends the process where it cannot write what it still holds."""
    disk, path = tmp_path / "disk", bag(tmp_path / "a.mcap")
    out = disk / "out"
    command = shlex.join([sys.executable, "-m", "evis", "bag", "export", str(path), "--layout", layout, str(out)])
    made = f"mkdir {out} && " if there else ""
    done = on_a_small_disk(disk, 24, f"({made}{command}; status=$?; ls -R {disk}; exit $status)")
    assert done.returncode == 1, done.stderr
    told = done.stderr.splitlines()
    assert len(told) == 1 and told[0].startswith(f"evis bag: {out}: No space left on device; nothing is left of it")
    assert done.stdout.split() == ([f"{disk}:", "out", f"{out}:"] if there else [f"{disk}:"])


@pytest.mark.parametrize("layout", ["dsec", "npz"])
def test_a_limit_of_file_sizes_is_told_as_a_full_disk(tmp_path: Path, layout: str) -> None:
    """HDF5 tells of it in its text alone."""
    path, out = bag(tmp_path / "a.mcap"), tmp_path / "out"
    words = [sys.executable, "-m", "evis", "bag", "export", str(path), "--layout", layout, str(out)]
    done = subprocess.run(["prlimit", "--fsize=20000", *words], capture_output=True, text=True)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith(f"evis bag: {out}: File too large; nothing is left of it")
    assert "(ulimit -f)" in done.stderr and not out.exists()


def test_what_a_layout_cannot_hold_leaves_nothing(tmp_path: Path) -> None:
    """It is found in the middle of the bag. A folder with files of the user's is not touched."""
    path, out = bag(tmp_path / "a.mcap", episodes=2), tmp_path / "out"
    with pytest.raises(LayoutError, match="several episodes"):
        export(path, "npz", out)
    assert not out.exists()
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    with pytest.raises((LayoutError, BagError), match="not empty"):
        export(path, "npz", out)
    assert (out / "mine.txt").read_text() == "mine"
