"""A recipe of five sequences of 0.1 s, and how its data sets are compared."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

RECIPE = """\
layout: npz
sequences: 5
duration: 0.1
sampling: latin
splits: {train: 0.6, test: 0.4}
arguments: {width: 32, height: 24, shot_rate: 3.0}
scenes:
  spinning_disk:
    arguments:
      omega: {from: 15, to: 70}
      texture: {choices: [0, 1]}
"""


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    """Writes the recipe into a folder, with texts in it replaced."""
    text = RECIPE
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    path = folder / "small.yaml"
    path.write_text(text)
    return path


def checksums(folder: Path) -> dict[str, str]:
    """Path below a data set -> checksum, of all files but what `show` draws."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def evis(*words: object, status: int = 0) -> subprocess.CompletedProcess[str]:
    """Runs the command line to its end."""
    command = [sys.executable, "-m", "evis", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == status, done.stderr
    return done
