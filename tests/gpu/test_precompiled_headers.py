"""Headers that a machine compiles once: who compiles them, and that kernels are the same without."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

COMPILES = """
import json, sys, threading
import numpy as np, warp as wp
from warp._src import build

calls, plain = [], build.build_cpu
def counted(obj_path, cpp_path, *args, **options):
    calls.append(str(cpp_path).endswith("headers.cpp"))
    return plain(obj_path, cpp_path, *args, **options)
build.build_cpu = counted

from evis.warp_headers import kept_headers, share_headers
from evis.warp_start import start_warp
start_warp()
share_headers()

def scaled(factor):
    @wp.kernel(module="unique", enable_backward=False)
    def kernel(values: wp.array(dtype=wp.float32)):
        values[wp.tid()] *= wp.static(factor)
    return kernel

def work(factor):
    values = wp.array([1.0, 2.0], dtype=wp.float32, device="cpu")
    wp.launch(scaled(factor), 2, [values], device="cpu")
    found[factor] = values.numpy().tolist()

found = {}
threads = [threading.Thread(target=work, args=[float(word)]) for word in sys.argv[1:]]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print(json.dumps([sum(calls), len(calls) - sum(calls), found, str(kept_headers())]))
"""


def compiled(folder: Path, *factors: float) -> tuple[int, int, dict[str, list[float]], Path]:
    """How often headers and kernels were compiled by a process with this cache, what the kernels gave, where it is."""
    program = folder / "compiles.py"
    program.write_text(COMPILES)
    command = [sys.executable, str(program), *map(str, factors)]
    out = subprocess.run(
        command, env=os.environ | {"XDG_CACHE_HOME": str(folder)}, capture_output=True, text=True, check=True
    )
    headers, kernels, found, kept = json.loads(out.stdout)
    return headers, kernels, found, Path(kept)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache in which one process has compiled three kernels, in three threads."""
    folder = tmp_path_factory.mktemp("cache")
    headers, kernels, found, _ = compiled(folder, 2.0, 3.0, 4.0)
    assert (headers, kernels) == (1, 3)
    assert found == {"2.0": [2, 4], "3.0": [3, 6], "4.0": [4, 8]}
    return folder


def test_threads_and_processes_share_headers(cache: Path) -> None:
    headers, kernels, found, kept = compiled(cache, 5.0)
    assert (headers, kernels, found) == (0, 1, {"5.0": [5, 10]})
    (path,) = kept.glob("*.pch")
    assert path.stat().st_size > 1_000_000
    assert {other.name for other in kept.iterdir()} == {path.name, "lock"}


@pytest.mark.parametrize("spoiled", ["no folder", "noise"])
def test_kernels_do_without(cache: Path, tmp_path: Path, spoiled: str) -> None:
    """Where headers cannot be kept, or what is kept is none."""
    shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
    (path,) = tmp_path.glob("**/*.pch")
    if spoiled == "noise":
        path.write_bytes(os.urandom(10_000))
    else:
        shutil.rmtree(path.parent)
        path.parent.write_text("")
    assert compiled(tmp_path, 7.0)[2] == {"7.0": [7, 14]}
