"""Warp's native part writes about a missing GPU driver straight to stderr; nobody asked."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import os, sys
from evis.warp_start import start_warp
assert "warp" not in sys.modules
os.environ["CUDA_VISIBLE_DEVICES"] = ""
start_warp()
start_warp()
import warp as wp
assert wp.get_device("cpu").is_cpu
print("still there", file=sys.stderr)
"""


def test_start_says_nothing_and_gives_stderr_back():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0 and done.stderr == "still there\n" and done.stdout == ""


def test_the_limit_of_inlining_is_raised() -> None:
    """Where Warp had another limit than the one that is replaced, all would run on, and more slowly."""
    script = "from evis.warp_start import start_warp; start_warp(); import warp; print(warp.config.cpu_compiler_flags)"
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert "-inline-threshold=40000" in said and "-march=native" in said
