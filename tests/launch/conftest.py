"""Launch files on the fly, a runtime directory of the test's own, and launchers that never outlive a test."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import psutil
import pytest
from launcher import Launcher


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a launch file and return its path."""

    def writer(text: str, name: str = "graph.yaml") -> Path:
        path = tmp_path / name
        path.write_text(text)
        return path

    return writer


@pytest.fixture
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Short, because a socket's path is limited; nothing else on the machine counts in it."""
    folder = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def launch(runtime: Path) -> Iterator[Callable[..., Launcher]]:
    """Start launchers."""
    started: list[Launcher] = []

    def starter(path: Path, *words: str, patient: bool = False, before: Sequence[str] = ()) -> Launcher:
        launcher = Launcher(path, *words, patient=patient, before=before)
        started.append(launcher)
        return launcher

    yield starter
    for launcher in started:
        launcher.stop()
        for process in launcher.seen:
            if process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                process.kill()
