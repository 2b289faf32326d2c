"""The process that gets ready while its graph is planned: taken by the run, or gone without a trace."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from launcher import Launcher, command_of

from evis.supervisor.early import EarlyStart

SMALL = ("width:=48", "height:=36", "time_tolerance:=0", "audit:=0", "--no-view")
KILLED_IN_PLANNING = """
import os, signal
from evis.launch import planner
def plan_launch(*_):
    os.kill(os.getpid(), signal.{name})
planner.plan_launch = plan_launch
from evis.cli import main
raise SystemExit(main())
"""


def left_in(runtime: Path) -> list[Path]:
    """What a run leaves in its folder, once its clean-up process has had time for it."""
    end = time.monotonic() + 60
    while (left := [*(runtime / "evis").glob("*")]) and time.monotonic() < end:
        time.sleep(0.02)
    return left


def gone(process: psutil.Process) -> bool:
    try:
        process.wait(60)
    except psutil.TimeoutExpired:
        return False
    return True


@pytest.mark.parametrize("grouping, name", [("--compose", "graph"), ("--split", "interpolator"), ("", "sensor")])
def test_the_run_takes_it(launch: Callable[..., Launcher], runtime: Path, grouping: str, name: str) -> None:
    """There is one process of that name, which was there before its plan."""
    launcher = launch(Path("spinning_disk"), *SMALL, *grouping.split(), "--duration", "0.1", "--json")
    seen: set[tuple[str, ...]] = set()
    while launcher.process.poll() is None:
        seen |= {tuple(command_of(child)) for child in launcher.children()} - {()}  # one that has ended has none
        time.sleep(0.01)
    code, out, err = launcher.end()
    assert code == 0, err
    assert json.loads(out)["events"] > 1000
    early = {words for words in seen if "--early" in words}
    assert len(early) == 1
    assert {words for words in seen if words[-1] == name} == early
    assert not launcher.survivors() and left_in(runtime) == []


def test_one_that_the_graph_lacks_ends_when_the_others_begin(launch: Callable[..., Launcher], runtime: Path) -> None:
    """Shares of the environments have processes of their own."""
    words = ("envs:=2", "device:=cpu,cpu")
    launcher = launch(Path("spinning_disk"), *SMALL, *words)
    launcher.wait_for(lambda: any("share1" in command_of(child) for child in launcher.children()))
    launcher.wait_for(lambda: not any("--early" in command_of(child) for child in launcher.children()))
    assert launcher.process.poll() is None
    launcher.interrupt()
    assert launcher.end()[0] == 0  # a graph without an end is ended so
    assert not launcher.survivors() and left_in(runtime) == []


@pytest.mark.parametrize(
    "words, said",
    [
        (["omeg:=3"], "omeg"),
        (["--duration", "-1"], "--duration is -1"),
        (["interpolator:=none", "upsampling:=1", "--duration", "0.05"], ""),
        (["--explain"], ""),
    ],
)
def test_a_graph_that_does_not_run_or_lacks_it_leaves_nothing(
    launch: Callable[..., Launcher], runtime: Path, words: list[str], said: str
) -> None:
    launcher = launch(Path("spinning_disk"), *SMALL, *words)
    code, out, err = launcher.end()
    assert (code == 0) == (said == ""), out + err
    assert said in err
    assert not launcher.survivors() and left_in(runtime) == []


@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM"])
def test_a_launcher_that_dies_while_it_plans_leaves_nothing(runtime: Path, name: str) -> None:
    program = KILLED_IN_PLANNING.format(name=name)
    before = {process.pid for process in psutil.process_iter()}
    subprocess.run(
        [sys.executable, "-c", program, "launch", "spinning_disk", "--compose", *SMALL], check=False, timeout=600
    )
    left = [p for p in psutil.process_iter(["cmdline"]) if p.pid not in before and _is_of(p, runtime)]
    assert all(gone(process) for process in left)
    assert left_in(runtime) == []


def _is_of(process: psutil.Process, runtime: Path) -> bool:
    return any(str(runtime) in word for word in process.info["cmdline"] or ())


def test_one_that_died_is_not_taken(runtime: Path) -> None:
    early = EarlyStart("graph")
    try:
        assert early.process("interpolator") is None
        assert early._process is not None
        os.kill(early._process.pid, signal.SIGKILL)
        early._process.wait(60)
        assert early.process("graph") is None
    finally:
        early.close()
    assert left_in(runtime) == []
