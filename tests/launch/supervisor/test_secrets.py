"""A secret parameter leaves a run by no way: bag, logs, plan, summary, diagnostics, errors; nor does a random one."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from launcher import HERE, Launcher

from evis.bag.reader import BagReader
from evis.config.document import LaunchError
from evis.config.params import Param, ParamError
from evis.config.secret import HIDDEN, Redactor
from evis.launch.arguments import ArgumentError
from evis.launch.planner import Options, plan_file
from evis.runtime.plan import Plan

TOKEN = "Correct-Horse_9271"
PASSWORD = 'it\'s "quoted": 100 % ä/b'
GRAPH = """
args:
  token: {type: str, default: null}
  password: {type: str, default: null, secret: true}
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: 0, sleep: 0.005}}
  relay: {type: "graph_nodes:Relay", keep: [events]}
  gossip:
    type: "graph_nodes:Gossip"
    tap: true
    params: {password: "${password}", url: "http://127.0.0.1/?token=${token}&more"}
  recorder: {type: recorder, if: "${record}", params: {path: "${record}", topics: ["/diagnostics", "/cam0/depth"]}}
  visualizer: {type: visualizer, tap: true, params: {port: 0, token: "${token}"}}
"""
WAYS = [TOKEN, PASSWORD, "quoted", "it%27s%20"]
"""What would betray a secret, whole or as it is written in JSON, YAML or an address."""


def betrayed(text: str | bytes) -> list[str]:
    """The secrets of the graph above that a text holds."""
    raw = text if isinstance(text, bytes) else text.encode()
    return [way for way in WAYS if way.encode() in raw]


def whole(bag: Path) -> bytes:
    """Every byte of a bag, and of its chunks unpacked."""
    with BagReader(bag) as reader:
        layout = reader.scanner.layout
        chunks = [bytes(reader.scanner.chunk_data(chunk)) for chunk in layout.chunks]
    assert chunks
    return b"".join([bag.read_bytes(), *chunks])


@pytest.fixture
def evis(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """What a command prints, on both ways, whatever it returns; in this process."""
    from evis.cli import main

    monkeypatch.syspath_prepend(str(HERE))

    def run(*words: Any) -> str:
        main([str(word) for word in words])
        return "".join(capfd.readouterr())

    return run


def test_chosen_secrets_are_in_no_artefact(
    write: Callable[..., Path],
    launch: Callable[..., Launcher],
    runtime: Path,
    tmp_path: Path,
    evis: Callable[..., str],
) -> None:
    """Of a recorded run, of what looks at it while it runs, and of what is made of its bag."""
    graph, bag, beside = write(GRAPH), tmp_path / "a.mcap", tmp_path / "beside.mcap"
    words = [f"token:={TOKEN}", f"password:={PASSWORD}", "--record", str(bag)]
    run = launch(graph, *words, "--json")
    run.wait_for(lambda: list((runtime / "evis").glob("*/viewer.json")))
    (folder,) = (runtime / "evis").iterdir()
    logs = run.wait_for(lambda: {p.name: t for p in folder.glob("*.log") if "I call" in (t := p.read_text())})
    seen = {
        "explain": evis("launch", graph, *words[:2], "--explain"),
        "explain --json": evis("launch", graph, *words[:2], "--explain", "--json"),
        "graph --json": evis("graph", "--json"),
        "node info": evis("node", "info", "gossip", "--json") + evis("node", "info", "visualizer"),
        "bag record": evis("bag", "record", beside, "--duration", "0.5"),
        "log": "".join(p.read_text() for p in folder.glob("*.log")),
    }
    run.interrupt()
    code, seen["summary"], seen["stderr"] = run.end()
    assert code == 0, seen["stderr"]
    evis("bag", "recover", bag, tmp_path / "recovered.mcap")
    seen["bag info"] = evis("bag", "info", bag, "--json")
    assert "recorder" not in logs and json.loads(seen["summary"])["args"]["token"] == HIDDEN
    for name in ("a.mcap", "beside.mcap", "recovered.mcap"):
        seen[name] = whole(tmp_path / name)
    assert {name: found for name, text in seen.items() if (found := betrayed(text))} == {}
    # The places where it stood are there, so that the search above had something to find.
    for name in ("explain", "explain --json", "graph --json", "node info", "log", "stderr", "bag info"):
        assert HIDDEN in seen[name], name
    assert HIDDEN.encode() in seen["beside.mcap"]
    assert b"I call http://127.0.0.1/?token=<secret>&more with" in seen["a.mcap"]


def test_a_random_token_reaches_the_user_alone(
    write: Callable[..., Path],
    launch: Callable[..., Launcher],
    runtime: Path,
    tmp_path: Path,
    evis: Callable[..., str],
) -> None:
    """It comes by the control channel: not over /diagnostics, not by the log, not into the bag."""
    bag = tmp_path / "a.mcap"
    run = launch(write(GRAPH), "--record", str(bag), "--json")
    (viewer,) = run.wait_for(lambda: list((runtime / "evis").glob("*/viewer.json")))
    url = json.loads(viewer.read_text())["url"]
    token = url.partition("token=")[2]
    assert len(token) > 16
    said = evis("topic", "echo", "/diagnostics", "-n", "1")
    seen = {p.name: p.read_bytes() for p in viewer.parent.glob("*.log")}
    seen |= {"plan.json": (viewer.parent / "plan.json").read_bytes()}
    seen |= {"node info": evis("node", "info", "visualizer", "--json").encode()}
    run.interrupt()
    code, out, err = run.end()
    assert code == 0 and err.count(f"visualizer: open {url}") == 1
    seen |= {"said": said.encode(), "summary": out.encode(), "bag": whole(bag)}
    assert {name for name, text in seen.items() if token.encode() in text} == set()
    with BagReader(bag) as reader:
        assert list(reader.messages(["/diagnostics"])), "so that the search above had something to find"


def test_a_failure_shows_no_secret(write: Callable[..., Path], launch: Callable[..., Launcher], tmp_path: Path) -> None:
    """Neither the line, nor the summary, nor the lines of the processes that --debug shows."""
    text = GRAPH.replace('&more"}', '&more", fails: true}')
    code, out, err = launch(write(text), f"token:={TOKEN}", f"password:={PASSWORD}", "--json", "--debug").end()
    assert code == 1 and "gossip: I cannot call http://127.0.0.1/?token=<secret>&more" in err
    assert "Traceback" in err and json.loads(out)["error"].startswith("gossip: I cannot call")
    assert "gossip: I write http://127.0.0.1/?token=<secret>&more past Python" in err
    assert betrayed(out + err) == []


def plan(write: Callable[..., Path], **given: str) -> Plan:
    options = Options(record="x.mcap", view=False)
    return plan_file(
        write(GRAPH.replace("tap: true, params: {port", 'tap: true, if: "${view}", params: {port')), given, options
    )


def test_secrets_of_nodes_that_are_left_out(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An argument that only an absent node reads is as secret as that node's parameter."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(HERE))
    made = plan(write, token=TOKEN, password=PASSWORD)
    assert "visualizer" not in made.nodes and made.args["token"] == TOKEN
    assert betrayed(json.dumps(made.redacted().args)) == []
    assert made.redacted().directory == made.directory


@pytest.mark.parametrize("token", ["12345678", TOKEN])
def test_the_resolved_launch_text_can_be_run_again(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, token: str
) -> None:
    """Secret parameters are left out of it; what merely holds one is redacted. A token of digits is no number."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(HERE))
    text = GRAPH.replace("token: {type: str, default: null}", f"token: {{default: {token}}}")
    first = plan_file(write(text), {"password": PASSWORD}, Options(record="x.mcap"))
    assert token not in json.dumps(first.redacted().__dict__, default=vars) and token not in first.launch_text
    again = plan_file(write(first.launch_text, "again.yaml"), {}, Options())
    assert again.nodes["visualizer"].params["token"] is None
    assert again.nodes["gossip"].params["url"] == "http://127.0.0.1/?token=<secret>&more"


def test_a_secret_from_the_environment_or_a_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`ps` shows the name only."""
    param = Param(str, None, "", secret=True, optional=True)
    monkeypatch.setenv("A_TOKEN", TOKEN)
    (tmp_path / "token").write_text(f"{TOKEN}\nsecond line\n")
    assert param.convert("n", "token", "env:A_TOKEN") == TOKEN
    assert param.convert("n", "token", f"file:{tmp_path / 'token'}") == TOKEN
    assert param.convert("n", "token", TOKEN) == TOKEN and param.convert("n", "token", None) is None
    with pytest.raises(ParamError, match="n: token: environment variable NO_TOKEN is not set"):
        param.convert("n", "token", "env:NO_TOKEN")
    with pytest.raises(ParamError, match=r"n: token: .*nothing: No such file"):
        param.convert("n", "token", f"file:{tmp_path / 'nothing'}")
    with pytest.raises(ParamError, match=r"n: token: ~nobody-of-that-name/token: No such file"):
        param.convert("n", "token", "file:~nobody-of-that-name/token")
    (tmp_path / "junk").write_bytes(b"\xff\xfe" * 100)
    with pytest.raises(ParamError, match="not UTF-8"):
        param.convert("n", "token", f"file:{tmp_path / 'junk'}")
    (tmp_path / "zero").write_bytes(b"x" * 5000)
    with pytest.raises(ParamError, match="longer than 4096"):
        param.convert("n", "token", f"file:{tmp_path / 'zero'}")


@pytest.mark.parametrize("value", ["hunter2", {"a": TOKEN}, [TOKEN]])
def test_a_wrong_secret_is_not_shown(value: Any) -> None:
    with pytest.raises(ParamError) as wrong:
        Param(str, None, "", secret=True).convert("n", "token", value)
    assert "hunter2" not in str(wrong.value) and TOKEN not in str(wrong.value)


def test_errors_of_a_launch_file_show_no_secret(
    write: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(HERE))
    with pytest.raises(LaunchError, match="is not a number") as wrong:
        plan_file(write(GRAPH.replace('"${password}"', '"${password + 1}"')), {"password": TOKEN}, Options())
    assert betrayed(str(wrong.value)) == [] and HIDDEN in str(wrong.value)
    alone = GRAPH.replace('url: "http://127.0.0.1/?token=${token}&more"', "url: x")
    alone = alone.replace("tap: true, params: {port", 'tap: true, if: "${view}", params: {port')
    with pytest.raises(ArgumentError, match="token:=<secret> has no effect") as idle:
        plan_file(write(alone), {"token": TOKEN}, Options(view=False))
    assert betrayed(str(idle.value)) == []
    with pytest.raises(LaunchError, match="only a text can be one"):
        plan_file(write("args: {n: {default: 1, secret: true}}\nnodes: {}"), {}, Options())


def test_redactor_takes_all_forms() -> None:
    hide = Redactor([PASSWORD, "abcdefgh", "abcdefgh-longer"])
    forms = [PASSWORD, json.dumps(PASSWORD), repr(PASSWORD), "x=it%27s%20%22quoted%22%3A%20100%20%25%20%C3%A4%2Fb"]
    assert [betrayed(hide.text(form)) for form in forms] == [[], [], [], []]
    assert hide.text("abcdefgh-longer abcdefgh abc") == f"{HIDDEN} {HIDDEN} abc"
    assert hide.value({"abcdefgh": [1, (2.5, "-abcdefgh-"), None]}) == {HIDDEN: [1, (2.5, f"-{HIDDEN}-"), None]}


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o022, 0o027, 0o077])
def test_bags_follow_the_umask_and_the_run_stays_private(umask: int, runtime: Path, tmp_path: Path) -> None:
    """Recorded, recovered, exported: as any other file of the user's. The run's folder is the user's alone."""
    from evis.bag.export.topics import export
    from evis.bag.recover import recover
    from evis.bag.writer import BagWriter
    from evis.supervisor.run_directory import RunDirectory
    from msgs.header import Header
    from msgs.world import Action

    before = os.umask(umask)
    try:
        with BagWriter(tmp_path / "a.mcap") as writer:
            import numpy as np

            writer.write("/action", Action(Header(1), np.zeros((1, 2))))
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
        export(tmp_path / "a.mcap", "/action", tmp_path / "c.jsonl")
        directory = RunDirectory()
        private = [directory.path, directory.path.parent]
        modes = [stat.S_IMODE(path.stat().st_mode) for path in private]
        directory.close()
    finally:
        os.umask(before)
    assert {p.name: stat.S_IMODE(p.stat().st_mode) for p in tmp_path.iterdir()} == dict.fromkeys(
        ("a.mcap", "b.mcap", "c.jsonl"), 0o666 & ~umask
    )
    assert modes == [0o700] * 2
