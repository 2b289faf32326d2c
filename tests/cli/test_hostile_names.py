"""Names and texts out of files, devices and nodes reach the terminal as text, never as commands to it."""

import json
import re
from types import SimpleNamespace

import pytest
from mcap.writer import Writer

from evis.cli import main
from evis.cli.failure import guarded
from evis.cli.graph.show import as_text
from evis.console.printable import all_printable, printable, printable_lines
from evis.launch.explain import as_text as explained
from evis.runtime.plan import NodePlan, Plan, TopicPlan
from evis.supervisor.supervisor import Supervisor
from msgs.diagnostics import Diagnostics
from msgs.header import Header

EVIL = "\x1b]0;owned\x07\x1b[2J\x9b31m\r\x7f\u202ename"
"""Sets the title, clears the screen, in 8 bit too; goes back on the line; turns the direction of writing."""
SEEN = r"\x1b]0;owned\x07\x1b[2J\x9b31m\r\x7f\u202ename"


def harmless(text):
    """Nothing but what is to be seen, and ends of lines."""
    return all(line.isprintable() for line in text.split("\n"))


@pytest.fixture
def bag(tmp_path):
    """Every text that an MCAP file has room for is hostile."""
    path = tmp_path / "evil.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library=EVIL)
        schema = writer.register_schema("std_msgs/msg/" + EVIL, "ros2msg", b"string data")
        for topic in ("/" + EVIL, "/plain\nfake/topic 3 10 1.0"):
            channel = writer.register_channel(topic, "cdr", schema, {EVIL: EVIL})
            writer.add_message(channel, 1, b"\0\1\0\0\2\0\0\0a\0", 1)
        known = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        writer.add_message(writer.register_channel("/imu" + EVIL, "cdr", known, {}), 1, b"\0\1\0\0", 1)
        writer.add_metadata(EVIL, {EVIL: EVIL})
        writer.finish()
    return path


def test_every_letter_that_is_to_be_seen_stays():
    for text in ("", "/cam0/events", "Türme, 事件, Ωμέγα 😀", "a\\x1b"):
        assert printable(text) == text
    assert printable(EVIL) == SEEN
    assert printable("a\nb\udcff") == "a\\nb\\udcff"
    assert printable_lines("a\n" + EVIL) == "a\n" + SEEN
    values = {EVIL: [EVIL, 1, (None, EVIL)], "x": {"y": 2.5}}
    assert all_printable(values) == {SEEN: [SEEN, 1, (None, SEEN)], "x": {"y": 2.5}}


def test_info_of_a_hostile_bag(bag, capsys):
    assert main(["bag", "info", str(bag)]) == 0
    out, err = capsys.readouterr()
    assert harmless(out) and harmless(err) and SEEN in out
    assert not [line for line in out.splitlines() if line.startswith("fake")]  # one line per topic, whatever its name
    assert main(["bag", "info", str(bag), "--json"]) == 0
    out, _ = capsys.readouterr()
    assert harmless(out) and "/" + EVIL in json.loads(out)["topics"] and out.isascii()


def test_an_error_that_names_what_is_in_a_file(bag, tmp_path, capsys):
    """The topics of the bag stand in the error; with --debug its text stands in the traceback too."""
    for more in ([], ["--debug"]):
        assert main(["bag", "export", str(bag), "--topic", "/none", str(tmp_path / "x.npz"), *more]) == 1
        out, err = capsys.readouterr()
        assert SEEN[:30] in err and harmless(err) and not out

    def fail():
        raise ValueError(EVIL)

    assert guarded("evis", True, fail) == 1
    assert harmless(capsys.readouterr().err)


def test_info_of_a_hostile_recording(monkeypatch, capsys):
    """What a header says of its sensor, and warnings that quote the file."""
    from evis.cli.events import info

    result = {"serial": EVIL, "warnings": [EVIL], "rate_histogram": {"bin_ns": 1, "counts": []}, EVIL: {EVIL: EVIL}}
    monkeypatch.setattr(info, "run", lambda args: result)
    assert main(["events", "info", "x.raw"]) == 0
    out, _ = capsys.readouterr()
    assert out.count(SEEN) == 5 and harmless(out)


def test_a_message_as_text():
    message = Diagnostics(Header(1, 0, EVIL), node=EVIL, level="ok", text=EVIL, values={EVIL: EVIL})
    assert harmless(as_text(message, False)) and SEEN in as_text(message, True)


def test_what_nodes_and_the_launcher_say(tmp_path):
    """A line of a node's log on its way to the terminal, and the text that --explain prints."""
    lines = []
    plan = Plan(EVIL, "run", str(tmp_path))
    supervisor = Supervisor(plan, say=lines.append)
    log = tmp_path / "node.log"
    log.write_text(f"recorder: the older {EVIL} is now\n", encoding="utf-8")
    child = SimpleNamespace(name="p", log_path=log, nodes=[SimpleNamespace(name="recorder")])
    supervisor._logs.forward([child])
    assert lines and all(map(str.isprintable, lines)) and "owned" in lines[0]
    plan.nodes[EVIL] = NodePlan(EVIL, EVIL, {"path": EVIL}, EVIL)
    plan.topics[EVIL] = TopicPlan(EVIL, "Clock", EVIL, "clock")
    assert harmless(printable_lines(explained(plan)))


@pytest.mark.parametrize("action", ["list", "info", "echo"])
def test_topics_of_a_hostile_graph(action, tmp_path, monkeypatch, capsys):
    from evis.cli.graph import topic as command

    name = "/cam0/events"
    plan = Plan("x", EVIL, str(tmp_path))
    plan.nodes[EVIL] = NodePlan(EVIL, EVIL, {EVIL: EVIL}, EVIL)
    plan.topics[name] = TopicPlan(name, "EventPacket", EVIL, EVIL)
    message = Diagnostics(Header(1, 0, EVIL), node=EVIL, level=EVIL, text=EVIL, values={})
    monkeypatch.setattr(command, "find_run", lambda run: plan)
    monkeypatch.setattr(command, "listen", lambda *_: iter([(0.0, message, EVIL)]))
    assert main(["topic", action, *([name] if action != "list" else [])]) == 0
    out, _ = capsys.readouterr()
    assert out and harmless(out)


@pytest.mark.parametrize("words", [["node", "list"], ["node", "info", EVIL], ["graph"]])
def test_nodes_of_a_hostile_graph(words, tmp_path, monkeypatch, capsys):
    from evis.cli.graph import graph, node

    plan = Plan("x", "run", str(tmp_path))
    plan.nodes[EVIL] = NodePlan(EVIL, EVIL, {EVIL: EVIL}, EVIL)
    message = Diagnostics(Header(1, 0, "wall"), node=EVIL, level=EVIL, text=EVIL, values={EVIL: EVIL})
    for module in (graph, node):
        monkeypatch.setattr(module, "find_run", lambda run: plan)
    monkeypatch.setattr(node, "listen", lambda *_: iter([(0.0, message, EVIL)]))
    assert main(words) == 0
    out, _ = capsys.readouterr()
    assert SEEN in out and harmless(out)


def test_what_a_camera_says_of_itself(monkeypatch, capsys):
    """The strings of a USB device are the device's own."""
    from nodes.camera import find
    from nodes.camera.interface.driver import DeviceInfo

    device = DeviceInfo(EVIL, EVIL, EVIL, 2, 2, "evt3", "device:x")
    monkeypatch.setattr(find, "list_devices", lambda: [device])
    assert main(["camera", "list"]) == 0
    out, _ = capsys.readouterr()
    assert SEEN in out and harmless(out)


def test_no_command_prints_around_it():
    """Escape sequences of our own stand where a line is drawn anew, and nowhere else."""
    from pathlib import Path

    import evis

    root = Path(evis.__file__).parent
    own = [p.relative_to(root).as_posix() for p in root.rglob("*.py") if re.search(r"\\033\[|\\x1b\[", p.read_text())]
    assert own == ["cli/graph/auto.py"]
