"""Attacks run in a child process with a limit of memory and of time, so that what they cost is part of the test."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

MEMORY = 4_000_000_000
"""Address space of the child, as `ulimit -v 4000000` [bytes]."""
SECONDS = 60
"""Against hangs only: what is tested takes a few at most."""


def refused_by(code: str, *arguments: object, memory: int = MEMORY) -> str:
    """Runs `code` in a child that may have `memory` bytes, and returns the text of the ValueError that it must raise.

    code: Python, with `arguments` as texts in sys.argv[1:]. A child that ends otherwise fails the test.
    """
    program = f"try:\n    {code}\nexcept ValueError as error:\n    print(error)\nelse:\n    raise SystemExit('passed')"
    return output_of(program, arguments, memory).strip()


def each_refused(code: str, arguments: Sequence[object], memory: int = MEMORY) -> list[str]:
    """As `refused_by` for each of the arguments, which `code` has as `argument`, one after another in one child."""
    lines = ["import json, sys", "told = []", "for argument in sys.argv[1:]:", "    try:", f"        {code}"]
    lines += ["    except ValueError as error:", "        told.append(str(error))"]
    lines += ["    else:", "        raise SystemExit(f'not refused: {argument}')", "print(json.dumps(told))"]
    return [str(text) for text in json.loads(output_of("\n".join(lines), arguments, memory).splitlines()[-1])]


def output_of(program: str, arguments: Sequence[object], memory: int = MEMORY) -> str:
    """Runs a program in a child that may have `memory` bytes, and returns what it prints; it must end well."""
    done = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        cwd=Path(__file__).parents[1],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (memory, memory)),
    )
    assert done.returncode == 0, done.stderr[-2000:] or done.stdout
    return done.stdout
