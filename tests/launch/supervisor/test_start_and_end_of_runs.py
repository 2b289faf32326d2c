"""Running graphs start together, and end in order: by themselves, by Ctrl-C and by signals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import psutil
import pytest
from launcher import HERE, LIMIT_S, Launcher
from running_chain import NAMES, Launch, Write, last_json, nothing_left, running


def test_a_run_ends_by_itself_with_a_summary(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    started = time.monotonic()
    launcher = launch(chain, "n:=50", f"out:={tmp_path / 'out'}", "sleep:=0.002", "--json")
    code, out, err = launcher.end()
    took = time.monotonic() - started
    summary = last_json(out)
    assert code == 0, err
    assert (tmp_path / "out").read_text().split() == [str(k * 1_000_000) for k in range(50)] + ["ended"]
    assert summary["events"] == 50 and summary["sim_s"] == pytest.approx(0.049) and summary["drops"] == 0
    assert set(summary["nodes"]) == NAMES and summary["nodes"]["relay"]["updates"] == 50
    assert summary["rtf"] == pytest.approx(summary["sim_s"] / summary["wall_s"], rel=1e-3)
    assert summary["wall_s"] >= 0.1 and summary["startup_s"] + summary["wall_s"] <= took
    assert {"what", "why"} == set(summary["left_out"][0])
    assert "viewer: warning: the viewer closes" in err, "what nodes say reaches the user"
    nothing_left(launcher, runtime)


@pytest.mark.parametrize("flag", ["--compose", "--split"])
def test_composed_and_split_give_the_same(flag: str, chain: Path, launch: Launch, tmp_path: Path) -> None:
    code, out, err = launch(chain, "n:=30", f"out:={tmp_path / 'out'}", flag, "--json").end()
    assert code == 0, err
    assert (tmp_path / "out").read_text().split() == [str(k * 1_000_000) for k in range(30)] + ["ended"]
    assert last_json(out)["events"] == 30


@pytest.mark.parametrize("limit", [16, 22, 30])
def test_the_limit_of_open_files_is_named(limit: int, chain: Path, runtime: Path) -> None:
    """Where the launcher comes to it, where libzmq aborts, and where it gives an error."""
    command = [sys.executable, "-m", "evis", "launch", str(chain), "n:=5"]
    environment = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run(
        ["prlimit", f"--nofile={limit}", *command], env=environment, capture_output=True, text=True, timeout=LIMIT_S
    )
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "Too many open files" in last, done.stderr
    assert last.endswith(f"; a process may have {limit} (ulimit -n): allow more, as by `ulimit -n 4096`")


def test_the_limit_of_file_sizes_is_named(chain: Path, runtime: Path) -> None:
    """To make room on the disk, which has plenty, would not help."""
    command = [sys.executable, "-m", "evis", "launch", str(chain), "n:=5"]
    environment = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run(
        ["prlimit", "--fsize=2048", *command], env=environment, capture_output=True, text=True, timeout=LIMIT_S
    )
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "File too large" in last, done.stderr
    assert last.endswith("; a file may have 2048 bytes (ulimit -f): allow more, as by `ulimit -f unlimited`")


def test_nobody_steps_before_all_are_ready(write: Write, launch: Launch, tmp_path: Path) -> None:
    first, late = tmp_path / "first", tmp_path / "late"
    path = write(
        "nodes:\n"
        f"  first: {{type: 'graph_nodes:Ticker', keep: [depth], params: {{count: 3, marker: '{first}'}}}}\n"
        f"  late: {{type: 'graph_nodes:Ticker', keep: [depth], params: {{camera: cam1, count: 3, setup_s: 1.0,\n"
        f"         set_up: '{late}'}}}}\n"
    )
    code, _, err = launch(path).end()
    assert code == 0, err
    assert float(first.read_text()) > float(late.read_text())


def test_ctrl_c_lets_the_stream_end_in_order(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}", "mark_at:=100", "--json")
    launcher.wait_for(lambda: (tmp_path / "m").exists())
    launcher.process.send_signal(signal.SIGINT)
    code, out, err = launcher.end()
    lines = (tmp_path / "out").read_text().split()
    assert code == 0, err
    assert lines[-1] == "ended" and lines[:-1] == [str(k * 1_000_000) for k in range(len(lines) - 1)]
    assert last_json(out)["events"] == len(lines) - 1 > 0
    nothing_left(launcher, runtime)


@pytest.mark.parametrize("words", [("--duration", "100", "--json"), ("--duration", "100"), ("--json",)])
def test_a_run_that_was_cut_short_says_so(words: Sequence[str], write: Write, launch: Launch, tmp_path: Path) -> None:
    """Its bag is shorter than what was asked for; one without a duration ends no other way."""
    params = f"{{count: 0, sleep: '${{(duration or 100) / 1e4}}', marker: '{tmp_path / 'm'}'}}"
    path = write(f"nodes:\n  ticker: {{type: 'graph_nodes:Ticker', keep: [depth], params: {params}}}\n")
    launcher = launch(path, *words)
    launcher.wait_for((tmp_path / "m").exists)
    launcher.process.send_signal(signal.SIGTERM)
    code, out, err = launcher.end()
    assert code == 0, err
    assert ("asked to end before its 100 s were over" in out) == ("--duration" in words)
    assert "--json" not in words or ("interrupted" in last_json(out)) == ("--duration" in words)


def test_ctrl_c_of_a_terminal_reaches_only_the_launcher(chain: Path, launch: Launch, tmp_path: Path) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}")
    launcher.wait_for(lambda: (tmp_path / "m").exists())
    groups = {os.getpgid(p.pid) for p in launcher.children()}
    assert os.getpgid(launcher.process.pid) not in groups
    launcher.process.send_signal(signal.SIGINT)
    assert launcher.end()[0] == 0


def test_ctrl_c_during_the_start_is_no_failure(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    """A node that compiles cannot listen; nothing has begun, so nothing is lost and nothing is complained of."""
    launcher = launch(chain, f"out:={tmp_path / 'out'}", "setup_s:=600", "--json")
    launcher.wait_for(lambda: running(launcher))
    launcher.process.send_signal(signal.SIGINT)
    code, out, err = launcher.end()
    assert code == 0 and err == "" and last_json(out)["events"] == 0
    nothing_left(launcher, runtime)


def test_ctrl_c_a_moment_before_the_start_is_no_failure(
    write: Write, launch: Launch, runtime: Path, tmp_path: Path
) -> None:
    """What is ready after all, when its patience has run out, does not make the graph begin."""
    marker = tmp_path / "m"
    path = write(f"nodes:\n  late: {{type: 'graph_nodes:Late', keep: [depth], params: {{set_up: '{marker}'}}}}\n")
    launcher = launch(path, "--json")
    launcher.wait_for(marker.exists)
    launcher.process.send_signal(signal.SIGINT)
    code, out, err = launcher.end()
    assert code == 0 and err == "" and last_json(out)["events"] == 0
    nothing_left(launcher, runtime)


def test_a_second_ctrl_c_ends_a_node_that_hangs(write: Write, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    marker = tmp_path / "m"
    path = write(f"nodes:\n  hung: {{type: 'graph_nodes:Sleeper', keep: [events], params: {{marker: '{marker}'}}}}\n")
    launcher = launch(path, patient=True)
    launcher.wait_for(marker.exists)
    launcher.interrupt()
    assert launcher.process.poll() is None, "one Ctrl-C waits for the node"
    launcher.interrupt()
    code, _, err = launcher.end()
    assert code == 1 and "launch: hung " in err and "was ended by force, as a second Ctrl-C asks" in err
    nothing_left(launcher, runtime)


def test_three_ctrl_c_kill_even_the_deaf(write: Write, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    marker = tmp_path / "m"
    params = f"{{marker: '{marker}', deaf: true}}"
    path = write(f"nodes:\n  deaf: {{type: 'graph_nodes:Sleeper', keep: [events], params: {params}}}\n")
    launcher = launch(path, patient=True)
    launcher.wait_for(marker.exists)
    for _ in range(3):
        assert launcher.process.poll() is None
        launcher.interrupt()
    assert launcher.end()[0] == 1
    nothing_left(launcher, runtime)


def test_sigterm_of_the_launcher_is_a_ctrl_c(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}")
    launcher.wait_for(lambda: (tmp_path / "m").exists())
    launcher.process.terminate()
    assert launcher.end()[0] == 0
    assert (tmp_path / "out").read_text().split()[-1] == "ended"
    nothing_left(launcher, runtime)


def test_the_run_directory_is_private(chain: Path, launch: Launch, runtime: Path) -> None:
    launcher = launch(chain)
    launcher.wait_for(lambda: running(launcher))
    run = next((runtime / "evis").iterdir())
    assert (run.stat().st_mode & 0o777, run.parent.stat().st_mode & 0o777) == (0o700, 0o700)
    assert {p.name for p in run.glob("*.log")} == {f"{name}.log" for name in NAMES}
    launcher.process.send_signal(signal.SIGINT)
    launcher.end()


def test_threads_are_limited_unless_the_user_says_otherwise(
    chain: Path, launch: Launch, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    launcher = launch(chain)
    launcher.wait_for(lambda: running(launcher))
    environment = psutil.Process(launcher.child("relay").pid).environ()
    assert (environment["OMP_NUM_THREADS"], environment["MKL_NUM_THREADS"]) == ("1", "3")
    launcher.process.send_signal(signal.SIGINT)
    launcher.end()


def test_under_nohup_a_lost_terminal_ends_nothing(write: Write, runtime: Path, tmp_path: Path) -> None:
    path = write(
        "nodes:\n  ticker: {type: 'graph_nodes:Ticker', keep: [depth],\n"
        f"    params: {{count: 100, sleep: 0.01, marker: '{tmp_path / 'm'}', mark_at: 5}}}}\n"
    )
    launcher = Launcher(path, "--json", before=["nohup"])
    launcher.wait_for((tmp_path / "m").exists)
    launcher.process.send_signal(signal.SIGHUP)
    code, out, err = launcher.end()
    assert code == 0, err
    assert last_json(out)["nodes"]["ticker"]["updates"] == 100


def test_the_table_of_a_run_is_as_wide_as_its_longest_name() -> None:
    """The second column of every row ends where its heading does."""
    from evis.supervisor.report import Report, as_table

    names = ["physics", "interpolator_left_front_corner_camera_of_the_robot", "x"]
    run = {"sim_s": 1.0, "wall_s": 1.0, "rtf": 1.0, "startup_s": 0.0, "args": {}, "random": {}, "left_out": []}
    counts = dict.fromkeys(("events", "keyframes", "frames", "drops", "dropped_events"), 0)
    nodes = {name: {"updates": 17, "ms_per_update": 1.0, "busy_s": 0.0} for name in names}
    head, *rows = as_table(Report({**run, **counts, "nodes": nodes})).splitlines()[-4:]
    ends = {head.index("updates") + len("updates"), *(row.index(" 17 ") + 3 for row in rows)}
    assert len(ends) == 1 and [row.split()[0] for row in rows] == names
