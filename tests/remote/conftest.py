"""Two hosts on one machine: each has a folder of running graphs of its own."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from two_hosts import Hosts


@pytest.fixture
def folders() -> Iterator[tuple[Path, Path]]:
    """Those of the host of the graph and of the other; short, because a socket's path is limited."""
    both = Path(tempfile.mkdtemp(prefix="ev", dir="/tmp")), Path(tempfile.mkdtemp(prefix="ev", dir="/tmp"))
    yield both
    for folder in both:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def hosts(folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> Iterator[Hosts]:
    """A graph of one camera, whose messages the test sends, a server beside it, and who follows that."""
    both = Hosts(*folders, monkeypatch)
    yield both
    both.close()
