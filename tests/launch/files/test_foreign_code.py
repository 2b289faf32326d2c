"""A launch file that names code of its own: what --explain imports is said, and with --no-import nothing is."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from evis.cli import main

Write = Callable[..., Path]
EVIL = """
from pathlib import Path
import {helper}
Path(__file__).with_name("imported").touch()
from graph_nodes import *
"""
GRAPH = """
nodes:
  physics: {{type: physics, params: {{scene: spinning_disk}}}}
  mine:
    type: "{module}:Relay"
    process: apart
    namespace: robot
    params: {{gain: 2.0}}
  labels: {{type: imu, keep: [imu], params: {{camera: other}}}}
  recorder: {{type: recorder, params: {{path: b.mcap, topics: ["/robot/*/events"]}}}}
"""


@pytest.fixture
def foreign(tmp_path: Path, write: Write) -> Iterator[tuple[Path, str, str]]:
    """(launch file, its module, the module that this imports); names that no other test has imported."""
    module, helper = f"evil_{id(tmp_path)}", f"helper_{id(tmp_path)}"
    (tmp_path / f"{module}.py").write_text(EVIL.format(helper=helper))
    (tmp_path / f"{helper}.py").write_text("")
    before = list(sys.path)
    yield write(GRAPH.format(module=module)), module, helper
    sys.path[:] = before


def explained(path: Path, *words: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    code = main(["launch", str(path), "--explain", *words])
    return code, *capsys.readouterr()


def test_no_import_loads_nothing_and_shows_what_the_file_says(
    foreign: tuple[Path, str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, module, _ = foreign
    files, modules = sorted(tmp_path.iterdir()), set(sys.modules)
    code, out, err = explained(path, "--no-import", capsys=capsys)
    assert code == 0, err
    text = out[out.index("unknown") :]
    for part in (f"robot/mine  ({module}:Relay,", "graph.yaml:", "gain=2", "process: robot/apart", "namespace: robot"):
        assert part in text
    assert "imported from outside" not in out
    assert sorted(tmp_path.iterdir()) == files and str(tmp_path) not in sys.path
    assert not {name for name in set(sys.modules) - modules if "evil" in name or "helper" in name}
    code, out, _ = explained(path, "--no-import", "--json", capsys=capsys)
    body = json.loads(out)
    assert [said["type"] for said in body["unknown"]] == [f"{module}:Relay"] and body["imports"] == []
    assert "recorder" in body["nodes"] and "mine" not in str(body["nodes"])


def test_explain_says_which_files_it_imports(
    foreign: tuple[Path, str, str], write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, module, helper = foreign
    path = write(f"nodes: {{mine: {{type: '{module}:Ticker', keep: [depth]}}}}\n", "own.yaml")
    code, out, err = explained(path, capsys=capsys)
    assert code == 0, err
    assert (tmp_path / "imported").exists()
    lines = out[out.index("imported from outside evis") :].splitlines()[1:]
    named = [line.strip() for line in lines[: lines.index("")]]
    assert named[0] == str(tmp_path / f"{module}.py") and str(tmp_path / f"{helper}.py") in named
    assert not [file for file in named if "site-packages" in file or "/lib/python" in file]


def test_a_shipped_launch_file_imports_nothing_from_outside(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ((), ("--no-import",)):
        assert main(["launch", "spinning_disk", "--explain", "--json", *words]) == 0
        body = json.loads(capsys.readouterr().out)
        assert body["imports"] == [] and body["unknown"] == [] and "event_sensor" in body["nodes"]


def test_no_import_is_for_a_plan(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["launch", "spinning_disk", "--no-import"]) == 2
    assert "--no-import is for --explain" in capsys.readouterr().err
