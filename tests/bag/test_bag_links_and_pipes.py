"""Outputs that are no plain file: symbolic links stay, and a pipe waits for its reader with a word."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from bag_messages import scene

from evis.bag import BagError
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from evis.events import Events, open_writer
from evis.files import named_pipe
from evis.files.whole_file import whole_file
from evis.launch.graph.checks import check_bag, check_writable


def record(path: Path) -> None:
    with BagWriter(path) as writer:
        for topic, message in scene(0).items():
            writer.write(topic, message)


def write_events(path: Path) -> None:
    with open_writer(path, 4, 4) as writer:
        writer.write(Events.of(*(np.arange(9) * k for k in (1, 0, 0, 0))))


def write_whole(path: Path) -> None:
    with whole_file(path) as partial:
        partial.write_bytes(b"new")


WRITERS = {"bag.mcap": record, "events.csv": write_events, "picture.png": write_whole}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("old", [True, False])
def test_a_symbolic_link_stays_and_what_it_leads_to_is_written(name: str, old: bool, tmp_path: Path) -> None:
    target = tmp_path / "disk" / f"real-{name}"
    target.parent.mkdir()
    if old:
        target.write_bytes(b"an older file")
    link = tmp_path / name
    link.symlink_to(target)
    check_writable(link, "--record")
    WRITERS[name](link)
    assert link.is_symlink() and link.readlink() == target
    assert target.is_file() and target.read_bytes()[:8] not in (b"an older", b"")
    kept = [target.with_name(f"{target.name}.bak")] if old and name == "bag.mcap" else []
    assert sorted(target.parent.iterdir()) == sorted([target, *kept]) and list(tmp_path.glob("*.bak")) == []
    if kept:
        assert kept[0].read_bytes() == b"an older file"


def test_links_that_lead_nowhere_are_told(tmp_path: Path) -> None:
    (tmp_path / "loop.mcap").symlink_to("loop.mcap")
    with pytest.raises(BagError, match="leads to itself"):
        record(tmp_path / "loop.mcap")
    (tmp_path / "lost.mcap").symlink_to("no/such/x.mcap")
    with pytest.raises(BagError, match=r"no directory .*no/such"):
        record(tmp_path / "lost.mcap")
    with pytest.raises(ValueError, match=r"no folder .*no/such"):
        check_writable(tmp_path / "lost.mcap", "--record")


@pytest.mark.parametrize("name", ["run.bag", "run.DB3", "run.raw", "-"])
def test_a_name_of_another_format_is_refused(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It became an MCAP file of that name, - too, which other programs take for standard output."""
    monkeypatch.chdir(tmp_path)
    remedy = "run.mcap"
    for attempt in (record, lambda path: check_bag(path, "--record")):
        with pytest.raises(ValueError, match=remedy):
            attempt(Path(name))
    check_writable(tmp_path / name, "what another node writes")  # which may be of any format
    assert list(tmp_path.iterdir()) == []


def test_who_may_not_write_is_told_where_and_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write anywhere, so the system's answers are made up: a folder of somebody else's, a read-only disk."""
    bag = tmp_path / "run.mcap"
    bag.write_bytes(b"")
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)  # the file is, its folder is not
    with pytest.raises(ValueError, match=rf"no permission to write in folder {tmp_path}; name a file in another"):
        check_bag(bag, "--record")
    kept = os.statvfs(tmp_path)
    read_only = os.statvfs_result([*kept[:8], os.ST_RDONLY, kept[9]])
    monkeypatch.setattr(os, "statvfs", lambda path: read_only)
    with pytest.raises(ValueError, match=rf"the file system of folder {tmp_path} is read-only; name a file on another"):
        check_bag(bag, "--record")
    monkeypatch.setattr(os, "open", lambda *_: (_ for _ in ()).throw(OSError(errno.EROFS, "Read-only file system")))
    with pytest.raises(BagError, match="is read-only; name a file on another one"):
        record(tmp_path / "new.mcap")


@pytest.mark.parametrize("name", WRITERS)
def test_a_pipe_is_told_of_and_gets_all_when_a_reader_comes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(named_pipe, "MOMENT_S", 0.0)
    os.mkfifo(tmp_path / name)
    read: list[bytes] = []
    told = threading.Event()
    monkeypatch.setattr(named_pipe, "_tell", lambda line: (print(line, file=sys.stderr), told.set()))

    def reader() -> None:
        told.wait(60)
        read.append((tmp_path / name).read_bytes())

    thread = threading.Thread(target=reader, daemon=True)
    thread.start()
    WRITERS[name](tmp_path / name)
    thread.join(60)
    assert "is a named pipe that nobody reads yet; waiting for a reader" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [tmp_path / name] and (tmp_path / name).is_fifo()
    other = tmp_path / f"plain-{name}"
    if name == "bag.mcap":
        other.write_bytes(read[0])
        with BagReader(other) as reader_:
            assert not reader_.problem and len(list(reader_.messages())) == len(scene(0))
    else:
        WRITERS[name](other)
        assert other.read_bytes() == read[0]


@pytest.mark.parametrize("action", ["convert", "simulate"])
def test_ctrl_c_ends_the_wait(action: str, tmp_path: Path) -> None:
    write_events(tmp_path / "convert.csv")
    np.savez(tmp_path / "simulate.npz", luminance=np.ones((2, 4, 4), np.float32), t=np.arange(2) * 1_000_000)
    os.mkfifo(tmp_path / "out.csv")
    source = next(tmp_path.glob(f"{action}.*"))
    process = subprocess.Popen(
        [sys.executable, "-m", "evis", "events", action, source, tmp_path / "out.csv"],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    assert "waiting for a reader" in process.stderr.readline()
    process.send_signal(signal.SIGINT)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 130 and rest == "evis events: interrupted\n"
    assert sorted(tmp_path.iterdir()) == sorted(
        [tmp_path / "convert.csv", tmp_path / "out.csv", tmp_path / "simulate.npz"]
    )
