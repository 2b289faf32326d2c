"""`evis topic pub`, `evis reset` and `evis node list` on a running simulation of physics alone."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from command import environment

from evis.cli.graph.publish import message_of
from evis.cli.parser import UsageError

Evis = Callable[..., Any]
GRAPH = """
mode: realtime
nodes:
  physics: {type: physics, keep: [state], params: {scene: robot_arm, keyframe_rate: 100, envs: 2}}
"""
POSE = ("0.5", "-0.3", "0.8", "0", "-0.2", "0")
LIMIT_S = 60.0


@pytest.fixture(scope="module")
def arm(runtime_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A graph that runs while the tests of this module act on it; gives what it says to its user."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.yaml").write_text(GRAPH)
    with open(folder / "log", "w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "evis", "launch", "arm.yaml"],
            stdout=log, stderr=log, cwd=folder, env=environment(runtime_folder),
        )  # fmt: skip
        end = time.monotonic() + LIMIT_S
        while not list((runtime_folder / "evis").glob("*/physics.door")):
            assert time.monotonic() < end and process.poll() is None
            time.sleep(0.05)
        yield folder / "log"
        process.send_signal(signal.SIGINT)
        assert process.wait(LIMIT_S) == 0


def test_an_action_once_and_at_a_rate(arm: Path, evis_here: Evis) -> None:
    once = evis_here("topic", "pub", "/action", *POSE, "--json")
    assert json.loads(once.out)["sent"] == 1 and once.err == ""
    text = json.dumps([[float(v) for v in POSE], [0.0] * 6])
    many = json.loads(evis_here("topic", "pub", "/action", text, "--rate", "200", "-n", "5", "--json").out)
    assert many["sent"] == 5 and many["stamp_ns"] > json.loads(once.out)["stamp_ns"]
    assert "message(s) on /action, the last from" in evis_here("topic", "pub", "/action", *POSE).out
    end = time.monotonic() + 30.0
    while "its latest action holds" not in arm.read_text():
        assert time.monotonic() < end, arm.read_text()
        time.sleep(0.02)


def test_what_physics_refuses_is_told(arm: Path, evis_here: Evis) -> None:
    result = evis_here("topic", "pub", "/action", "1", "2")
    assert result.code == 1 and "the model takes [2, 6]" in result.line
    result = evis_here("topic", "pub", "/action", "9", *POSE[1:])
    assert result.code == 1 and "9 for actuator 'yaw' of environment 0; its range is" in result.line
    result = evis_here("topic", "pub", "/action", "NaN", *POSE[1:])
    assert result.code == 1 and "it must be finite" in result.line


@pytest.mark.parametrize("topic", ["/actoin", "/state", "/cam0/events"])
def test_a_topic_that_nobody_reads_is_told(arm: Path, evis_here: Evis, topic: str) -> None:
    result = evis_here("topic", "pub", topic, "1")
    assert result.code == 1 and f"arm takes no {topic} from outside: " in result.line
    known = (
        "physics, which the launch file declares, publishes it" if topic == "/state" else "it takes /action and /reset"
    )
    assert known in result.line


def test_a_reset_by_command(arm: Path, evis_here: Evis) -> None:
    body = json.loads(evis_here("reset", "--seed", "7", "--json").out)
    assert body["after_ns"] > 0 and body["seed"] == 7
    assert "environment(s) 0,1 begin anew at the first keyframe after" in evis_here("reset", "--envs", "0,1").out
    assert json.loads(evis_here("topic", "pub", "/reset", '{"envs": [1, 0]}', "--json").out)["sent"] == 1
    result = evis_here("reset", "--envs", "5")
    assert result.code == 1 and "a reset names environment 5; there are environments 0 to 1" in result.line
    assert evis_here("reset", "--envs", "a").code == 2 and evis_here("reset", "--seed", "-3").code == 2
    echoed = evis_here("topic", "echo", "/state", "-n", "1", "--json", "--full", "--timeout", "60")
    assert json.loads(echoed.out)["episodes"] == [3, 3]


def test_the_running_graphs_are_listed(arm: Path, evis_here: Evis) -> None:
    body = json.loads(evis_here("node", "list", "--json").out)
    assert [(row["run"], row["name"], row["mode"]) for row in body["running"]] == [(body["run"], "arm", "realtime")]
    assert f"{body['run']}  arm  realtime" in evis_here("node", "list").out
    from evis.cli.machine.doctor_checks import _run_directory

    assert f"1 graph(s) running: {body['run']} (arm)" in _run_directory().text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["/reset", "3"], "/reset takes `envs` and `seeds`, and not `controls`"),
        (["/reset", '{"seed": 5}'], "/reset takes `envs` and `seeds`, and not `seed`"),
        (["/reset", "--rate", "9", "-n", "3"], "a reset is given once"),
        (["/action", '{"controls": [0], "stamp": 3}'], "/action takes `controls`, and not `stamp`"),
        (["/action", "0", "--rate", "9", "-n", "-3"], "'-3' is no number of messages"),
    ],
)
def test_what_would_mean_something_else_is_not_sent(evis_here: Evis, words: list[str], told: str) -> None:
    """Before a graph is looked for: a reset of all would be what comes of a misspelt one."""
    result = evis_here("topic", "pub", *words)
    assert result.code == 2 and told in result.line


def test_a_topic_that_is_taken_from_outside_cannot_be_read(arm: Path, evis_here: Evis) -> None:
    result = evis_here("topic", "echo", "/action", "-n", "1")
    assert result.code == 1 and "/action is taken from outside the graph" in result.line


def test_without_a_graph_nothing_is_published(evis: Evis) -> None:
    """In place of a long path, as pytest gives, the folder of all runs is taken, where other tests have graphs."""
    with tempfile.TemporaryDirectory(prefix="ev", dir="/tmp") as folder:
        for words in (("topic", "pub", "/action", "1"), ("reset",)):
            result = evis(*words, XDG_RUNTIME_DIR=folder)
            assert result.code == 1 and "no graph is running" in result.line


@pytest.mark.parametrize(
    ("words", "body"),
    [
        (["0.1", "-2"], {"controls": [0.1, -2.0]}),
        (["[[1,", "2]]"], {"controls": [[1, 2]]}),
        (['{"controls": [1]}'], {"controls": [1]}),
        ([], {}),
    ],
)
def test_values_on_the_command_line(words: list[str], body: dict[str, Any]) -> None:
    assert message_of(words) == body


@pytest.mark.parametrize("words", [["up"], ["{"], ['{"controls": "up"}'], ["[[1], [2, 3]]"]])
def test_what_is_no_message_is_refused(words: list[str]) -> None:
    with pytest.raises(UsageError):
        message_of(words)
