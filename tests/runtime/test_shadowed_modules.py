"""A user's project with folders named as evis's packages: his modules and ours can both be imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = "import evis.launch.catalog, msgs.events, nodes.event_sensor.presets, bench.report\n"


def script(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    """Run a script that lies in a folder, as a user does; evis is further down on the path."""
    (folder / "script.py").write_text(code)
    return subprocess.run(
        [sys.executable, "script.py"], cwd=folder, capture_output=True, text=True, env={"PYTHONPATH": str(ROOT)}
    )


def put(folder: Path, **texts: str) -> None:
    for name, text in texts.items():
        path = folder / (name.replace("__", "/") + ".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


@pytest.mark.parametrize("package", ["nodes", "msgs", "bench"])
@pytest.mark.parametrize("regular", [True, False])
@pytest.mark.parametrize("first", ["import evis\n", "MINE"])
def test_both_can_be_imported(package: str, regular: bool, first: str, tmp_path: Path) -> None:
    put(tmp_path, **{f"{package}__mine": "x = 7\n"})
    if regular:
        (tmp_path / package / "__init__.py").write_text("his = 8\n")
    mine = f"import {package}.mine\nassert {package}.mine.x == 7\n"
    if first == "MINE" and not regular:
        first = "import evis\n"  # of folders without __init__.py Python itself takes ours: evis must come first
    mine += f"assert {package}.his == 8\n" if regular else ""
    done = script(tmp_path, (mine if first == "MINE" else first) + OURS + mine)
    assert done.returncode == 0, done.stderr


def test_a_folder_within_a_folder_and_a_module_of_the_packages_name(tmp_path: Path) -> None:
    put(tmp_path, nodes__camera____init__="", nodes__camera__mine="x = 7\n", msgs="x = 8\n")
    done = script(
        tmp_path,
        "import evis\nimport nodes.camera.mine as mine, msgs\nassert (mine.x, msgs.x) == (7, 8)\n"
        "import nodes.camera.interface.driver, nodes.camera.usb.clock\n" + OURS,
    )
    assert done.returncode == 0, done.stderr


def test_one_module_in_both_is_told_with_the_remedy(tmp_path: Path) -> None:
    put(tmp_path, nodes__camera__find="x = 7\n")
    done = script(tmp_path, "import evis\nimport nodes.camera.find\n")
    line = done.stderr.splitlines()[-1]
    assert line.startswith("ImportError: ") and str(tmp_path / "nodes" / "camera" / "find.py") in line
    assert "hides the module nodes.camera.find of evis; give yours another name" in line


def test_a_node_of_a_users_package_nodes_runs(tmp_path: Path) -> None:
    """Named in a launch file beside it, and in a process of its own."""
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes" / "mine.py").write_text((ROOT / "tests" / "launch" / "graph_nodes.py").read_text())
    (tmp_path / "graph.yaml").write_text(
        "nodes:\n"
        "  ticker: {type: 'nodes.mine:Ticker', params: {count: 5}}\n"
        "  relay: {type: 'nodes.mine:Relay'}\n"
        "  recorder: {type: recorder, params: {path: b.mcap}}\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "evis", "launch", "graph.yaml", "--no-view"],
        cwd=tmp_path, capture_output=True, text=True, env={"PYTHONPATH": str(ROOT), "XDG_RUNTIME_DIR": "/tmp"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_node_types_are_those_that_come_with_evis(tmp_path: Path) -> None:
    put(tmp_path, nodes__mine__node="raise SystemExit('imported')\n")
    done = script(tmp_path, "from evis.launch import catalog\nassert 'mine' not in catalog.types()\n")
    assert done.returncode == 0, done.stderr
