"""Errors that come of a process's limits and surroundings name these."""

from __future__ import annotations

import errno
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from evis.cli.failure import one_line
from evis.console.process_limits import with_remedy
from evis.console.working_folder import REMOVED
from evis.runtime.hosting.node_call import describe
from evis.supervisor.child import Child

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


@pytest.mark.parametrize("text", ["can't start new thread", f"{os.strerror(errno.EAGAIN)} (src/thread.cpp:241)"])
def test_too_few_processes_are_named(text: str) -> None:
    """As Python and libzmq tell of them; root, who may run these tests, has as many as there are."""
    limit = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    if limit == resource.RLIM_INFINITY:
        pytest.skip("no limit")
    assert f"{text}; a user may have {limit} processes and threads" in with_remedy(text)
    assert "ulimit -u" in with_remedy(text)


def ended(folder: Path, how: str, log: str = "") -> str:
    """What is told of a process that has ended so."""
    (folder / "renderer.log").write_text(log)
    process = subprocess.Popen(["sh", "-c", how])
    process.wait()
    return Child("renderer", [], folder, process=process).unannounced_exit()


def test_a_limit_in_the_last_words_of_a_process_is_told(tmp_path: Path) -> None:
    full = f"LLVM ERROR: IO failure on output stream: {os.strerror(errno.ENOSPC)}"
    told = ended(tmp_path, "exit 1", f"{full}\n")
    assert f"exit status 1: {full}; make room" in told and "WARP_CACHE_PATH" in told
    many = os.strerror(errno.EMFILE)
    assert f"exit status 1: OSError: {many}; a process may" in ended(tmp_path, "exit 1", f"OSError: {many}\n")
    assert ended(tmp_path, "exit 3", "hello\n").endswith("ended with exit status 3 and no message")


def test_the_limit_of_the_time_on_a_cpu_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system kills who comes to it, and says no more."""
    assert "ulimit -t" not in ended(tmp_path, "kill -KILL $$")
    both = {resource.RLIMIT_CPU: (6, 6)}
    fake = SimpleNamespace(**{**vars(resource), "getrlimit": lambda kind: both.get(kind, (-1, -1))})
    monkeypatch.setattr("evis.console.process_limits.resource", fake)
    for number in (signal.SIGKILL, signal.SIGXCPU):
        told = ended(tmp_path, f"kill -{int(number)} $$")
        assert f"{number.name}; a process may have 6 s of a CPU (ulimit -t)" in told


def test_a_folder_that_was_removed_amid_a_command_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as of_folder:
        os.path.abspath("scene.yaml")
    assert one_line(of_folder.value) == describe(of_folder.value) == REMOVED
    with pytest.raises(FileNotFoundError) as of_file:
        open(tmp_path / "missing")
    assert "missing" in one_line(of_file.value) and "missing" in describe(of_file.value)
