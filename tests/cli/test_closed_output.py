"""Whoever listens may go at any time: the work is done, the bag is whole, and the exit status tells of it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from command import environment

from evis.bag.reader import BagReader

LIMIT_S = 120.0
GRAPH = """
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 40, sleep: 0.01}}
  relay: {type: "graph_nodes:Relay"}
  recorder: {type: recorder, params: {path: b.mcap, topics: [/cam0/events]}}
  viewer: {type: "graph_nodes:Viewer", tap: true}
"""
READERLESS = "this_pipe_has_lost_its_reader"


@pytest.fixture
def run(runtime_folder: Path, tmp_path: Path) -> Callable[..., tuple[int, str, str]]:
    """`evis WORDS` with standard output and error as a shell's redirection or a pipe without reader has them."""
    (tmp_path / "graph.yaml").write_text(GRAPH)

    def runner(words: str, out: str = "out", err: str = "err") -> tuple[int, str, str]:
        reading, writing = os.pipe()
        os.close(reading)
        to = {READERLESS: f"&{writing}", "closed": "&-"}
        command = f"exec {sys.executable} -m evis {words} >{to.get(out, out)} 2>{to.get(err, err)}"
        try:
            done = subprocess.run(
                ["bash", "-c", command], cwd=tmp_path, pass_fds=[writing], timeout=LIMIT_S, stdin=subprocess.DEVNULL,
                env={**environment(runtime_folder), "XDG_STATE_HOME": str(tmp_path / "state")},
            )  # fmt: skip
        finally:
            os.close(writing)
        texts = [(tmp_path / name).read_text() if (tmp_path / name).exists() else "" for name in ("out", "err")]
        assert "Traceback" not in texts[1] and "Exception ignored" not in texts[1]
        return done.returncode, *texts

    return runner


def unsaid(folder: Path) -> str:
    return "".join(path.read_text() for path in (folder / "state").rglob("*.log"))


@pytest.mark.parametrize(
    ("out", "err", "status"),
    [
        (READERLESS, READERLESS, 141),
        ("out", READERLESS, 0),
        ("out", "/dev/full", 0),
        ("out", "closed", 0),
        (READERLESS, "err", 141),
        ("/dev/full", "err", 1),
        ("closed", "err", 1),
        ("closed", "closed", 1),
    ],
)
def test_a_run_ends_whole_whoever_listens(
    out: str, err: str, status: int, run: Callable[..., Any], tmp_path: Path
) -> None:
    code, said, told = run("launch graph.yaml --compose --json --no-view", out, err)
    assert code == status, told
    with BagReader(tmp_path / "b.mcap") as reader:
        assert not reader.problem
        assert sum(1 for topic, _ in reader.messages() if topic == "/cam0/events") == 40
    log = unsaid(tmp_path)
    if out == "out":
        assert '"events": 40' in said
    else:
        assert '"events": 40' in log, "the summary is in the log"
    if err != "err":
        assert "viewer: warning: the viewer closes" in log and "could not be said" in log.splitlines()[-1]
    if out in ("/dev/full", "closed") and err == "err":
        assert "evis launch: standard output: " in told and ".log" in told
    if status == 0:
        assert "standard output" not in log


def test_the_log_is_private_and_the_doctor_names_it(run: Callable[..., Any], tmp_path: Path) -> None:
    run("launch graph.yaml --compose --no-view", err="/dev/full")
    (log,) = (tmp_path / "state").rglob("*.log")
    assert log.stat().st_mode & 0o777 == 0o600 and log.parent.stat().st_mode & 0o777 == 0o700


def test_what_was_said_in_time_leaves_no_log(run: Callable[..., Any], tmp_path: Path) -> None:
    code, said, told = run("launch graph.yaml --compose --no-view")
    assert code == 0 and "real-time factor" in said and "viewer closes" in told
    assert not (tmp_path / "state").exists()


@pytest.mark.parametrize(
    "words", ["events simulate frames.npz events.npz", "events convert events0.npz events.npz --json"]
)
@pytest.mark.parametrize(("out", "status"), [(READERLESS, 141), ("/dev/full", 1)])
def test_other_work_is_done_and_its_status_tells(
    words: str, out: str, status: int, run: Callable[..., Any], tmp_path: Path
) -> None:
    import numpy as np

    from evis.events import Events, open_writer

    luminance = np.exp(np.linspace(0, 3, 5, dtype=np.float32))[:, None, None] * np.ones((1, 4, 4), np.float32)
    np.savez(tmp_path / "frames.npz", luminance=luminance, t=np.arange(5) * 1_000_000)
    with open_writer(tmp_path / "events0.npz", 4, 4) as writer:
        writer.write(Events.of(*(np.arange(9) * k for k in (1, 0, 0, 0))))
    code, _, told = run(words, out)
    assert code == status and len(told.splitlines()) == (status == 1)
    assert len(np.load(tmp_path / "events.npz")["t"]) > 0


def test_a_word_that_the_terminal_cannot_show_ends_nothing() -> None:
    code = "from evis.console.outlet import standard_streams\nwith standard_streams(): print('\\u00e9 \\u4e2d')"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, "PYTHONIOENCODING": "ascii"}
    )
    assert done.returncode == 0 and done.stdout == "\\xe9 \\u4e2d\n"


def test_a_closed_descriptor_is_given_to_nothing_else(tmp_path: Path) -> None:
    """The next file opened would become descriptor 1, and take whatever a library prints."""
    code = (
        "from evis.console.outlet import standard_streams\nwith standard_streams():\n"
        f"    import os\n    f = open({str(tmp_path / 'f')!r}, 'w')\n"
        "    print('stray')\n    os.write(1, b'stray')\n    assert f.fileno() > 2"
    )
    done = subprocess.run(["bash", "-c", f'exec {sys.executable} -c "$0" >&- 2>&-', code])
    assert done.returncode == 0 and (tmp_path / "f").read_text() == ""


def test_the_supervisor_survives_a_listener_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From Python as from the command line."""
    from evis.console.voice import Voice

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    calls = []

    def lost(what: Any) -> None:
        calls.append(what)
        raise BrokenPipeError(32, "Broken pipe")

    voice = Voice(lost, lost)
    for _ in range(2):
        voice.say("a line")
        voice.tick({})
    voice.close()
    assert calls == ["a line", {}, "a line"], "a progress that failed is not tried again"
    (log,) = tmp_path.rglob("*.log")
    assert [line[9:] for line in log.read_text().splitlines()[1:3]] == ["a line", "the progress is shown no more"]
