"""Compiles the headers that every kernel of a CPU includes once for a machine instead of once for each thread.

Warp's compiler reads them compiled already (clang's precompiled headers, 5 MB) but makes these anew for each thread of
each process that compiles anything: 1.2 to 3 s before the first kernel, where a kernel by itself takes a quarter of a
second to some seconds. Here they are kept beside Warp's cache of kernels, and a thread begins with a copy.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import warp as wp
from warp._src import build  # nothing public names this folder; pyproject.toml bounds Warp to the versions that have it

ENDING = ".pch"
INCLUDES = b'#include "builtin.h"'
"""The line of a kernel's source up to which its text decides how the headers are compiled."""

Compiler = Callable[..., Any]


@cache
def share_headers() -> None:
    """Has Warp's compiler of kernels for a CPU begin with headers that are compiled already."""
    compiler = build.build_cpu

    def build_cpu(obj_path: str, cpp_path: str, *args: Any, **options: Any) -> Any:
        folder = options.get("pch_dir")
        if folder and options.get("use_precompiled_headers"):
            with contextlib.suppress(OSError):  # no room, or no right to write: it makes its own as ever
                _put_headers(Path(folder), Path(cpp_path), lambda *paths: compiler(*paths, *args, **options))
        return compiler(obj_path, cpp_path, *args, **options)

    build.build_cpu = build_cpu


def kept_headers() -> Path:
    """Returns the folder of this installation of Warp's compiled headers, which fit no other."""
    native = Path(wp.__file__).with_name("native") / "builtin.h"
    of_install = f"{native}\n{native.stat().st_mtime_ns}".encode()
    return Path(str(wp.config.kernel_cache_dir)) / f"headers_{hashlib.sha256(of_install).hexdigest()[:16]}"


def _put_headers(folder: Path, source: Path, compile_: Compiler) -> None:
    """Puts compiled headers into a thread's folder, which has none yet; makes them where nobody has."""
    if _in(folder):
        return
    kept = kept_headers()
    if not _in(kept):
        kept.mkdir(parents=True, exist_ok=True)
        with open(kept / "lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # whoever comes second waits, and finds them
            if not _in(kept):
                _make(folder, source, compile_)
                for path in _in(folder):
                    _keep(path, kept)
                return
    for path in _in(kept):
        shutil.copyfile(path, folder / path.name)


def _make(folder: Path, source: Path, compile_: Compiler) -> None:
    """Compiles nothing but what a source includes, which leaves its headers in a thread's folder."""
    text = source.read_bytes()
    end = text.find(INCLUDES)
    if end >= 0:
        alone = folder / "headers.cpp"
        alone.write_bytes(text[: end + len(INCLUDES)] + b"\n")
        compile_(str(folder / "headers.o"), str(alone))


def _in(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"*{ENDING}"))


def _keep(path: Path, folder: Path) -> None:
    """Copies a file so that who looks meanwhile sees all of it or nothing."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=path.name, delete=False) as out:
        try:
            with open(path, "rb") as source:
                shutil.copyfileobj(source, out)
            out.flush()
            os.fsync(out.fileno())  # a file cut short by a power failure would be found and refused by every compiler
            os.replace(out.name, folder / path.name)
        except BaseException:
            os.unlink(out.name)
            raise
