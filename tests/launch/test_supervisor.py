"""Running graphs: start together, end in order, and leave nothing behind after any kind of death."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
from launcher import LIMIT_S, Launcher

from evis.runtime.plan import Plan
from evis.supervisor.child import Child
from evis.supervisor.supervisor import CAUSE_S, Supervisor

Write = Callable[..., Path]
Launch = Callable[..., Launcher]

CHAIN = """
args:
  n: {default: 0}
  out: {default: ''}
  sleep: {default: 0.001}
  setup_s: {default: 0.0}
  fail_at: {default: -1}
  die_at: {default: -1}
  how: {default: 9}
  once: {default: ''}
  respawn: {default: false}
  marker: {default: ''}
  mark_at: {default: 0}
nodes:
  ticker:
    type: graph_nodes:Ticker
    params:
      {count: "${n}", sleep: "${sleep}", setup_s: "${setup_s}", marker: "${marker}", mark_at: "${mark_at}"}
  relay:
    type: graph_nodes:Relay
    respawn: ${respawn}
    params: {fail_at: "${fail_at}", die_at: "${die_at}", how: "${how}", once: "${once}"}
  collector: {type: "graph_nodes:Collector", params: {path: "${out}"}}
  viewer: {type: "graph_nodes:Viewer", tap: true}
"""
NAMES = {"ticker", "relay", "collector", "viewer"}


@pytest.fixture
def chain(write: Write) -> Path:
    return write(CHAIN)


def running(launcher: Launcher) -> bool:
    """All four processes are there and the graph has gone."""
    return {p.cmdline()[-1] for p in launcher.children() if p.is_running()} == NAMES


def nothing_left(launcher: Launcher, runtime: Path) -> None:
    assert launcher.survivors() == []
    end = time.monotonic() + LIMIT_S
    while (left := list((runtime / "evis").iterdir())) and time.monotonic() < end:
        time.sleep(0.02)
    assert left == [], "the run's directory is gone"
    assert not [name for name in os.listdir("/dev/shm") if "evis" in name]


def last_json(out: str) -> dict[str, Any]:
    return json.loads(out.splitlines()[-1])


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


@pytest.mark.parametrize("count", [0, 3])
def test_what_the_thread_of_a_node_raises_ends_the_run(count: int, write: Write, launch: Launch) -> None:
    """Under way, and where the node ends before anybody looks."""
    path = write(
        "nodes:\n"
        f"  reader: {{type: 'graph_nodes:Threaded', process: both, params: {{count: {count}, sleep: 0.001}}}}\n"
        "  relay: {type: 'graph_nodes:Relay', process: both, keep: [events]}\n"
    )
    code, _, err = launch(path).end()
    assert code == 1 and err.splitlines()[-1] == "evis launch: reader: the serial port is gone"


@pytest.mark.parametrize("limit", [16, 22, 30])
def test_the_limit_of_open_files_is_named(limit: int, chain: Path, runtime: Path) -> None:
    """Where the launcher comes to it, where libzmq aborts, and where it gives an error."""
    command = [sys.executable, "-m", "evis", "launch", str(chain), "n:=5"]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(
        ["prlimit", f"--nofile={limit}", *command], env=environment, capture_output=True, text=True, timeout=LIMIT_S
    )
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "Too many open files" in last, done.stderr
    assert last.endswith(f"; a process may have {limit} (ulimit -n): allow more, as by `ulimit -n 4096`")


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


def test_an_error_in_a_node_is_one_line(chain: Path, launch: Launch, runtime: Path) -> None:
    launcher = launch(chain, "fail_at:=5")
    code, _, err = launcher.end()
    assert code == 1
    assert "evis launch: relay: told to fail at message 5" in err.splitlines()
    assert "Traceback" not in err and "is gone" not in err, "the cause, and not what came of it"
    nothing_left(launcher, runtime)


def test_debug_shows_the_traceback(chain: Path, launch: Launch) -> None:
    code, _, err = launch(chain, "fail_at:=5", "--debug").end()
    assert code == 1 and "Traceback" in err and "relay: told to fail at message 5" in err


@pytest.mark.parametrize(("how", "remedy"), [(signal.SIGKILL, "out of memory"), (signal.SIGSEGV, "native code")])
def test_a_killed_node_is_named_with_signal_and_remedy(
    how: signal.Signals, remedy: str, chain: Path, launch: Launch, runtime: Path, tmp_path: Path
) -> None:
    launcher = launch(chain, "die_at:=20", f"how:={int(how)}", f"out:={tmp_path / 'out'}")
    code, _, err = launcher.end()
    assert code == 1
    line = err.splitlines()[-1]
    assert line.startswith("evis launch: relay was ended by " + how.name) and remedy in line
    assert "relay | my last words" in err, "its last log lines"
    assert (tmp_path / "out").exists(), "the others closed their files"
    nothing_left(launcher, runtime)


def test_kill_9_of_the_launcher_leaves_nothing(chain: Path, launch: Launch, runtime: Path) -> None:
    launcher = launch(chain)
    launcher.wait_for(lambda: running(launcher))
    assert len(list((runtime / "evis").iterdir())) == 1
    launcher.process.kill()
    launcher.process.wait()
    nothing_left(launcher, runtime)


def test_kill_9_of_the_launcher_during_start_leaves_nothing(chain: Path, launch: Launch, runtime: Path) -> None:
    launcher = launch(chain, "setup_s:=600")
    launcher.wait_for(lambda: launcher.children())
    launcher.process.kill()
    launcher.process.wait()
    nothing_left(launcher, runtime)


def test_what_a_dead_run_left_is_swept_at_the_next_start(chain: Path, launch: Launch, runtime: Path) -> None:
    left = runtime / "evis" / "20200101-000000-dead"
    left.mkdir(parents=True)
    (left / "lock").touch()
    (left / "plan.json").touch()
    launcher = launch(chain, "n:=3")
    assert launcher.end()[0] == 0
    nothing_left(launcher, runtime)


def test_sigterm_of_the_launcher_is_a_ctrl_c(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}")
    launcher.wait_for(lambda: (tmp_path / "m").exists())
    launcher.process.terminate()
    assert launcher.end()[0] == 0
    assert (tmp_path / "out").read_text().split()[-1] == "ended"
    nothing_left(launcher, runtime)


def test_a_frozen_process_is_noticed_and_ended(write: Write, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    marker = tmp_path / "m"
    path = write(f"nodes:\n  ticker: {{type: 'graph_nodes:Ticker', keep: [depth],\n"
                 f"    params: {{count: 0, sleep: 0.01, marker: '{marker}'}}}}\n")  # fmt: skip
    launcher = launch(path)
    launcher.wait_for(marker.exists)
    launcher.child("ticker").send_signal(signal.SIGSTOP)
    code, _, err = launcher.end()
    assert code == 1 and "ticker" in err and "no sign of life" in err
    nothing_left(launcher, runtime)


def test_a_launcher_that_was_held_up_takes_nobody_for_silent(
    tmp_path: Path,
) -> None:
    """After Ctrl-Z and `fg` a heartbeat is old only by the time in which this process could have heard another."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    child = supervisor._children["ticker"] = Child("ticker", [], tmp_path)
    now = time.monotonic()
    supervisor._last_turn_at, child.heard_at = now - 100.0, now - 100.3
    supervisor._excuse_own_pause()
    assert now - 0.4 < child.heard_at <= time.monotonic()
    child.heard_at = now - 100.0
    supervisor._excuse_own_pause()
    assert child.heard_at == now - 100.0


def test_who_is_silent_is_named_before_who_misses_it(tmp_path: Path) -> None:
    """The bus gives up a frozen process sooner than the supervisor does; then its neighbours leave, one by one."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    for name, silent_s in ("ticker", 6.0), ("relay", 0.1), ("collector", 1.0):
        child = supervisor._children[name] = Child(name, [], tmp_path, state="running", stats={"stamp_ns": 1})
        child.process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        child.heard_at = time.monotonic() - silent_s
    relay = supervisor._children["relay"]
    relay.state, relay.failure = "failed", ("relay", "collector:events is gone: it died, froze or left (topic /e)")
    try:
        supervisor._failed_at = time.monotonic()
        supervisor._name_cause()
        assert str(supervisor._cause).startswith("ticker: gave no sign of life for 6 s")
        assert supervisor._children["ticker"].process.wait(60) == -signal.SIGKILL
        assert supervisor._children["collector"].alive()
    finally:
        supervisor._kill_all()


def test_who_is_slow_to_die_is_named_before_who_misses_it(tmp_path: Path) -> None:
    """A process that was told to end closes its sockets at once, and takes its time over the rest."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    ticker, relay = (Child(name, [], tmp_path, state="running") for name in ("ticker", "relay"))
    supervisor._children.update(ticker=ticker, relay=relay)
    supervisor._server = SimpleNamespace(send=lambda name, message: None)  # type: ignore[assignment]
    ticker.process = subprocess.Popen([sys.executable, "-c", "input(); exit(143)"], stdin=subprocess.PIPE)
    relay.state, relay.failure = "failed", ("relay", "ticker is gone: it died, froze or left (topic /e); see its log")
    supervisor._failed_at = time.monotonic() - 1.0
    supervisor._end_in_order()
    assert supervisor._cause is None, "ticker's own is still to come"
    ticker.process.communicate(b"\n")
    ticker.state = "failed"
    supervisor._end_in_order()
    assert str(supervisor._cause).startswith("ticker () was ended by SIGTERM")


def test_who_misses_a_neighbour_is_named_where_nothing_else_is_heard(tmp_path: Path) -> None:
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    supervisor._server = SimpleNamespace(send=lambda name, message: None)  # type: ignore[assignment]
    relay = supervisor._children["relay"] = Child("relay", [], tmp_path, state="failed")
    relay.failure = ("relay", "ticker is gone: it died, froze or left (topic /e); see its log")
    supervisor._failed_at = time.monotonic() - CAUSE_S - 1.0
    supervisor._end_in_order()
    assert str(supervisor._cause).startswith("relay: ticker is gone")


def test_a_source_is_started_again_when_it_may(write: Write, launch: Launch, tmp_path: Path) -> None:
    path = write(
        "nodes:\n"
        "  ticker: {type: 'graph_nodes:Ticker', keep: [depth], params: {count: 0, sleep: 0.01}}\n"
        f"  lonely: {{type: 'graph_nodes:Ticker', keep: [depth], respawn: true, params: {{camera: cam1, count: 0,\n"
        f"    sleep: 0.01, marker: '{tmp_path / 'm'}'}}}}\n"
    )
    launcher = launch(path)
    launcher.wait_for((tmp_path / "m").exists)
    first = launcher.child("lonely")
    (tmp_path / "m").unlink()
    first.kill()
    launcher.wait_for((tmp_path / "m").exists)
    assert launcher.child("lonely").pid != first.pid
    launcher.process.send_signal(signal.SIGINT)
    code, _, err = launcher.end()
    assert code == 0 and "lonely was ended by SIGKILL" in err and "started again (1 of 5)" in err


def test_a_process_that_starts_again_has_said_nothing_yet(tmp_path: Path) -> None:
    """What its predecessor said must not shorten the patience with its imports."""
    child = Child("a", [], tmp_path, stats={"events": 3}, busy_s=40.0)
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        child.start(process)
    assert child.stats == {} and child.busy_s == 0 and child.state == "starting"


def test_a_dormant_node_starts_when_a_tool_asks(write: Write, launch: Launch, tmp_path: Path) -> None:
    from evis.cli.graph.attach import find_run, listen

    path = write(
        "nodes:\n"
        "  ticker:\n    type: graph_nodes:Ticker\n    keep: [ids]\n"
        f"    params: {{count: 0, sleep: 0.005, marker: '{tmp_path / 'm'}'}}\n"
        "  relay: {type: 'graph_nodes:Relay', on_demand: true}\n"
    )
    launcher = launch(path)
    launcher.wait_for((tmp_path / "m").exists)
    assert [p.cmdline()[-1] for p in launcher.children()] == ["ticker"]
    seen = [m.header.stamp_ns for _, (_, m, _) in zip(range(3), listen(find_run(None), "/cam0/events", LIMIT_S))]
    assert len(seen) == 3 and seen == sorted(seen)
    assert {p.cmdline()[-1] for p in launcher.children()} == {"ticker", "relay"}
    first = launcher.child("relay")
    first.kill()
    launcher.wait_for(lambda: not first.is_running())  # its launcher has taken note of it
    again = [m.header.stamp_ns for _, (_, m, _) in zip(range(3), listen(find_run(None), "/cam0/events", LIMIT_S))]
    assert len(again) == 3 and again[0] > seen[-1] and launcher.child("relay").pid != first.pid
    launcher.process.send_signal(signal.SIGINT)
    assert launcher.end()[0] == 0


def test_a_topic_that_is_named_to_a_recorder_starts_its_node(write: Write, launch: Launch, tmp_path: Path) -> None:
    """A pattern starts none, and says so."""
    path = write(
        "nodes:\n"
        f"  ticker: {{type: 'graph_nodes:Ticker', keep: [ids], params: {{count: 0, marker: '{tmp_path / 'm'}'}}}}\n"
        "  relay: {type: 'graph_nodes:Relay', on_demand: true}\n"
    )
    launcher = launch(path)
    launcher.wait_for((tmp_path / "m").exists)
    words = [sys.executable, "-m", "evis", "bag", "record", str(tmp_path / "a.mcap"), "--topics"]
    pattern = subprocess.run([*words, "/*/events", "--duration", "0.1"], capture_output=True, text=True)
    assert "/*/events: what starts on demand is recorded where it is named in full" in pattern.stderr
    assert {p.cmdline()[-1] for p in launcher.children()} == {"ticker"}
    with subprocess.Popen([*words, "/cam0/events"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as named:
        launcher.wait_for(lambda: "relay" in {p.cmdline()[-1] for p in launcher.children()})
        named.terminate()  # what a shell starts in the background ignores Ctrl-C
        assert b"publishes" not in named.communicate()[1]
    launcher.process.send_signal(signal.SIGINT)
    assert launcher.end()[0] == 0


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


def test_a_viewer_that_dies_takes_nobody_with_it(chain: Path, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}", "--json")
    launcher.wait_for(lambda: (tmp_path / "m").exists())
    viewer = launcher.child("viewer")
    viewer.kill()
    launcher.wait_for(lambda: not viewer.is_running())  # not even as a zombie: the launcher has noticed
    assert len(launcher.children()) == 3
    launcher.process.send_signal(signal.SIGINT)
    code, _, err = launcher.end()
    assert code == 0 and "viewer was ended by SIGKILL" in err and "goes on without it" in err
    assert (tmp_path / "out").read_text().split()[-1] == "ended"
    nothing_left(launcher, runtime)


def test_a_process_that_cannot_start_is_named(write: Write, launch: Launch, runtime: Path, tmp_path: Path) -> None:
    (tmp_path / "late_failure.py").write_text(
        "from graph_nodes import Ticker\n"
        "class Broken(Ticker):\n"
        "    def setup(self):\n"
        "        raise OSError('the sensor is not plugged in')\n"
    )
    launcher = launch(write("nodes:\n  broken: {type: 'late_failure:Broken', keep: [depth]}\n"))
    code, _, err = launcher.end()
    assert code == 1 and err.splitlines() == ["evis launch: broken: the sensor is not plugged in"]
    nothing_left(launcher, runtime)


def test_a_node_that_is_told_to_end_from_outside_is_named_with_the_signal(
    chain: Path, launch: Launch, runtime: Path, tmp_path: Path
) -> None:
    launcher = launch(chain, f"out:={tmp_path / 'out'}", f"marker:={tmp_path / 'm'}")
    launcher.wait_for((tmp_path / "m").exists)
    launcher.child("relay").send_signal(signal.SIGTERM)
    code, _, err = launcher.end()
    assert code == 1
    told = err.splitlines()[-1]
    assert told.startswith("evis launch: relay was ended by SIGTERM") and "from outside the graph" in told
    assert "status 143" not in err
    nothing_left(launcher, runtime)


def test_what_fails_because_of_the_end_is_not_told_as_its_cause(write: Write, launch: Launch) -> None:
    """An end in the middle of something leaves it half done; what that breaks is a consequence."""
    code, _, err = launch(write("nodes: {torn: {type: 'graph_nodes:Torn', keep: [depth]}}\n")).end()
    assert code == 1 and "released more often" not in err.splitlines()[-1]
    assert err.splitlines()[-1].startswith("evis launch: torn was ended by SIGTERM")


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
