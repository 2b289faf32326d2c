"""Warp starts without remarks about a missing GPU driver, and keeps what it compiles in a folder that is the user's."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

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


UNKNOWN = """
import os, pwd

def unknown(number):
    raise KeyError(f"getpwuid(): uid not found: {number}")

pwd.getpwuid = unknown
"""
"""A user of whom the system has a number alone, as in a container run with --user 12345."""


def run_homeless(code: str, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Runs code in an empty folder as a user without HOME whom the system does not know."""
    gone = ("HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME", "WARP_CACHE_PATH")
    env = {name: value for name, value in os.environ.items() if name not in gone} | variables
    return subprocess.run([sys.executable, "-c", UNKNOWN + code], cwd=folder, env=env, capture_output=True, text=True)


def test_without_a_home_nothing_is_kept_where_the_program_stands(tmp_path: Path) -> None:
    """Warp's own choice is `~/.cache/warp`, which without a home is a folder named `~`."""
    said = run_homeless("from evis.warp_start import start_warp; start_warp()", tmp_path).stderr
    assert said.splitlines()[-1] == (
        f"OSError: compiled kernels cannot be kept: user {os.getuid()} has no home directory: set XDG_CACHE_HOME or "
        "HOME, or WARP_CACHE_PATH"
    )
    assert not list(tmp_path.iterdir())
    doctor = run_homeless("import sys; from evis.cli import main; sys.exit(main(['doctor']))", tmp_path)
    assert doctor.returncode == 1 and "RuntimeError" not in doctor.stdout and "Traceback" not in doctor.stderr
    assert f"what a run cannot print is lost: user {os.getuid()} has no home directory" in doctor.stdout
    assert not list(tmp_path.iterdir())


def test_a_named_folder_does_for_a_user_without_a_home(tmp_path: Path) -> None:
    code = """
from evis.warp_start import start_warp
from nodes.interpolator.auto import cache
start_warp()
import warp
print(warp.config.kernel_cache_dir)
try:
    print(cache.cache_folder())
except OSError as error:
    print(error)
"""
    kept = str(tmp_path / "kept")
    lines = run_homeless(code, tmp_path, WARP_CACHE_PATH=kept).stdout.splitlines()
    assert lines[0].startswith(kept) and "no home directory: set XDG_CACHE_HOME or HOME" in lines[1]
    lines = run_homeless(code, tmp_path, XDG_CACHE_HOME=kept).stdout.splitlines()
    assert lines[0].startswith(f"{kept}/warp/") and lines[1] == f"{kept}/evis/auto"


def test_a_second_start_names_the_same_folder(tmp_path: Path) -> None:
    """Warp took the folder that it could not make for the parent of one, and said `1.19.0/1.19.0`."""
    (tmp_path / "file").write_text("")
    code = """
from evis.warp_start import start_warp
for _ in range(3):
    try:
        start_warp()
    except OSError as error:
        print(error)
"""
    env = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "file")}
    said = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True).stdout.splitlines()
    assert len(said) == 3 and len(set(said)) == 1
