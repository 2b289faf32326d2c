"""The command line as a user runs it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command import NODES, Result, environment


@pytest.fixture(scope="session")
def runtime_folder() -> Iterator[Path]:
    """Short, because a socket's path is limited."""
    folder = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def evis(runtime_folder: Path, tmp_path: Path) -> Callable[..., Result]:
    """Run `evis WORDS` in an empty folder."""

    def run(*words: str, **variables: str) -> Result:
        done = subprocess.run(
            [sys.executable, "-m", "evis", *map(str, words)],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            env={**environment(runtime_folder), **variables},
            timeout=600,
        )
        return Result(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def evis_here(
    runtime_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """The same in this process, for commands that start none: quicker."""
    from evis.cli import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime_folder))
    monkeypatch.syspath_prepend(str(NODES))

    def run(*words: str) -> Result:
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = int(end.code or 0)
        return Result(code, *capfd.readouterr())

    return run
