"""A cache of compiled kernels as a machine that died has left it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DOUBLES = """
from evis.warp_start import start_warp
start_warp()
import warp as wp

@wp.kernel
def double(values: wp.array(dtype=wp.float32)):
    values[wp.tid()] *= 2.0

values = wp.array([1.0, 3.0], dtype=wp.float32, device="cpu")
wp.launch(double, 2, [values], device="cpu")
print(values.numpy().tolist())
"""
START = """
from evis.warp_start import start_warp
for _ in range(2):
    try:
        start_warp()
    except OSError as error:
        print(error)
"""


def said(folder: Path, program: str) -> str:
    """What the program writes with this cache."""
    path = folder.parent / "program.py"
    path.write_text(program)
    environment = os.environ | {"WARP_CACHE_PATH": str(folder)}
    return subprocess.run([sys.executable, str(path)], env=environment, stdout=subprocess.PIPE, text=True).stdout


def spoil(path: Path, how: str) -> None:
    data = path.read_bytes()
    path.write_bytes({"empty": b"", "cut": data[: len(data) // 2], "zeros": bytes(len(data))}[how])


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache in which one kernel is compiled."""
    folder = tmp_path_factory.mktemp("whole") / "cache"
    assert said(folder, DOUBLES) == "[2.0, 6.0]\n"
    return folder


@pytest.mark.parametrize("ending", ["o", "meta"])
@pytest.mark.parametrize("how", ["empty", "cut", "zeros"])
def test_damaged_kernels_are_compiled_anew(how: str, ending: str, cache: Path, tmp_path: Path) -> None:
    """The file is then what it was, as far as that is the same each time."""
    folder = tmp_path / "cache"
    shutil.copytree(cache, folder)
    (path,) = folder.glob(f"*/wp_*/*.{ending}")
    size = path.stat().st_size
    spoil(path, how)
    assert said(folder, DOUBLES) == "[2.0, 6.0]\n" and path.stat().st_size == size


def test_whole_kernels_are_not_compiled_again(cache: Path) -> None:
    files = [path for path in cache.glob("*/wp_*/*") if path.is_file()]
    before = {path: path.stat().st_mtime_ns for path in files}
    assert said(cache, DOUBLES) == "[2.0, 6.0]\n"
    assert len(files) >= 2 and {path: path.stat().st_mtime_ns for path in files} == before


def test_a_cache_that_cannot_be_made_is_named_as_it_was_given(tmp_path: Path) -> None:
    """Each time: a process that starts early has tried before its nodes do."""
    folder = tmp_path / "cache"
    folder.write_text("")
    first, second = said(folder, START).splitlines()
    assert first == second and str(folder) in first and "WARP_CACHE_PATH" in first
    assert str(next(part for part in first.split() if str(folder) in part)).count("/1.") == 1
