"""docs/launch.md: every key that a launch file may have is on it and none besides, and its graph runs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

from evis.launch import arguments, expand, files, recorded

PAGE = (Path(__file__).parents[3] / "docs" / "launch.md").read_text()


def keys_under(heading: str) -> set[str]:
    """The keys in the first column of the table below a heading."""
    section = PAGE.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return {key for row in re.findall(r"^\| (`.*?) \|", section, re.M) for key in re.findall(r"`(\w+)`", row)}


def test_all_keys_are_told() -> None:
    assert keys_under("Keys of a file") == set(files.TOP_KEYS)
    assert keys_under("Keys of an argument") == set(arguments.KEYS)
    assert keys_under("Keys of an include") == set(files.INCLUDE_KEYS)
    assert keys_under("Keys of a node") == set(expand.NODE_KEYS)
    assert all(name in PAGE for name in (*arguments.OPTIONS, *arguments.TYPES, *expand.MODES, *recorded.KEYS))


def test_its_graph_runs(tmp_path: Path) -> None:
    """The node counts, of a disk that turns, every packet but that before which there is none."""
    for name, kind in (("watch.py", "python"), ("watched.yaml", "yaml")):
        (tmp_path / name).write_text(re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.M | re.S)[0])
    words = ["limit:=1", "width:=64", "height:=48", "audit:=0", "--duration", "0.1", "--no-view", "--json"]
    command = [sys.executable, "-m", "evis", "launch", str(tmp_path / "watched.yaml"), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["nodes"]["watch"]["counters"] == {"busy_packets": 3}
