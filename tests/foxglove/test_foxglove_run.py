"""`evis run foxglove` beside a running graph, and the node in a launch file."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_node import ENDED, LIMIT_S, Foxglove
from mcap.reader import make_reader
from websockets.exceptions import ConnectionClosed

NODES = Path(__file__).parents[1] / "launch"
"""Where graph_nodes.py lies, the small nodes of the launch tests."""
GRAPH = """
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 0, sleep: 0.005}, keep: [depth]}
  relay: {type: "graph_nodes:Relay", on_demand: true}
"""
RECORDED = """
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 400, sleep: 0.005}}
  relay: {type: "graph_nodes:Relay"}
  recorder: {type: recorder, params: {path: PATH, topics: ["/cam0/*"]}}
"""
BRIDGE = "  foxglove: {type: foxglove, params: {port: 0}, tap: true}\n"
START_S = 120.0


class Command:
    """A command of evis in a process of its own, and what it says on stderr."""

    def __init__(self, folder: Path, runs: str, *words: str) -> None:
        path = os.pathsep.join(filter(None, (str(NODES), os.environ.get("PYTHONPATH"))))
        self.said = folder / f"{words[0]}.err"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "evis", *words], cwd=folder, stdout=subprocess.DEVNULL,
            stderr=self.said.open("w"), env={**os.environ, "XDG_RUNTIME_DIR": runs, "PYTHONPATH": path},
        )  # fmt: skip

    def address(self) -> str:
        """The address that the node has printed."""
        return until(lambda: re.findall(r"open (ws://\S+) in Foxglove", self.said.read_text()), self)[0]

    def end(self) -> int:
        """Ends it as Ctrl-C does, and gives its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        return self.process.wait(LIMIT_S)


def until(condition: Callable[[], Any], command: Command) -> Any:
    """Waits for something true, as long as a command runs."""
    end = time.monotonic() + START_S
    while not (value := condition()):
        assert command.process.poll() is None and time.monotonic() < end, command.said.read_text()
        time.sleep(0.05)
    return value


@pytest.fixture
def evis(tmp_path: Path) -> Iterator[Callable[..., Command]]:
    """Starts commands, which see no other graph of this machine."""
    started: list[Command] = []
    with tempfile.TemporaryDirectory(prefix="ev", dir="/tmp", ignore_cleanup_errors=True) as runs:

        def start(*words: str) -> Command:
            started.append(Command(tmp_path, runs, *words))
            if words[0] == "launch":
                until(lambda: list(Path(runs).glob("evis/*/plan.json")), started[-1])
            return started[-1]

        yield start
        for command in reversed(started):
            command.end()


def heard_end(client: Foxglove) -> list[str]:
    """The statuses until the server has closed the connection."""
    with pytest.raises(ConnectionClosed):
        while client.hear(START_S):
            pass
    return [status["message"] for status in client.statuses]


def test_beside_a_running_graph(evis: Callable[..., Command], tmp_path: Path) -> None:
    """Also what nobody in the graph makes until it is asked for comes."""
    (tmp_path / "graph.yaml").write_text(GRAPH)
    graph = evis("launch", "graph.yaml")
    bridge = evis("run", "foxglove", "port:=0")
    with Foxglove(bridge.address()) as client:
        client.subscribe("/cam0/depth", "/cam0/events/picture", "/clock")
        for _ in range(3):
            time_ns, payload = client.next("/cam0/depth")
            image = client.decode("/cam0/depth", payload)
            # The ticker writes its number into every pixel, and its number of ms into the stamp.
            assert np.array_equal(np.frombuffer(image.data, "<f4"), np.full(16, time_ns // 1_000_000, np.float32))
        picture = client.read("/cam0/events/picture")
        white = np.frombuffer(picture.data, np.uint8).reshape(4, 4, 3) == 255
        assert not white[0, 0].all() and np.count_nonzero(white.all(-1)) == 15
        assert client.read("/clock")["header"]["clock"] == "sim"
        assert graph.end() == 0
        assert heard_end(client) == [ENDED]
    assert bridge.process.wait(LIMIT_S) == 0


def messages(bag: Path) -> dict[str, list[bytes]]:
    """The bytes of the messages of each topic of a bag, but of the diagnostics, which have times of the machine."""
    found: dict[str, list[bytes]] = {}
    with bag.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            if channel.topic != "/diagnostics":
                found.setdefault(channel.topic, []).append(message.data)
    return found


def test_a_bag_has_the_same_bytes_with_it(evis: Callable[..., Command], tmp_path: Path) -> None:
    """In the launch file, with a client that reads all there is and one that reads nothing of it."""
    for name, more in (("without", ""), ("with", BRIDGE)):
        (tmp_path / f"{name}.yaml").write_text(RECORDED.replace("PATH", f"{name}.mcap") + more)
    plain = evis("launch", "without.yaml")
    assert plain.process.wait(START_S) == 0, plain.said.read_text()
    graph = evis("launch", "with.yaml", "--json")
    with Foxglove(graph.address()) as client, Foxglove(graph.address(), max_queue=1) as stuck:
        stuck.subscribe("/cam0/depth")
        client.subscribe(*client.channels)
        assert client.next("/cam0/depth") and client.next("/cam0/events/meta") and client.next("/diagnostics")
        assert heard_end(client) == [ENDED]
    assert graph.process.wait(LIMIT_S) == 0
    found = messages(tmp_path / "with.mcap")
    assert len(found["/cam0/depth"]) == 400 and found == messages(tmp_path / "without.mcap")
