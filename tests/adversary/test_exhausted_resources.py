"""No room on the disk, in shared memory, in the runtime directory; a terminal that is gone: the recording is what it
was, or its beginning, whole.
"""

from __future__ import annotations

import contextlib
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import tally
from recorded_runs import HOW, WORDS, Stage, kill, opened

CAMPAIGN = "bad days"
EVIS = [sys.executable, "-m", "evis"]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


def mounted(folder: Path, size: str) -> None:
    """A file system in memory of that size on the folder, until `unmount`; skips where that is not allowed."""
    folder.mkdir(exist_ok=True, mode=0o700)
    done = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size},mode=0700", "none", str(folder)], capture_output=True
    )
    if done.returncode:
        pytest.skip("this user may mount nothing")


@contextlib.contextmanager
def small_disk(folder: Path, size: str) -> Iterator[None]:
    """Mounted within."""
    mounted(folder, size)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@contextlib.contextmanager
def small_files(size: int) -> Iterator[None]:
    """What is started within may make no file longer than that: as a full disk, where nobody may mount one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def fill(folder: Path) -> None:
    """Leave no room in a file system."""
    with contextlib.suppress(OSError), open(folder / "fill", "wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))


def told(table: tally.Table, attack: str, wrong: list[str], outcome: str) -> None:
    """Count, then fail."""
    if wrong:
        table.fail(CAMPAIGN, attack, "; ".join(wrong))
    else:
        table.count(CAMPAIGN, attack, outcome)
    assert not wrong, wrong


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("limit", ["a small file system", "a limit of file sizes"])
def test_a_full_disk(how: str, limit: str, stage: Stage, table: tally.Table) -> None:
    """One line that names the bag, exit status 1; what is there is the beginning, with an index if that found room."""
    stage.folder = stage.folder / "disk"
    stage.folder.mkdir()
    with small_disk(stage.folder, "1m") if limit.startswith("a small") else contextlib.nullcontext():
        with small_files(1_000_000) if "limit" in limit else contextlib.nullcontext():
            launcher = stage.launch(how)
        code, _, err = launcher.end()
        found = opened(stage.bag)
        last = err.splitlines()[-1] if err else ""
        wrong = [] if code == 1 and str(stage.bag) in last and "recording has stopped" in last else [f"{code}: {err}"]
        wrong += [] if found.messages and stage.is_prefix(found.messages) else ["no prefix of the undisturbed run"]
        wrong += stage.nothing_left(launcher)
    told(
        table,
        f"full disk ({limit}), {how}",
        wrong,
        f"named, a prefix, {'no room for the index, recovered' if found.torn else 'whole bag'}",
    )


@pytest.mark.parametrize("how", HOW)
def test_no_room_in_shared_memory(how: str, stage: Stage, table: tally.Table) -> None:
    """/dev/shm, where many keep what processes share, is full."""
    script = 'mount -t tmpfs -o size=4k none /dev/shm && (dd if=/dev/zero of=/dev/shm/full bs=4k count=9; exec "$@")'
    if subprocess.run(["unshare", "-m", "true"], capture_output=True).returncode:
        pytest.skip("this user has no mounts of its own")
    words = ["spinning_disk", *WORDS[1:], "--no-view", "--record", str(stage.bag), *HOW[how]]
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script, "sh", *EVIS, "launch", *words],
        capture_output=True,
        text=True,
        timeout=600,
    )
    wrong = [] if done.returncode == 0 else [f"{done.returncode}: {done.stderr}"]
    wrong += [] if not wrong and opened(stage.bag).messages == stage.reference else ["other events"]
    told(table, f"/dev/shm full, {how}", wrong, "byte-equal")


def test_no_room_in_the_runtime_directory(stage: Stage, table: tally.Table) -> None:
    """Before the start: one line that names it. While it runs: nobody needs more of it than there is."""
    with small_disk(stage.runtime, "256k"):
        fill(stage.runtime)
        code, _, err = stage.launch("as processes").end()
        lines = err.splitlines()
        named = len(lines) == 1 and str(stage.runtime) in lines[0] and "XDG_RUNTIME_DIR" in lines[0]
        wrong = [] if code == 1 and named else [f"at the start {code}: {err}"]
        (stage.runtime / "fill").unlink()
        launcher = stage.launch("as processes")
        stage.under_way(launcher)
        fill(stage.runtime)
        code, _, err = launcher.end()
        found = opened(stage.bag)
        wrong += [] if code == 0 else [f"amid {code}: {err}"]
        wrong += [] if found.messages == stage.reference and not found.torn else ["other events"]
    told(table, "runtime directory full", wrong, "named at the start; byte-equal amid")


LOST = {
    "| head -1": ("2>&1 | head -1; exit ${PIPESTATUS[0]}", "a broken pipe is no success"),
    "2>/dev/full": ("2>/dev/full", ""),
    ">/dev/full 2>&1": (">/dev/full 2>&1", "what was to be told is lost"),
    "2>&-": ("2>&-", ""),
}


@pytest.mark.parametrize("end", LOST)
@pytest.mark.parametrize("viewer", ["a viewer that dies", "a viewer that lives"])
def test_a_terminal_that_is_lost(end: str, viewer: str, stage: Stage, table: tally.Table) -> None:
    """The run goes on, and its bag is the undisturbed one; exit status 0 only where all could be told."""
    command, lost = LOST[end]
    launcher = stage.shell(command)
    alive = stage.under_way(launcher)
    if viewer == "a viewer that dies":
        kill(alive, "visualizer")
    code, _, err = launcher.end()
    found = opened(stage.bag)
    wrong = (
        []
        if not found.torn and found.messages == stage.reference
        else [f"{len(found.messages)} of {len(stage.reference)} messages {found.torn}"]
    )
    wrong += [] if (code != 0) == bool(lost) else [f"exit status {code}: {err}"]
    wrong += stage.nothing_left(launcher)
    told(table, f"{end}, {viewer}", wrong, "byte-equal")


@pytest.mark.parametrize("end", LOST)
def test_a_failure_is_a_failure_even_when_nobody_reads_of_it(end: str, stage: Stage, table: tally.Table) -> None:
    """A node is killed while the terminal is gone."""
    launcher = stage.shell(LOST[end][0])
    kill(stage.under_way(launcher), "renderer")
    code, _, err = launcher.end()
    found = opened(stage.bag)
    wrong = [] if code == 1 else [f"exit status {code}: {err}"]
    wrong += [] if not found.torn and stage.is_prefix(found.messages) else [f"no whole prefix: {found.torn}"]
    wrong += stage.nothing_left(launcher)
    told(table, f"{end}, a node killed", wrong, "exit status 1, a prefix, whole bag")
