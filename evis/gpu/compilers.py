"""Compiles a GPU's kernels in processes beside this one, a thread's in its own.

NVIDIA's compiler NVRTC lets the threads of a process take turns for most of its work: of 16 threads that compile the
kernels of a scene three are busy. In processes of their own all are. What they make is the same, to the byte.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

FUNCTION = "wp_cuda_compile_program"
"""Warp's native function that compiles a program, after which nothing but a file is left."""
AHEAD = 2
"""Threads that write source at once. Warp's generator has one lock, which threads get in any order: with all of a
scene's before it the program that takes longest waited for most others."""
FEWEST_CORES = 4
"""With less, processes would gain little, and each takes 100 to 300 MB while it works."""
NAMES = {ctypes.c_char_p: "text", ctypes.c_int: "int", ctypes.c_size_t: "size", ctypes.c_bool: "bool"}
"""Names of the types of arguments, as `compiler_process` has them."""


class Compiler:
    """Holds the process that compiles for one thread, which `close` ends."""

    def __init__(self, library: str) -> None:
        """Starts the process. library: path of Warp's native part."""
        beside = str(Path(__file__).with_name("compiler_process.py"))
        self.owner = os.getpid()
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", beside, library, FUNCTION], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        atexit.register(self.close)

    def ask(self, line: bytes) -> int | None:
        """Has a program compiled, and returns what the function did; None where the process has ended before."""
        asked, answers = self._process.stdin, self._process.stdout
        assert asked is not None and answers is not None
        try:
            asked.write(line)
            asked.flush()
            answer = answers.readline()
        except OSError:
            return None
        return int(answer) if answer.endswith(b"\n") else None

    def close(self) -> None:
        """Ends the process, also in the middle of its work."""
        atexit.unregister(self.close)
        if self.owner != os.getpid():
            return
        # What it was at is a file of no name yet.
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self._process.wait()


class Compilers(threading.local):
    """Holds each thread's compiler, made when it is first needed."""

    def __init__(self) -> None:
        self._own: Compiler | None = None

    def ask(self, library: str, line: bytes) -> int | None:
        """Has a program compiled; None where no process does it."""
        # One that has had nothing to do has ended meanwhile.
        for _ in range(2):
            try:
                if self._own is None or self._own.owner != os.getpid():
                    self._own = Compiler(library)
                found = self._own.ask(line)
            except OSError:  # no process, or no memory for one
                return None
            if found is not None:
                return found
            self._own.close()
            self._own = None
        return None


_compilers = Compilers()


class _Turns(threading.local):
    """Tells whether a thread has one of the places ahead of the compiler."""

    def __init__(self) -> None:
        self.held = False


_ahead, _turns = threading.Semaphore(AHEAD), _Turns()


@contextlib.contextmanager
def ahead_of_compiler() -> Iterator[None]:
    """Has a thread that is about to compile a module wait until few others write source; its turn ends where the
    compiler begins with what it has written."""
    _ahead.acquire()
    _turns.held = True
    try:
        yield
    finally:
        _end_turn()


def _end_turn() -> None:
    if _turns.held:
        _turns.held = False
        _ahead.release()


@cache
def share_compilers() -> None:
    """Has Warp compile a GPU's kernels in other processes, where there are cores for them."""
    from warp._src import context  # private, as in evis.warp_headers

    core: Any = context.runtime.core  # type: ignore[attr-defined]
    alone: Callable[..., int] = getattr(core, FUNCTION)
    types: list[Any] = list(alone.argtypes)  # type: ignore[attr-defined]

    def compile_program(*given: Any) -> int:
        _end_turn()
        if len(os.sched_getaffinity(0)) >= FEWEST_CORES and (line := line_of(types, given)) is not None:
            found = _compilers.ask(core._name, line)
            if found is not None:
                return found
        return alone(*given)

    setattr(core, FUNCTION, compile_program)


def line_of(types: list[Any], given: tuple[Any, ...]) -> bytes | None:
    """Writes arguments as a line for a compiler; None where they hold what no line can, as parts to be linked."""
    names, values = [], []
    for kind, value in zip(types, given, strict=True):
        if kind in NAMES:
            names.append(NAMES[kind] if value is not None else "none")
            values.append(value.decode("utf-8") if isinstance(value, bytes) else value)
        elif value is None or len(value) == 0:
            names.append("none")
            values.append(None)
        else:
            return None
    return json.dumps({"types": names, "values": values}).encode("ascii") + b"\n"
