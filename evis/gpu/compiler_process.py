"""Compiles a GPU's kernels for another process: see `evis.gpu.compilers`.

It is started as a file, not as a module, and imports nothing but what Python has, so that it is there in 0.05 s.

    python -I compiler_process.py LIBRARY FUNCTION

Each line of its input is a JSON object with the function's arguments, of which `types` tells the kinds; it answers each
with a line that holds what the function returned. It ends with its input, or when it is asked for nothing for IDLE_S.
"""

import ctypes
import json
import os
import select
import signal
import sys
from typing import Any

IDLE_S = 10.0
"""Time without work after which it ends and gives its memory back [s]."""
KINDS: dict[str, Any] = {
    "text": ctypes.c_char_p,
    "int": ctypes.c_int,
    "size": ctypes.c_size_t,
    "bool": ctypes.c_bool,
    "none": ctypes.c_void_p,
}
"""Types of arguments by their names in a line; `none` is a pointer to nothing."""


def main() -> None:
    """Compiles what is asked for until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who is to end asks for nothing more
    # What the compiler prints itself goes where errors do.
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)
    compile_ = getattr(ctypes.CDLL(sys.argv[1]), sys.argv[2])
    compile_.restype = ctypes.c_size_t
    while select.select([0], [], [], IDLE_S)[0]:
        line = sys.stdin.buffer.readline()
        if not line:
            break
        job = json.loads(line)
        compile_.argtypes = [KINDS[kind] for kind in job["types"]]
        given: list[Any] = [v.encode("utf-8") if isinstance(v, str) else v for v in job["values"]]
        answers.write(f"{compile_(*given)}\n")
        answers.flush()


if __name__ == "__main__":
    main()
