"""Looking at a running graph: lists, echo, rates, and a node attached by hand."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import pytest
from command import environment

from evis.bag.info import describe
from evis.cli.graph.run import run as run_node
from evis.cli.graph.topic_rates import TopicRates
from evis.runtime.plan import Plan
from msgs.diagnostics import Diagnostics
from msgs.header import Header

Evis = Callable[..., Any]
GRAPH = """
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 0, sleep: 0.005}}
  relay: {type: "graph_nodes:Relay", keep: [events]}
"""


LIMIT_S = 60.0
"""For all that is waited for: far more than a loaded machine needs."""


def until(condition: Callable[[], Any]) -> Any:
    """Wait for something true, and give it. What a look at a running graph sees hangs on when it looks."""
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)
    return value


@pytest.fixture(scope="module")
def running(runtime_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A graph that runs while the tests of this module look at it."""
    folder = tmp_path_factory.mktemp("running")
    (folder / "graph.yaml").write_text(GRAPH)
    process = subprocess.Popen(
        [sys.executable, "-m", "evis", "launch", "graph.yaml", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder, env=environment(runtime_folder),
    )  # fmt: skip
    until(lambda: list((runtime_folder / "evis").glob("*/plan.json")))
    yield folder
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, err
    assert json.loads(out.splitlines()[-1])["drops"] == 0


def test_topic_list_and_info(running: Path, evis_here: Evis) -> None:
    body = json.loads(evis_here("topic", "list", "--json").out)
    assert body["topics"] == {
        "/cam0/depth": "Depth", "/cam0/ids": "Ids", "/cam0/events": "EventPacket", "/cam0/labels": "Labels",
        "/clock": "Clock", "/diagnostics": "Diagnostics",
    }  # fmt: skip
    info = json.loads(evis_here("topic", "info", "/cam0/depth", "--json").out)
    (tap,) = info["taps"]
    assert tap.startswith("ipc://") and tap.endswith("/cam0~depth.tap")
    until(Path(tap.removeprefix("ipc://")).exists)
    assert len(json.loads(evis_here("topic", "info", "/clock", "--json").out)["taps"]) > 1  # one of each process
    assert info["publisher"] == "ticker" and [r["node"] for r in info["readers"]] == ["relay"]
    assert "did you mean '/cam0/depth'?" in evis_here("topic", "echo", "/cam0/deth").line


def test_topic_echo_shows_what_is_sent_and_wakes_idle_outputs(running: Path, evis_here: Evis) -> None:
    lines = evis_here("topic", "echo", "/cam0/ids", "-n", "3", "--json", "--full", "--timeout", "60").out.splitlines()
    messages = [json.loads(line) for line in lines]
    assert len(messages) == 3
    for message in messages:  # the ticker writes its number into every pixel, and its number of ms into the stamp
        k = message["header"]["stamp_ns"] // 1_000_000
        assert message["ids"] == [[[k] * 4] * 4]
    text = evis_here("topic", "echo", "/cam0/depth", "-n", "1").out
    assert "float32 [1 4 4]" in text


def _state(evis_here: Evis, node: str) -> dict[str, Any]:
    """What a node said of itself last, once it has been heard."""
    return until(lambda: json.loads(evis_here("node", "info", node, "--json").out)["state"])


def _published(evis_here: Evis) -> int:
    """Messages of /cam0/depth so far, as the ticker counts them."""
    return int(_state(evis_here, "ticker")["published"]["/cam0/depth"])


def _measured(evis_here: Evis, what: str, window: str) -> dict[str, Any]:
    """A measurement in which messages came, in a window that was not cut short by a pause of the machine."""

    def measure() -> dict[str, Any] | None:
        result = evis_here("topic", what, "/cam0/depth", "--window", window, "--json")
        return json.loads(result.out) if result.code == 0 else None

    return until(measure)


def test_rates_are_the_publishers(running: Path, evis_here: Evis) -> None:
    """A tap sees at most 30 messages a second; the rate comes from the sequence numbers, as the ticker counts them.

    The source makes 200 a second at the most, and fewer on a busy machine; where this process is held up, messages that
    waited for it come at once, and the window is measured again.
    """
    before = _published(evis_here)
    body = until(lambda: (b := _measured(evis_here, "hz", "1.5"))["window_s"] > 1 and b["hz"] <= 200 and b)
    # of what comes steadily, as far as the machine lets it
    assert body["hz"] == pytest.approx((body["published"] - 1) / body["window_s"], rel=0.5)
    assert body["published"] > body["seen"] or body["hz"] < 35
    stale = after = _published(evis_here)
    while after == stale:  # until the first heartbeat behind the measurement
        time.sleep(0.05)
        after = _published(evis_here)
    assert body["published"] <= after - before
    assert 64 < _measured(evis_here, "bw", "1")["mean_bytes"] < 64 + 300  # the array, and a header
    delay = _measured(evis_here, "delay", "1")
    assert delay["least_s"] == 0 <= delay["mean_s"] <= delay["most_s"]
    assert "0 message(s)" in evis_here("topic", "hz", "/cam0/labels", "--window", "0.5").line


def test_senders_of_one_topic_are_counted_each_by_its_own_numbers() -> None:
    """Two of 2 messages a second, whose numbers lie apart, as processes send /diagnostics: 8 in 1.75 s."""
    measure = TopicRates()
    for k in range(4):
        measure.add(10 + 0.5 * k, Diagnostics(Header(0, seq=100 + k, clock="wall")), "a")
        measure.add(10.25 + 0.5 * k, Diagnostics(Header(0, seq=7 + k, clock="wall")), "b")
    assert measure.hz() == {"hz": pytest.approx(4), "published": 8, "seen": 8, "window_s": 1.75}


def test_what_comes_in_bursts_is_counted_at_its_rate() -> None:
    """Processes of 1, 3 and 1 nodes, each heard once a second for 3 s, and one heard once: a third of one a second."""
    measure = TopicRates()
    for k in range(3):
        for start, name, nodes in ((10.1, "a", 1), (10.4, "b", 3), (11.1, "c", 1)):
            for j in range(nodes):
                measure.add(start + k + 0.001 * j, Diagnostics(Header(0, seq=nodes * k + j, clock="wall")), name)
    measure.add(13.1, Diagnostics(Header(0, seq=7, clock="wall")), "d")
    assert measure.hz()["hz"] == pytest.approx(1 + 3 + 1 + 1 / 3, rel=1e-3)


def test_bandwidth_counts_what_is_no_array() -> None:
    """Diagnostics have no arrays: what msgpack makes of their fields, twice a second."""
    measure, header = TopicRates(), Header(5, seq=3, clock="wall")
    said = {"node": "physics", "level": "ok", "text": "", "values": {"updates": 7}}
    whole = {"type": "Diagnostics", "version": 1, "header": [5, 3, "wall", 0], "scalars": said, "arrays": []}
    for k in range(3):
        measure.add(10 + 0.5 * k, Diagnostics(replace(header, seq=3 + k), **said))
    assert measure.bw() == {
        "bytes_per_s": pytest.approx(2 * len(msgpack.packb(whole))), "mean_bytes": len(msgpack.packb(whole)), "seen": 3
    }  # fmt: skip


def test_node_list_and_info(running: Path, evis_here: Evis) -> None:
    body = json.loads(evis_here("node", "list", "--json").out)
    assert [n["node"] for n in body["nodes"]] == ["ticker", "relay"]
    info = json.loads(evis_here("node", "info", "relay", "--json").out)
    assert info["inputs"] == {"depth": ["/cam0/depth"]}
    assert until(lambda: _state(evis_here, "relay")["events"] > 0)


def test_graph_of_the_running_one(running: Path, evis_here: Evis) -> None:
    assert '-->|"/cam0/depth"|' in evis_here("graph").out
    assert json.loads(evis_here("graph", "--json").out)["name"] == "graph"


def test_a_node_attaches_by_hand_and_loses_only_for_itself(running: Path, evis: Evis, tmp_path: Path) -> None:
    out = tmp_path / "seen"

    def collect() -> list[int]:
        result = evis("run", "graph_nodes:Collector", f"path:={out}", "--duration", "1", "--json")
        assert result.code == 0, result.err
        stamps = [int(line) for line in out.read_text().split() if line != "ended"]
        return stamps if len(stamps) > 5 else []

    stamps = until(collect)  # on a loaded machine the second may be over before it has joined
    assert stamps == sorted(set(stamps))
    assert "reads /cam7/events, which nobody publishes" in evis("run", "graph_nodes:Collector", "camera:=cam7").line
    assert "would publish /cam0/events, which relay of the" in evis("run", "graph_nodes:Relay").line


def test_a_graph_that_ends_while_a_node_attaches_is_told(runtime_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder is gone with it; that is no fault of the node."""
    monkeypatch.setattr("evis.cli.graph.run.find_run", lambda _: Plan("disk", "run-1", str(runtime_folder / "gone")))
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    words = argparse.Namespace(node="visualizer", pairs=["port:=0"], duration=None, json=False, run=None, debug=False)
    with pytest.raises(ValueError, match=r"^the graph run-1 ended before visualizer was ready$"):
        run_node(words)


def test_a_source_by_hand_ends_after_its_time(evis: Evis) -> None:
    """A ticker has no such parameter of its own: 100 steps a second at the most, and it never ends by itself."""
    result = evis("run", "graph_nodes:Ticker", "count:=0", "sleep:=0.01", "--duration", "0.5", "--json")
    assert result.code == 0, result.err
    assert 0.5 <= json.loads(result.out)["wall_s"] < 5
    for wrong in ("0", "-1", "nan"):
        refused = evis("run", "graph_nodes:Ticker", "--duration", wrong)
        assert refused.code == 2 and "longer than 0" in refused.line


def test_the_run_can_be_named(running: Path, evis_here: Evis) -> None:
    run = json.loads(evis_here("topic", "list", "--json").out)["run"]
    assert evis_here("node", "list", "--run", run[:-2]).code == 0
    assert os.path.basename(run) in evis_here("node", "list", "--run", "nope").line


def test_who_publishes_into_the_void_is_told_so(running: Path, evis: Evis) -> None:
    result = evis("run", "graph_nodes:Loop", "camera:=cam0", "--duration", "0.5", "--json")
    assert result.code == 1  # it would publish what the graph has
    result = evis("run", "graph_nodes:Echo", "--duration", "0.5", "--json")
    assert result.code == 1, result.err
    warning, failure = (line for line in result.err.splitlines() if line)
    assert warning.startswith("evis run: warning: nobody in the running graph reads /cam7/labels of graph_nodes:Echo")
    assert "it takes no topic from outside" in warning and "launch file" in warning
    assert failure == "evis run: nobody read what graph_nodes:Echo published on /cam7/labels"
    assert "/cam7/labels" in json.loads(result.out)["error"]


def test_the_topic_that_the_graph_would_take_is_named() -> None:
    from evis.cli.graph.run import _unread
    from evis.runtime.plan import LeftOut, Plan

    plan = Plan("g", "", "", left_out=[LeftOut("physics <- /action", "nobody publishes it")])
    assert "it would take /action (did you mean '/action'?);" in _unread(plan, "my:Controller", "/actoin")
    assert "physics takes it only in a graph that was started with" in _unread(plan, "my:Controller", "/action")


def test_of_several_graphs_the_one_taken_is_named(
    running: Path, evis: Evis, evis_here: Evis, runtime_folder: Path, tmp_path: Path
) -> None:
    def topics(*words: str) -> tuple[str, str]:
        result = evis_here("topic", "list", "--json", *words)
        return json.loads(result.out)["run"], result.err

    first, told = topics()
    assert told == ""
    (tmp_path / "second.yaml").write_text(GRAPH)
    process = subprocess.Popen(
        [sys.executable, "-m", "evis", "launch", "second.yaml"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=environment(runtime_folder),
    )  # fmt: skip
    try:
        second, told = until(lambda: (found := topics())[0] != first and found)
        (line,) = told.splitlines()
        assert line.startswith(f"evis: 2 running graphs; this is the newest, {second} (second); --run ID takes another")
        assert f"{first} (graph)" in line
        assert topics("--run", first) == (first, "")
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=LIMIT_S)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_recording_that_is_asked_to_end_is_whole(
    name: str, running: Path, runtime_folder: Path, tmp_path: Path
) -> None:
    """`timeout` sends SIGTERM, and that twice; it left a bag without its index."""
    bag = tmp_path / "a.mcap"
    process = subprocess.Popen(
        [sys.executable, "-m", "evis", "bag", "record", str(bag), "--topics", "/cam0/depth", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(runtime_folder),
    )  # fmt: skip
    until(lambda: bag.exists() and bag.stat().st_size > 10_000)
    for _ in range(2):
        process.send_signal(getattr(signal, name))
    out, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, err
    about = describe(bag)
    assert about["problem"] == "" and about["topics"]["/cam0/depth"]["messages"] > 0
    assert json.loads(out)["messages"] == sum(topic["messages"] for topic in about["topics"].values())


def test_echo_ends_with_its_reader(running: Path, runtime_folder: Path) -> None:
    command = f"{sys.executable} -m evis topic echo /cam0/depth | head -1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, env=environment(runtime_folder), timeout=LIMIT_S
    )
    assert done.stdout.splitlines()[-1] == "0" and done.stderr == ""
