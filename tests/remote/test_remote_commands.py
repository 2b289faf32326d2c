"""`evis remote` as two users run it, beside a graph and on another host, which is a folder of runs of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

ROOT = Path(__file__).parents[1]
GRAPH = """
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 0, sleep: 0.05}}
  relay: {type: "graph_nodes:Relay", keep: [events]}
"""
PATHS = os.pathsep.join(map(str, (ROOT / "launch", ROOT.parent)))
LIMIT_S = 60.0
"""For all that is waited for: far more than a loaded machine needs."""


@dataclass
class Host:
    """A host's runs, and the commands that were started on it."""

    runtime: Path
    folder: Path
    started: list[subprocess.Popen[str]] = field(default_factory=list)

    def start(self, *words: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "evis", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            cwd=self.folder,
            env={**os.environ, "XDG_RUNTIME_DIR": str(self.runtime), "PYTHONPATH": PATHS},
        )  # fmt: skip
        self.started.append(process)
        return process

    def run(self, *words: str) -> tuple[int, str, str]:
        process = self.start(*words)
        out, err = process.communicate(timeout=LIMIT_S)
        return process.returncode, out, err

    def close(self) -> None:
        for process in reversed(self.started):
            if process.poll() is None:
                process.terminate()
            try:
                process.communicate(timeout=LIMIT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


def until(condition: Callable[[], Any]) -> Any:
    end = time.monotonic() + LIMIT_S
    while not (value := condition()):
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.05)
    return value


@pytest.fixture
def near_and_far(folders: tuple[Path, Path], tmp_path: Path) -> Iterator[tuple[Host, Host]]:
    """With a pair of keys each, in the one folder that both run in."""
    hosts = Host(folders[0], tmp_path), Host(folders[1], tmp_path)
    for name, host in zip(("near", "far"), hosts):
        assert host.run("remote", "keys", name)[0] == 0
    (tmp_path / "graph.yaml").write_text(GRAPH)
    yield hosts
    for host in reversed(hosts):
        host.close()


def bridged(near: Host, far: Host, topics: str = "") -> tuple[subprocess.Popen[str], ...]:
    """Graph, server and follower, once the graph is there on the other host too."""
    graph = near.start("launch", "graph.yaml", "--json")
    until(lambda: list((near.runtime / "evis").glob("*/plan.json")))
    words = ["remote", "serve", "tcp://127.0.0.1:*", "--key", "near.key_secret", "--allow", "far.key", "--json"]
    server = near.start(*words, *(["--topics", topics] if topics else []))
    assert server.stdout is not None
    address = json.loads(server.stdout.readline())["address"]
    follower = far.start("remote", "follow", address, "--key", "far.key_secret", "--server", "near.key", "--json")
    assert follower.stdout is not None
    assert json.loads(follower.stdout.readline())["topics"]
    return graph, server, follower


def messages_of(bag: Path) -> dict[tuple[str, int], bytes]:
    """Topic and time of each message -> its bytes, by another library."""
    with open(bag, "rb") as file:
        return {(c.topic, m.log_time): m.data for _, c, m in make_reader(file).iter_messages()}


def test_a_bag_there_is_the_bag_here(near_and_far: tuple[Host, Host]) -> None:
    near, far = near_and_far
    graph, server, follower = bridged(near, far, "*/depth")
    words = ["bag", "record", "--topics", "*/depth", "--json"]
    recorders = [host.start(*words[:2], f"{name}.mcap", *words[2:]) for name, host in (("near", near), ("far", far))]
    bags = [near.folder / f"{name}.mcap" for name in ("near", "far")]
    until(lambda: all(bag.exists() for bag in bags))
    sizes = [bag.stat().st_size for bag in bags]
    until(lambda: all(bag.stat().st_size > size + 8_000 for bag, size in zip(bags, sizes)))
    for recorder in recorders:
        recorder.send_signal(signal.SIGINT)
    told = [json.loads(recorder.communicate(timeout=LIMIT_S)[0]) for recorder in recorders]
    assert told[0]["topics"] == told[1]["topics"] and {"/cam0/depth", "/cam0/events"} <= {*told[0]["topics"]}
    here, there = map(messages_of, bags)
    if not any(one.get("lost") for one in told):
        for topic in ("/cam0/depth", "/cam0/events"):
            times = [sorted(time for name, time in bag if name == topic) for bag in (here, there)]
            first, last = max(found[0] for found in times), min(found[-1] for found in times)
            common = [[time for time in found if first <= time <= last] for found in times]
            assert common[0] == common[1] and len(common[0]) > 10
    both = here.keys() & there.keys()
    assert len(both) > 20 and all(here[key] == there[key] for key in both)

    hz = ["topic", "hz", "/cam0/events", "--window", "1", "--json"]
    until(lambda: (done := far.run(*hz))[0] == 0 and json.loads(done[1])["seen"] > 2)
    assert far.run("topic", "echo", "/clock", "-n", "1", "--timeout", "30")[0] == 0
    assert "/cam0/ids" not in json.loads(far.run("topic", "list", "--json")[1])["topics"]
    assert "--topics" in far.run("topic", "echo", "/cam0/ids", "-n", "1")[2]
    code, _, err = far.run("topic", "pub", "/action", "1")
    assert code == 1 and "only programs there can act on it" in err and len(err.splitlines()) == 1
    code, _, err = far.run("reset")
    assert code == 1 and "only programs there can act on it" in err and len(err.splitlines()) == 1
    state = json.loads(far.run("node", "info", f"remote.{follower.pid}", "--json")[1])["state"]
    assert state["messages"] > 0 and state["lost"] == 0

    graph.send_signal(signal.SIGINT)  # what ends here ends there, in order
    assert graph.wait(LIMIT_S) == server.wait(LIMIT_S) == follower.wait(LIMIT_S) == 0
    assert not list((far.runtime / "evis").iterdir())
    assert server.stdout is not None and follower.stdout is not None
    sent, came = json.loads(server.stdout.read()), json.loads(follower.stdout.read())
    assert 20 < came["messages"] <= sent["sent"] and came["lost"] == came["rejected"] == came["breaks"] == 0


def test_ctrl_c_ends_each_in_order(near_and_far: tuple[Host, Host]) -> None:
    near, far = near_and_far
    graph, server, follower = bridged(near, far)
    server.send_signal(signal.SIGINT)
    assert server.wait(LIMIT_S) == 0
    assert follower.stderr is not None
    assert "is broken; waiting" in follower.stderr.readline()  # not the end: it may come back
    follower.send_signal(signal.SIGINT)
    assert follower.wait(LIMIT_S) == 0
    assert not list((far.runtime / "evis").iterdir())
    assert graph.poll() is None


def test_one_clear_error(near_and_far: tuple[Host, Host]) -> None:
    near, _ = near_and_far
    keys = ["--key", "near.key_secret", "--allow", "far.key"]
    cases = [
        (2, "`evis remote keys NAME` makes a pair", ["serve", "tcp://0.0.0.0:7447"]),
        (2, "give --allow", ["serve", "tcp://0.0.0.0:7447", *keys[:2]]),
        (2, "is no address", ["serve", "0.0.0.0:7447", *keys]),
        (1, "no graph is running", ["serve", "tcp://127.0.0.1:*", *keys]),
        (1, "no such file", ["serve", "tcp://127.0.0.1:*", "--key", "none.key_secret", "--allow", "far.key"]),
        (1, "no secret key", ["serve", "tcp://127.0.0.1:*", "--key", "near.key", "--allow", "far.key"]),
        (2, "give --server", ["follow", "tcp://127.0.0.1:7447", *keys[:2]]),
        (2, "must know the port", ["follow", "tcp://127.0.0.1:0", *keys[:2], "--server", "near.key"]),
        (1, "never overwritten", ["keys", "near"]),
        (1, "does not exist", ["keys", "nowhere/near"]),
    ]
    for status, said, words in cases:
        code, out, err = near.run("remote", *words)
        assert (code, out, len(err.splitlines())) == (status, "", 1) and said in err, err
