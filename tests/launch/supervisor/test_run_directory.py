"""The private directory of a run: who may read it, which runs live, what is swept."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from evis.cli.failure import one_line
from evis.runtime.plan import Plan
from evis.supervisor import run_directory
from evis.supervisor.run_directory import RunDirectory, is_live, live_runs, root, sweep
from evis.supervisor.supervisor import Supervisor


def gone(path: Path) -> bool:
    end = time.monotonic() + 60
    while path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    return not path.exists()


def test_a_run_is_private_live_and_then_gone(runtime: Path) -> None:
    run = RunDirectory()
    (run.path / "plan.json").touch()
    assert run.path.parent == runtime / "evis" == root()
    assert (run.path.stat().st_mode & 0o777, root().stat().st_mode & 0o777) == (0o700, 0o700)
    assert is_live(run.path) and live_runs() == [run.path] and sweep() == []
    run.close()
    assert not run.path.exists() and live_runs() == []


@pytest.mark.parametrize("where", ["plan", "folder"])
def test_a_runtime_directory_without_room_is_named(runtime: Path, where: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The system does not say where a write found no room."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text" if where == "plan" else "rename", full)
    with pytest.raises(OSError) as caught:
        Supervisor(Plan("test", "run", "")).run()
    line = one_line(caught.value)
    assert line.startswith(f"{runtime}/evis/") and "No space left on device; make room there" in line
    assert "XDG_RUNTIME_DIR" in line
    assert not list((runtime / "evis").iterdir()), "nothing is left of it"


def test_nothing_is_left_where_no_process_can_be_started(runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The directory and its lock are there by then, and nobody watches over them yet."""

    def full(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(subprocess, "Popen", full)
    with pytest.raises(BlockingIOError):
        RunDirectory()
    assert not list((runtime / "evis").iterdir())


def test_the_newest_run_is_first(runtime: Path) -> None:
    """By when its plan was written: two of one second have names in any order."""
    runs = [RunDirectory() for _ in range(3)]
    for run, written_ns in zip(runs, (2, 3, 1)):
        (run.path / "plan.json").touch()
        os.utime(run.path / "plan.json", ns=(written_ns, written_ns))
    assert live_runs() == [runs[1].path, runs[0].path, runs[2].path]
    for run in runs:
        run.close()


def test_the_run_directory_goes_after_a_launcher_that_was_killed(runtime: Path) -> None:
    code = (
        "import time; from evis.supervisor.run_directory import RunDirectory; r = RunDirectory();"
        "(r.path / 'x.sock').touch(); print(r.path, flush=True); time.sleep(600)"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    path = Path(process.stdout.readline().strip())
    assert is_live(path)
    process.kill()
    process.wait()
    process.stdout.close()
    assert gone(path)


def test_a_clean_up_process_that_stands_still_fails_no_run(runtime: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has nothing left to do, and ends when it goes on."""
    monkeypatch.setattr(run_directory, "_CLEANUP_S", 0.1)
    run = RunDirectory()
    run._cleanup.send_signal(signal.SIGSTOP)
    try:
        run.close()
        assert not run.path.exists() and run._cleanup.poll() is None
    finally:
        run._cleanup.send_signal(signal.SIGCONT)
    assert run._cleanup.wait(60) == 0


def test_sweeping_spares_what_lives_and_what_is_young(runtime: Path) -> None:
    run = RunDirectory()
    dead, young, old = (root() / name for name in ("dead", "young", "old"))
    for folder in (dead, young, old):
        folder.mkdir()
    (dead / "lock").touch()
    os.utime(old, (0, 0))
    assert sorted(sweep()) == [dead, old]
    assert run.path.exists() and young.exists()
    run.close()


def test_a_root_that_is_not_ours_is_refused(runtime: Path, tmp_path: Path) -> None:
    (runtime / "evis").symlink_to(tmp_path)
    with pytest.raises(OSError, match="belongs to somebody else"):
        root()


def test_a_root_open_to_others_is_closed(runtime: Path) -> None:
    (runtime / "evis").mkdir(mode=0o755)
    assert root().stat().st_mode & 0o777 == 0o700


def test_a_runtime_folder_too_deep_for_sockets_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 60)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    monkeypatch.setenv("TMPDIR", str(deep))
    assert len(str(root())) < 60 and f"evis-{os.getuid()}" in str(root())


def test_a_runtime_directory_that_is_a_file_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with tempfile.NamedTemporaryFile(dir="/tmp") as file:  # with a short name: a long one is passed over anyway
        monkeypatch.setenv("XDG_RUNTIME_DIR", file.name)
        assert root().name == f"evis-{os.getuid()}"
