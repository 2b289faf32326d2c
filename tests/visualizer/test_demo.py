"""`python -m evis.demo` from nothing: the files, what they show, and the bag in `evis view`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The demo's folder and what it printed."""
    out = tmp_path_factory.mktemp("demo")
    done = subprocess.run(
        [sys.executable, "-m", "evis.demo", "--out", str(out), "--duration", "0.2"],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return out, done.stdout


def test_demo_makes_its_files(made: tuple[Path, str]) -> None:
    out, text = made
    summary = json.loads((out / "summary.json").read_text())
    assert summary["sim_s"] == 0.2 and summary["drops"] == 0
    for part in (f"{summary['events']:,} events", "times real time", "mujoco: ", "labeler: ", "spinning_disk.gif"):
        assert part in text


def test_animation_shows_motion_on_the_disk_only(made: tuple[Path, str]) -> None:
    """The events' half changes, near the middle; the corners of the still world stay dark."""
    out, _ = made
    with Image.open(out / "spinning_disk.gif") as gif:
        assert gif.n_frames == 41  # 200 ms at one picture per 5 ms, both ends
        sheets = []
        for k in (5, 15, 25):
            gif.seek(k)
            sheets.append(np.asarray(gif.convert("RGB")).astype(int)[6:266, 6 + 346 + 6 :][:, :346])
    moved = np.abs(sheets[2] - sheets[0]).max(axis=-1) > 60
    assert moved[60:200, 100:250].mean() > 0.05
    assert max(s[:20, :20].max() for s in sheets) < 40


def test_still_is_there(made: tuple[Path, str]) -> None:
    with Image.open(made[0] / "spinning_disk.png") as image:
        assert image.size == (2 * (6 + 346 + 6 + 346 + 6), 2 * (6 + 260 + 20))
        assert np.asarray(image).std() > 20


def test_view_plays_the_bag_once(made: tuple[Path, str]) -> None:
    bag = made[0] / "spinning_disk.mcap"
    done = subprocess.run(
        [sys.executable, "-m", "evis", "view", str(bag), "--once", "--port", "0"],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("http://127.0.0.1:") and len(done.stdout.splitlines()) == 1


def test_demo_that_cannot_write_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = subprocess.run(
        [sys.executable, "-m", "evis.demo", "--out", str(tmp_path / "file" / "demo")],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
