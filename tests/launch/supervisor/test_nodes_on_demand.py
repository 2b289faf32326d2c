"""Nodes that sleep until a tool asks for what they make."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from launcher import LIMIT_S
from running_chain import Launch, Write


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
