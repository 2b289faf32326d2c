"""Errors that come of a process's limits name the limit."""

from __future__ import annotations

import subprocess
import sys

import pytest

MEETS = {
    "--fsize=65536": "from evis.bus.memory.slots import reserve; reserve('/cam0/events', 1 << 20)",
    "--as=4000000000": "import numpy; numpy.ones(1 << 30)",
    "--nofile=9": "[open('/dev/null') for _ in range(9)]; import os; files = [os.dup(0) for _ in range(9)]",
}
"""What comes to each limit, after an import that needs more room than the limit leaves."""
TELLS = """
import sys
from evis.runtime.hosting.node_call import describe
from evis.console.process_limits import with_remedy
import numpy
from evis.bus.memory import slots
try:
    {}
except Exception as error:
    print(describe(error))
print(with_remedy("another error"))
"""
LIMITS = {
    "--fsize=65536": "a file may have 65536 bytes (ulimit -f): allow more, as by `ulimit -f unlimited`",
    "--as=4000000000": "a process may have 4000000000 bytes (ulimit -v): allow more, as by `ulimit -v unlimited`",
    "--nofile=9": "a process may have 9 (ulimit -n): allow more, as by `ulimit -n 4096`",
}


@pytest.mark.parametrize("limit", MEETS)
def test_an_error_names_the_limit_that_it_comes_of(limit: str) -> None:
    program = [sys.executable, "-c", TELLS.format(MEETS[limit])]
    said = subprocess.run(["prlimit", limit, *program], capture_output=True, text=True, check=True).stdout.splitlines()
    assert said[0].endswith(f"; {LIMITS[limit]}") and said[0].count("ulimit") == 2
    assert said[1:] == ["another error"]


def test_without_a_limit_none_is_named() -> None:
    """Memory is then short for another reason."""
    program = [sys.executable, "-c", TELLS.format("numpy.ones(1 << 50)")]
    said = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    assert "Unable to allocate" in said and "ulimit" not in said
