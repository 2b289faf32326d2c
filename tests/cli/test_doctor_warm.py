"""`evis doctor --warm`: kernels that are there before the first run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from evis.cli import main
from evis.cli.machine.warm import FIRST, runs, warm
from evis.config import paths
from nodes.event_sensor.presets import PRESETS


def test_every_scene_and_every_sensor_is_run_once() -> None:
    wanted = runs()
    assert wanted[0] == (FIRST,) and len(set(wanted)) == len(wanted)
    assert {words[0] for words in wanted if len(words) == 1} == set(paths.names("scenes"))
    chosen = {word.partition("=")[2] for words in wanted for word in words if word.startswith("preset:=")}
    assert chosen == PRESETS.keys() - {"ideal"}


def test_every_run_can_be_planned(capsys: pytest.CaptureFixture[str]) -> None:
    """Arguments that a graph no longer has would be told by `evis launch` only after minutes."""
    for words in runs():
        assert main(["launch", *words, "device:=cpu", "--explain", "--no-view", "--record", "a.mcap"]) == 0, words
    capsys.readouterr()


def test_a_run_that_fails_is_named_and_the_others_go_on() -> None:
    said: list[str] = []
    failed = warm("cpu", [("no_such_scene",), (FIRST, "upsampling:=many")], said.append)
    assert list(failed) == ["no_such_scene", f"{FIRST} upsampling:=many"]
    assert "no_such_scene" in failed["no_such_scene"] and "upsampling" in failed[f"{FIRST} upsampling:=many"]
    assert [line.split()[0] for line in said] == ["1/2", "2/2"]


def test_a_device_needs_the_option_and_has_to_be_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--device", "cpu"]) == 2 and "--device is for --warm" in capsys.readouterr().err
    assert main(["doctor", "--warm", "--device", "cuda:99"]) == 1
    assert "no device 'cuda:99'" in capsys.readouterr().err


@pytest.mark.slow
def test_after_it_a_scene_compiles_nothing(tmp_path: Path) -> None:
    """In a cache of its own: what was compiled for a run is all that the run needs."""
    told = {**os.environ, "WARP_CACHE_PATH": str(tmp_path)}
    code = f"from evis.cli.machine.warm import warm; assert not warm('cpu', [('{FIRST}',)])"
    subprocess.run([sys.executable, "-c", code], env=told, check=True, timeout=600)
    there = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    assert len(there) > 20
    command = [sys.executable, "-m", "evis", "launch", FIRST, "--no-view", "--json", "--duration", "0.2"]
    done = subprocess.run(command, env=told, check=True, timeout=600, capture_output=True, text=True)
    assert json.loads(done.stdout.splitlines()[-1])["events"] > 1000
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == there
