"""A disk that is soon full, mounted for one command."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

MOUNT = "mount -t tmpfs -o size={size}k tmpfs {place}"


def on_a_small_disk(place: Path, size: int, command: str) -> subprocess.CompletedProcess[str]:
    """Runs a shell command with a disk of so many kB at a place, which goes with it. Skips where nobody may mount."""
    if shutil.which("unshare") is None:
        pytest.skip("needs unshare, to mount a small disk")
    place.mkdir()
    mount = MOUNT.format(size=size, place=shlex.quote(str(place)))
    if subprocess.run(["unshare", "-rm", "sh", "-c", mount], capture_output=True).returncode:
        pytest.skip("a small disk cannot be mounted here")
    shell = ["unshare", "-rm", "sh", "-c", f"{mount} && {command}"]
    return subprocess.run(shell, capture_output=True, text=True, timeout=300)
