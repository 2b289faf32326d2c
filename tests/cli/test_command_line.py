"""Exit statuses, one-line errors, and help, for every command."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evis.cli import COMMANDS, main
from evis.cli.failure import guarded, one_line
from evis.runtime.hosting.node_call import NodeCall, NodeFailed

Evis = Callable[..., Any]
HEAVY = ("numpy", "zmq", "yaml", "warp", "mujoco", "PIL", "msgpack", "aiohttp", "tqdm")
GRAPH = """
args: {n: {default: 5, min: 1, help: how many}}
nodes:
  ticker: {type: "graph_nodes:Ticker", params: {count: "${n}"}}
  relay: {type: "graph_nodes:Relay", keep: [events]}
"""


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    path = tmp_path / "graph.yaml"
    path.write_text(GRAPH)
    return path


def test_the_overview_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for name, (_, text) in COMMANDS.items():
        assert name in out and text in out
    assert main([]) == 2
    assert main(["--version"]) == 0


def test_the_overview_imports_nothing_heavy() -> None:
    code = "import sys; from evis.cli import main; main(['--help']); print(sorted(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    modules = set(eval(out.splitlines()[-1], {"__builtins__": {}}))
    assert not modules & set(HEAVY)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str, evis: Evis) -> None:
    result = evis(command, "--help")
    assert result.code == 0 and result.err == ""
    assert "example" in result.out and f"evis {command}" in result.out


def test_help_before_a_command_is_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    """It was the overview."""
    for words in (["launch"], ["bag", "play"]):
        assert main([*words, "--help"]) == 0
        own = capsys.readouterr().out
        for ask in ("help", "--help"):
            assert main([ask, *words]) == 0
            assert capsys.readouterr().out == own
    assert main(["help", "lunch"]) == 2 and "did you mean 'launch'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["launch", "spinning_disk", "--record", "disk.raw"],
            "--record: cannot record to disk.raw: what is written is",
        ),
        (["launch", "spinning_disk", "--record", "-"], "--record: cannot record to -"),
        (["bag", "record", "disk.npz"], "cannot record to disk.npz"),
        (["dataset", "make", "rotatio", "--out", "disks"], "there is no recipe rotatio; did you mean 'rotation'?"),
    ],
)
def test_names_that_cannot_be_meant_are_wrong_usage(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(("command", "action"), [("topic", a) for a in ("list", "info", "echo", "hz", "bw", "delay")]
                         + [("node", "list"), ("node", "info")])  # fmt: skip
def test_actions_have_help_with_an_example(command: str, action: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, action, "--help"]) == 0
    assert f"example: evis {command} {action}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["lunch"], "did you mean 'launch'?"),
        (["bag"], "which ACTION? record, play, info, recover, export"),
        (["node"], "which ACTION? list, info"),
        (["launch", "graph.yaml", "--record", ""], "--record is empty"),
        (["events", "simulate", "f.npz", "e.npz", "--save-frames", ""], "--save-frames is empty; name a folder, or"),
        (["events", "measure", "e.npz", "--png="], "--png is empty; name what to write, or leave it out"),
        (["events", "convert", "", "e.npz"], "IN is empty; name a file ("),
        (["events", "fit", "a.raw", ""], "RECORDING is empty"),
        (["bag", "recover", "b.mcap", ""], "OUT is empty; name what to write ("),
        (["bench", "--out", ""], "--out is empty; name a folder"),
        (["camera", "info", "--file", ""], "--file is empty; name a file"),
        (["launch", ""], "FILE|NAME is empty"),
        (["launch", "--frobnicate", "x"], "--frobnicate"),
        (["launch"], "spinning_disk"),
        (["launch", "graph.yaml", "n=3"], "key:=value"),
        (["launch", "graph.yaml", "nn:=3"], "no argument 'nn'; did you mean 'n'?"),
        (["launch", "graph.yaml", "n:=many"], "must be a whole number"),
        (["launch", "graph.yaml", "n:=0"], "the least is 1"),
        (["launch", "graph.yaml", "--duration", "-1"], "--duration"),
        (["launch", "graph.yaml", "--duration", "soon"], "--duration"),
        (["launch", "graph.yaml", "--duratoin", "1"], "no option '--duratoin'; did you mean '--duration'?"),
        (["launch", "graph.yaml", "--n", "3"], "no option '--n'; an argument is written n:=3"),
        (["launch", "graph.yaml", "--kind=x"], "no option '--kind'; an argument is written kind:=x"),
        (["launch", "spinning_disk", "duration:=3"], "it is an option of the command line: --duration 3"),
        (["bag", "export", "a.mcap", "--topc", "/x", "x.npz"], "no option '--topc'; did you mean '--topic'?"),
        (["topic", "echo", "/x", "--cuont", "3"], "no option '--cuont'; did you mean '--count'?"),
        (["launch", "graph.yaml", "--compose", "--split"], "exclude each other"),
        (["launch", "graph.yaml", "--record-topics", "/x"], "--record"),
        (["launch", "graph.yaml", "--record-sync"], "--record-sync needs --record BAG"),
        (["topic"], "ACTION"),
        (["topic", "lst"], "lst"),
        (["run", "camera", "file=x"], "key:=value"),
        (["run", "camra"], "no node type 'camra'; did you mean 'camera'?"),
        (["run", "graph_nodes:Ticker", "cuont:=3"], "did you mean 'count'?"),
        (["run", "camera", "file:=a.raw", "faults:=stall_every=5"], "faults:=stall_every=5 has no effect"),
        (["run", "foxglove", "host:=0.0.0.0"], "host 0.0.0.0 is reachable from other machines: give a token"),
        (["run", "visualizer", "host:=10.0.0.1"], "host 10.0.0.1 is reachable from other machines: give a token"),
        (["run", "visualizer", "token:=with/a/slash"], "token must be 8 to 128 letters"),
        (["run", "camera", "file:="], "file is empty; name one, or leave it out"),
        (["run", "camera", "emulate:="], "emulate is empty; name one, or leave it out"),
        (["launch", "camera", "file:=", "emulate:=evk4"], "file is empty; name one, or leave it out"),
        (["launch", "camera", "serial:="], "serial is empty; name one, or leave it out"),
        (["camera", "info", "--serial", ""], "serial is empty; name one, or leave it out"),
        (["launch", "simulator", "scene:="], "scene is empty; it must be given (world to simulate"),
        (["launch", "replay", "bag:="], "bag is empty; it must be given (the bag to play)"),
        (["launch", "emulated_camera", "emulate:=evk9"], "no camera model 'evk9'; did you mean 'evk4'? (models: evk4,"),
        (["launch", "camera", "emulate:=evk9"], "no camera model 'evk9'; did you mean 'evk4'? (models: evk4,"),
        (["launch", "camera", "emulate:=evk4"], "an emulated evk4 sends a recording"),
        (["launch", "camera", "emulate:=evk4", "file:=a.raw", "faults:=stall"], "no fault 'stall'"),
        (["launch", "camera", "file:=a.raw", "serial:=3"], "a camera is one of file, emulate and serial"),
        (["launch", "camera", "file:=a.raw", "pace:=soon"], "pace is 'soon', must be realtime"),
        (["launch", "spinning_disk", "photoreceptor_noise:=0.1"], "bandwidth_hz 0: it has the photoreceptor's"),
        (["launch", "spinning_disk", "image:=true", "exposure_ms:=400"], "exposure_ms is 400 ms"),
        (["launch", "cart_pole", "action_rate:=7"], "action_rate: 7 Hz is no whole fraction"),
        (["launch", "stereo_room", "imu:=true", "envs:=2"], "imu:=true has no effect: imu is left out, for an Imu"),
        (["launch", "spinning_disk", "labels:=events", "model:=v2e"], "v2e does not say which events noise made"),
        (["launch", "spinning_disk", "interpolator:=auto", "time_tolerance:=1e-3"], "write interpolator:=rigid"),
        (["launch", "nowhere.yaml"], "no launch file or scene 'nowhere.yaml'"),
        (["launch", "nowhere.mcap"], "nowhere.mcap: no such file"),
        (["launch", "spinning_disc.xml"], "no such file; did you mean 'spinning_disk'?"),
        (["launch", "spining_disk"], "did you mean 'spinning_disk'?"),
        (["launch", "spinning_disk", "centre:=5,5"], "centre[0] is 5.0, the most is 0.25"),
        (["launch", "spinning_disk", "centre:=0"], "it must be 2 numbers"),
        (["launch", "spinning_disk", "cameras:="], "cameras is empty; name one"),
        (["launch", "spinning_disk", f"seed:={2**63}"], "the most is 9223372036854775807"),
        (["launch", "spinning_disk", "device:=gpu"], "must be cpu, cuda or cuda:N"),
        (["launch", "spinning_disk", "cameras:=cam1"], "has no camera 'cam1'; did you mean 'cam0'?"),
        (["launch", "spinning_disk", "labels:=contacts"], "moves in closed form and has no contacts"),
        (["launch", "spinning_disk", "labels:=flw"], "no label 'flw'; did you mean 'flow'?"),
        (["launch", "spinning_disk", "interpolator:=none", "tolerance:=1"], "tolerance:=1.0 has no effect"),
        (["launch", "warehouse", "bays:=99"], "scene warehouse: bays is 99, the most is 40"),
        (["launch", "simulator", "scene:=warehose"], "did you mean 'warehouse'?"),
        (["graph", "spining_disk"], "did you mean 'spinning_disk'?"),
        (["graph", "spinning_disk", "--run", "2026"], "--run is for running graphs"),
        (["events", "measure", "a.raw", "--listen", "5"], "--listen is for running graphs"),
        (["events", "measure", "a.raw", "--run", "2026"], "--run is for running graphs"),
        (["events", "measure", "--topic", "/cam0/events", "--from", "1"], "--from is for files"),
        (["events", "measure", "--topic", "/cam0/events", "--to", "1"], "--to is for files"),
        (["events", "measure", "--topic", "/cam0/events", "--size", "8x8"], "--size is for files"),
        (["node", "info", "event_sensr"], "no node or node type 'event_sensr'"),
        (["bench", "buss"], "no subject 'buss'; did you mean 'bus'?"),
        (["camera", "stream", "--emulate", "evk9", "--file", "x.raw"], "did you mean 'evk4'?"),
        (["camera", "stream", "--file", "x.raw", "--pace", "quick"], "--pace is 'quick'"),
        (["camera", "stream", "--file", "x.raw", "--set", "bias_fo=3"], "--set has no effect: a recording is played"),
        (["camera", "info", "--file", "x.raw", "--faults", "busy"], "--faults has no effect: it is for an emulated"),
        (["bag", "export", "a.mcap", "--topic", "/x", "x.doc"], "cannot write '.doc'"),
        (["events", "render", "a.raw", "x.doc"], "can draw .gif, .mp4, .png"),
        (["events", "render", "a.raw", "x.gif", "--dt", "0"], "--dt is 0 ms"),
        (["events", "render", "a.raw", "x.gif", "--tau", "3"], "--tau goes with --style time-surface"),
        (
            ["events", "simulate", "a.npz", "x.raw", "--model", "esim", "--leak-rate", "5"],
            "--leak-rate 5 has no effect",
        ),
        (
            ["events", "simulate", "a.npz", "x.raw", "--model", "evis-paper", "--crossing", "linear"],
            "--crossing linear",
        ),
        (
            ["events", "simulate", "a.npz", "x.raw", "--preset", "davis346", "--model", "esim"],
            "event model esim has no bandwidth_hz",
        ),
        (["events", "simulate", "a.npz", "x.raw", "--crossing", "hermite", "--bandwidth-hz", "9"], "bandwidth_hz"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(words: list[str], part: str, evis_here: Evis, graph: Path) -> None:
    result = evis_here(*words)
    assert result.code == 2 and result.out == ""
    assert part in result.line


def test_a_file_of_no_known_format_is_told_before_an_address_is(evis_here: Evis, tmp_path: Path) -> None:
    (tmp_path / "junk.raw").write_bytes(bytes(range(256)) * 20)
    result = evis_here("view", str(tmp_path / "junk.raw"), "--port", "0", "--once")
    assert result.code == 1 and result.out == ""
    assert "junk.raw: not a recording of a known format" in result.line


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["launch", "graph.yaml", "--record", "no/such/folder/x.mcap"], "no folder 'no/such/folder'"),
        (["topic", "list"], "no graph is running"),
        (["node", "list"], "no graph is running"),
        (["graph"], "no graph is running"),
        (["topic", "list", "--run", "2020"], "no running graph '2020'"),
        (["run", "camera", "file:=missing.raw"], "no file 'missing.raw'"),
        (["run", "graph_nodes:Relay"], "no graph is running"),
    ],
)
def test_failures_are_one_line_and_exit_1(words: list[str], part: str, evis_here: Evis, graph: Path) -> None:
    result = evis_here(*words)
    assert result.code == 1 and result.out == ""
    assert part in result.line
    assert "Traceback" in evis_here(*words, "--debug").err


def test_launch_help_lists_the_arguments_of_a_file(evis_here: Evis, graph: Path) -> None:
    out = evis_here("launch", "graph.yaml", "--help").out
    assert "how many" in out and "default 5" in out


def test_explain_prints_and_runs_nothing(evis_here: Evis, graph: Path) -> None:
    text = evis_here("launch", "graph.yaml", "n:=7", "--explain")
    assert text.code == 0 and "left out" in text.out and "n = 7" in text.out
    body = json.loads(evis_here("launch", "graph.yaml", "--explain", "--json").out)
    assert list(body["nodes"]) == ["ticker", "relay"] and body["args"] == {"n": 5}


def test_options_and_pairs_may_come_in_any_order(evis_here: Evis, graph: Path) -> None:
    result = evis_here("launch", "--json", "graph.yaml", "--no-view", "n:=7", "--explain")
    assert result.code == 0 and json.loads(result.out)["args"] == {"n": 7}


def test_launch_prints_a_table_or_json(evis: Evis, graph: Path) -> None:
    table = evis("launch", "graph.yaml")
    assert table.code == 0 and "5 events" in table.out and "relay" in table.out
    assert table.err == "", "quiet in a pipe"
    body = json.loads(evis("launch", "graph.yaml", "n:=3", "--json").out.splitlines()[-1])
    assert body["events"] == 3
    keys = {"sim_s", "startup_s", "wall_s", "rtf", "events", "keyframes", "frames", "drops", "nodes", "left_out"}
    assert keys <= body.keys()


def test_graph_draws_a_plan(evis_here: Evis, graph: Path, tmp_path: Path) -> None:
    from PIL import Image

    text = evis_here("graph", "graph.yaml").out
    assert text.startswith("flowchart LR") and '"/cam0/depth"' in text
    assert evis_here("graph", "graph.yaml", "--png", "graph.png").code == 0
    with Image.open(tmp_path / "graph.png") as image:
        assert image.format == "PNG" and len(image.getcolors(1 << 24)) > 3
    assert "nowhere/graph.png" in evis_here("graph", "graph.yaml", "--png", "nowhere/graph.png").line


def test_node_info_describes_a_type(evis_here: Evis) -> None:
    body = json.loads(evis_here("node", "info", "graph_nodes:Relay", "--json").out)
    assert body["inputs"] == {"depth": "/{camera}/depth"} and body["params"]["gain"]["unit"] == "px"
    assert "a number with limits" in evis_here("node", "info", "graph_nodes:Relay").out


def test_run_runs_one_source(evis: Evis) -> None:
    result = evis("run", "graph_nodes:Ticker", "count:=4", "--json")
    assert result.code == 0 and json.loads(result.out)["nodes"]["ticker"]["updates"] == 4


def test_doctor_reports_every_check(evis: Evis) -> None:
    result = evis("doctor", "--json")
    body = json.loads(result.out.splitlines()[-1])
    names = {f["name"] for f in body["findings"]}
    assert {"python", "packages", "shared memory", "run directory", "kernels", "libusb"} <= names
    assert result.code == (0 if body["ok"] else 1)


def test_errors_become_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert one_line(ValueError("first\nsecond")) == "first second"
    assert one_line(KeyError("no such topic")) == "no such topic"
    assert one_line(FileNotFoundError(2, "No such file or directory", "x.raw")) == "x.raw: No such file or directory"
    assert one_line(ZeroDivisionError("division by zero")).startswith("ZeroDivisionError: division by zero")

    def interrupted() -> int:
        raise KeyboardInterrupt

    assert guarded("evis x", False, interrupted) == 130
    assert capsys.readouterr().err == "evis x: interrupted\n"


def test_a_node_that_failed_is_named_and_the_class_of_its_error_is_not() -> None:
    """`evis launch` says the same of it. Where the cause is a fault of the code the way to its traceback is told."""

    def failed(cause: Exception) -> str:
        with pytest.raises(NodeFailed) as caught, NodeCall(None, "foxglove.7"):
            raise cause
        return one_line(caught.value)

    assert failed(OSError("port 8765 is taken; choose another")) == "foxglove.7: port 8765 is taken; choose another"
    assert (
        failed(TypeError("an int is no str")) == "foxglove.7: TypeError: an int is no str (--debug shows the traceback)"
    )


def test_a_reader_that_stops_is_no_error(evis: Evis, graph: Path) -> None:
    command = f"{sys.executable} -m evis launch --help | head -1; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "0" and done.stderr == ""


def test_launch_help_names_what_is_installed(capsys: pytest.CaptureFixture[str]) -> None:
    from evis.config import paths
    from nodes.event_sensor.presets import PRESETS

    assert main(["launch", "--help"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert f"launch files: {', '.join(paths.names('launch'))}" in out
    assert f"scenes: {', '.join(paths.names('scenes'))}" in out
    assert f"sensors for preset:=: {', '.join(PRESETS)}" in out


def test_a_folder_that_was_removed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["node", "list"]) == 1
    assert capsys.readouterr().err == "evis: the folder that this runs in was removed; `cd` to another one\n"
