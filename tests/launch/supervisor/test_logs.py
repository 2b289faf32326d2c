"""What processes write reaches the user whole, however much of it comes at the end."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from running_chain import Launch, Write

from evis.supervisor.logs import Logs

LINES = [f"cam: line {k} of a log that is longer than what is read at once" for k in range(5000)]


def child(path: Path) -> Any:
    return SimpleNamespace(name="cam", log_path=path, nodes=[SimpleNamespace(name="cam")])


@pytest.mark.parametrize("debug", [False, True])
def test_all_that_is_left_is_passed_on_at_the_end(debug: bool, tmp_path: Path) -> None:
    """A line that a process died over too, and one longer than a piece in parts."""
    path, said = tmp_path / "cam.log", list[str]()
    path.write_text("\n".join([*LINES, "y" * 100_000, "cam: it died over th"]))
    logs = Logs(said.append, debug)
    logs.forward([child(path)])
    assert 0 < len(said) < len(LINES), "the others have their turn meanwhile"
    logs.drain([child(path)])
    start = "cam | " * debug
    assert said[: len(LINES)] == [start + line for line in LINES]
    assert said[-1] == f"{start}cam: it died over th"
    assert sum(line.count("y") for line in said[len(LINES) : -1]) == 100_000 * debug


def test_a_line_is_passed_on_once_it_is_whole(tmp_path: Path) -> None:
    path, said = tmp_path / "cam.log", list[str]()
    logs = Logs(said.append, False)
    logs.forward([child(path)])  # there is no log yet
    path.write_text("cam: half a li")
    logs.forward([child(path)])
    assert said == []
    with path.open("a") as log:
        log.write("ne\nanother library\n")
    logs.forward([child(path)])
    logs.drain([child(path)])
    assert said == ["cam: half a line"]


def test_the_last_words_of_a_run_are_all_shown(write: Write, launch: Launch) -> None:
    """More than is read while the process ends."""
    path = write("nodes:\n  reader: {type: 'graph_nodes:Talkative', params: {count: 3}, keep: [depth]}\n")
    code, _, err = launch(path).end()
    said = [line for line in err.splitlines() if "register" in line]
    assert code == 0 and said == [f"reader: register {k} is not as it was before" for k in range(20_000)]
