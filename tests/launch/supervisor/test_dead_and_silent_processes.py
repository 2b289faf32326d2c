"""Whatever dies, hangs or fails: it is named with its cause, what may go on does, and nothing is left behind."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from running_chain import Launch, Write, nothing_left, running

from evis.runtime.plan import NodePlan, Plan
from evis.supervisor.child import Child
from evis.supervisor.supervisor import CAUSE_S, HELD_S, Supervisor


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


def test_a_killed_node_is_named_where_sigchld_is_ignored(chain: Path, launch: Launch) -> None:
    """As by some programs that start others: the system then forgets how a process has ended."""
    code, _, err = launch(chain, "die_at:=20", before=["env", "--ignore-signal=CHLD"]).end()
    assert code == 1 and err.splitlines()[-1].startswith("evis launch: relay was ended by SIGKILL"), err


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


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (signal.SIGSTOP, "evis launch: relay: gave no sign of life for 8 s"),
        (signal.SIGSEGV, "evis launch: both (ticker, relay, collector), in relay, was ended by SIGSEGV; a crash in"),
    ],
)
def test_of_several_nodes_in_a_process_the_one_that_it_is_in_is_named(
    how: signal.Signals, said: str, write: Write, launch: Launch, runtime: Path
) -> None:
    """Whether it stands still, as in native code that gives Python's interpreter to nobody, or dies."""
    path = write(
        "nodes:\n  ticker: {type: 'graph_nodes:Ticker', process: both, params: {count: 0, sleep: 0.001}}\n"
        f"  relay: {{type: 'graph_nodes:Relay', process: both, params: {{die_at: 20, how: {int(how)}}}}}\n"
        "  collector: {type: 'graph_nodes:Collector', process: both}\n"
    )
    launcher = launch(path)
    code, _, err = launcher.end()
    assert code == 1 and err.splitlines()[-1].startswith(said), err
    nothing_left(launcher, runtime)


def test_a_launcher_that_was_held_up_takes_nobody_for_silent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After Ctrl-Z and `fg` a heartbeat is old only by the time in which this process could have heard another."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    child = supervisor._children["ticker"] = Child("ticker", [], tmp_path)
    clock = SimpleNamespace(now_s=1000.0)
    monkeypatch.setattr("evis.supervisor.supervisor.time", SimpleNamespace(monotonic=lambda: clock.now_s))
    supervisor._last_turn_at, child.heard_at = 900.0, 899.7
    supervisor._excuse_own_pause()
    assert child.heard_at == pytest.approx(999.7)
    clock.now_s += 0.9 * HELD_S
    child.heard_at = 900.0
    supervisor._excuse_own_pause()
    assert child.heard_at == 900.0


def test_who_is_silent_is_named_before_who_misses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus gives up a frozen process sooner than the supervisor does; then its neighbours leave, one by one."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    monkeypatch.setattr("evis.supervisor.silence.time", SimpleNamespace(monotonic=lambda: 1000.0))
    for name, silent_s in ("ticker", 6.0), ("relay", 0.1), ("collector", 1.0):
        child = supervisor._children[name] = Child(name, [], tmp_path, state="running", stats={"stamp_ns": 1})
        child.process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        child.heard_at = 1000.0 - silent_s
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


def test_who_is_slow_to_die_is_named_before_who_misses_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that was told to end closes its sockets at once, and takes its time over the rest."""
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)))
    ticker, relay = (Child(name, [], tmp_path, state="running") for name in ("ticker", "relay"))
    supervisor._children.update(ticker=ticker, relay=relay)
    supervisor._server = SimpleNamespace(send=lambda name, message: None)  # type: ignore[assignment]
    ticker.process = subprocess.Popen([sys.executable, "-c", "input(); exit(143)"], stdin=subprocess.PIPE)
    relay.state, relay.failure = "failed", ("relay", "ticker is gone: it died, froze or left (topic /e); see its log")
    monkeypatch.setattr("evis.supervisor.supervisor.time", SimpleNamespace(monotonic=lambda: 1000.0))
    supervisor._failed_at = 999.0
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


@pytest.mark.parametrize("service", [False, True])
def test_a_process_that_cannot_be_started_again_ends_nothing_by_force(
    service: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The others end in order, or go on without it where nothing depends on it; a recorder closes its file."""

    def refused(*_: object) -> None:
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    said: list[str] = []
    supervisor = Supervisor(Plan("test", "run", str(tmp_path)), say=said.append)
    supervisor._running_since = time.monotonic()
    plan = NodePlan("camera", "", {}, "camera", respawn=True)
    camera = Child("camera", [plan], tmp_path, service=service, state="failed", failure=("camera", "it is unplugged"))
    supervisor._children["camera"] = camera
    monkeypatch.setattr("evis.supervisor.child.start_process", refused)
    supervisor._on_failure(camera)
    assert camera.state == "failed" and camera.failure is not None and camera.spared == service
    assert said[0] == "camera: it is unplugged; started again (1 of 5)" and "(5 of 5)" in said[4]
    told = "camera: it cannot be started: Resource temporarily unavailable"
    if service:
        assert said[5:] == [f"{told}; the graph goes on without it"] and not supervisor._failed_at
    else:
        supervisor._name_cause()
        assert said[5:] == [] and supervisor._cause == told


def test_a_process_that_starts_again_has_said_nothing_yet(tmp_path: Path) -> None:
    """What its predecessor said must not shorten the patience with its imports."""
    child = Child("a", [], tmp_path, stats={"events": 3}, busy_s=40.0)
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        child.start(process)
    assert child.stats == {} and child.busy_s == 0 and child.state == "starting"


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
