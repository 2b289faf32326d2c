"""Launch files: arguments, includes, conditions, loops, and errors that say where and what to write instead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evis.config.document import LaunchError
from evis.launch.arguments import ArgumentError, parse_pairs
from evis.launch.expand import Expanded, expand
from evis.launch.files import load
from evis.launch.planner import Options, plan_file
from evis.runtime.plan import Plan

Write = Callable[..., Path]
OPTIONS: dict[str, Any] = {"duration": None, "record": None, "record_topics": [], "record_sync": False, "view": True}


def expanded(path: Path, **given: Any) -> Expanded:
    return expand(load(path), given, OPTIONS)


def plan(path: Path, **given: Any) -> Plan:
    return plan_file(path, given, Options())


def fails(path: Path, **given: Any) -> str:
    with pytest.raises(LaunchError) as error:
        plan(path, **given)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_arguments_have_types_defaults_and_ranges(write: Write) -> None:
    path = write(
        "args:\n"
        "  n: {default: 3, min: 1, max: 9}\n"
        "  rate: {type: float, default: 30}\n"
        "  twice: {default: '${n * 2}'}\n"
        "  words: {type: list, default: [a, b]}\n"
        "  flag: {default: false}\n"
        "nodes:\n"
        "  x: {type: 'graph_nodes:Ticker'}\n"
    )
    values = expanded(path, n="5", words="u,v", flag="true").values
    assert values == {"n": 5, "rate": 30.0, "twice": "10", "words": ["u", "v"], "flag": True}
    with pytest.raises(ArgumentError, match=r"n is 10, the most is 9"):
        expanded(path, n="10")
    with pytest.raises(ArgumentError, match="must be a whole number"):
        expanded(path, n="many")
    with pytest.raises(ArgumentError, match=r"no argument 'ratee'; did you mean 'rate'\?"):
        expanded(path, ratee="1")


def test_a_required_argument_is_asked_for(write: Write) -> None:
    path = write("args:\n  scene: {type: str, help: the world}\nnodes:\n  x: {type: 'graph_nodes:Ticker'}\n")
    assert "graph.yaml:2" in fails(path) and "scene:=" in fails(path)


def test_conditions(write: Write) -> None:
    path = write(
        "args: {k: {default: 1}, on: {default: true}}\n"
        "nodes:\n"
        "  a: {type: 'graph_nodes:Ticker', if: '${k > 1}', otherwise: 'k is ${k}'}\n"
        "  b: {type: 'graph_nodes:Ticker', params: {camera: b}, unless: '${on}'}\n"
        "  c: {type: 'graph_nodes:Ticker', params: {camera: c}, if: no}\n"
        "  d: {type: 'graph_nodes:Ticker', params: {camera: d}}\n"
    )
    assert [n.name for n in expanded(path).nodes] == ["d"]
    assert expanded(path).absent["a"] == "k is 1"
    assert [n.name for n in expanded(path, k=2, on="false").nodes] == ["a", "b", "d"]


def test_foreach_makes_one_node_per_camera(write: Write) -> None:
    text = (
        "args: {cameras: {default: [left, right]}}\n"
        "nodes:\n"
        "  ticker: {type: 'graph_nodes:Ticker', foreach: {camera: '${cameras}'}, process: eyes,\n"
        "           params: {camera: '${camera}'}}\n"
        "  relay_${camera}: {type: 'graph_nodes:Relay', foreach: {camera: '${cameras}'}, process: 'shared_${camera}',\n"
        "           params: {camera: '${camera}'}, keep: [events]}\n"
    )
    nodes = {n.name: n for n in expanded(write(text)).nodes}
    assert list(nodes) == ["ticker_left", "ticker_right", "relay_left", "relay_right"]
    assert [n.process for n in nodes.values()] == ["eyes_left", "eyes_right", "shared_left", "shared_right"]
    assert [n.params["camera"] for n in nodes.values()] == ["left", "right"] * 2
    one = expanded(write(text), cameras="cam0").nodes
    assert [(n.name, n.process) for n in one] == [("ticker", "eyes"), ("relay_cam0", "shared_cam0")]


def test_an_include_passes_arguments_and_the_includer_changes_defaults(write: Write) -> None:
    write(
        "args:\n"
        "  n: {default: 3, min: 1, max: 50, help: how many}\n"
        "  sleep: {default: 0.5}\n"
        "  marker: {default: ''}\n"
        "nodes:\n"
        "  ticker: {type: 'graph_nodes:Ticker', keep: [depth],\n"
        "           params: {count: '${n}', sleep: '${sleep}', marker: '${marker}'}}\n",
        "inner.yaml",
    )
    outer = write(
        "args: {n: {default: 7}, extra: {default: x}}\ninclude: {file: inner.yaml, args: {marker: 'm_${extra}'}}\n"
    )
    assert list(load(outer).arguments) == ["n", "extra", "sleep"]
    assert load(outer).arguments["n"].param.help == "how many"
    assert expanded(outer).nodes[0].params == {"count": 7, "sleep": 0.5, "marker": "m_x"}
    assert expanded(outer, n="9", sleep="0.25").nodes[0].params["count"] == 9
    with pytest.raises(ArgumentError, match="the most is 50"):
        expanded(outer, n="51")
    with pytest.raises(ArgumentError, match="no argument 'marker'"):
        expanded(outer, marker="y")


def test_what_an_include_has_is_not_taken_for_missing(write: Write) -> None:
    """Its arguments come after those of the includer, and its nodes are not changed by a node of the same name."""
    write("args: {n: {default: 3}}\nnodes: {x: {type: 'graph_nodes:Ticker', keep: [depth]}}\n", "inner.yaml")
    early = write("args: {twice: {default: '${2 * n}', type: int}}\ninclude: inner.yaml\n", "early.yaml")
    with pytest.raises(LaunchError, match=r"early.yaml:1: no argument 'n' before 'twice'; .* as `n: {}`"):
        expanded(early)
    named = write("args: {n: {}, twice: {default: '${2 * n}', type: int}}\ninclude: inner.yaml\n", "named.yaml")
    assert expanded(named).values["twice"] == 6
    again = write("include: inner.yaml\nnodes:\n  x: {params: {count: 1}}\n", "again.yaml")
    with pytest.raises(LaunchError, match=r"again.yaml:3: node 'x' has no `type:`; the included 'x' is changed by arg"):
        expanded(again)


def test_conditional_include_and_namespace(write: Write) -> None:
    write("nodes:\n  ticker: {type: 'graph_nodes:Ticker', keep: [depth]}\n", "inner.yaml")
    outer = write(
        "args: {two: {default: true}}\n"
        "include:\n"
        "  - {file: inner.yaml, namespace: one}\n"
        "  - {file: inner.yaml, namespace: two, if: '${two}'}\n"
    )
    made = plan(outer)
    assert {n.name: n.outputs["depth"] for n in made.nodes.values()} == {
        "one/ticker": "/one/cam0/depth",
        "two/ticker": "/two/cam0/depth",
    }
    assert len(plan(outer, two="false").nodes) == 1


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("nodes:\n  x: {typ: 'graph_nodes:Ticker'}\n", ("graph.yaml:2", "no 'typ'", "'type'")),
        ("node:\n  x: {}\n", ("graph.yaml:1", "no 'node'", "'nodes'")),
        ("nodes:\n  x:\n    type: event_sensr\n", ("graph.yaml:2", "no node type 'event_sensr'")),
        ("nodes:\n  x: {type: 'graph_nodes:Tickr'}\n", ("graph.yaml:2", "'Tickr'", "did you mean 'Ticker'")),
        ("nodes:\n  x: {type: 'graph_nods:Ticker'}\n", ("graph.yaml:2", "no module 'graph_nods'")),
        (
            "nodes:\n  x:\n    type: graph_nodes:Ticker\n    params:\n      count: 1\n      slep: 2\n",
            ("graph.yaml:6", "no parameter 'slep'", "did you mean 'sleep'"),
        ),
        (
            "nodes:\n  x:\n    type: graph_nodes:Relay\n    params:\n      gain: 9\n",
            ("graph.yaml:5", "gain is 9.0 px, the most is 4 px"),
        ),
        (
            "nodes:\n  x:\n    type: graph_nodes:Relay\n    params: {colour: gren}\n",
            ("graph.yaml:4", "did you mean 'green'"),
        ),
        ("args: {n: {defualt: 1}}\nnodes: {}\n", ("graph.yaml:1", "'defualt'", "did you mean 'default'")),
        ("args: {n: {type: integer}}\nnodes: {}\n", ("graph.yaml:1", "no type 'integer'", "int")),
        ("args: {record: {default: 1}}\nnodes: {}\n", ("graph.yaml:1", "'record' cannot be the name")),
        (
            "args: {omega: {default: 1}}\nnodes:\n  x: {type: 'graph_nodes:Ticker', params: {count: '${omgea}'}}\n",
            ("graph.yaml:3", "no argument 'omgea'", "did you mean 'omega'"),
        ),
        ("include: {file: nowhere.yaml}\n", ("graph.yaml:1", "no file 'nowhere.yaml'")),
        ("include:\n  - {file: other.yaml}\n  - 7\n", ("graph.yaml:3", "`file:`")),
        ("include: {file: graph.yaml}\n", ("graph.yaml:1", "includes itself")),
        ("mode: lockstp\nnodes: {}\n", ("graph.yaml:1", "did you mean 'lockstep'")),
        ("nodes:\n  x: {type: a}\n  x: {type: b}\n", ("graph.yaml:3", "'x' stands here twice", "line 2")),
        ("nodes: [1\n", ("graph.yaml:2", "not YAML")),
        ("nodes: {x: {type: ${t}}}\n", ("graph.yaml:1", "needs quotes")),
        ("nodes:\n\tx: {type: a}\n", ("graph.yaml:2", "a tab", "indented with spaces")),
        ("a: &a {b: 1}\nargs:\n  n:\n    <<: *a\n", ("graph.yaml:4", "`<<` joins no maps", "write the keys out")),
        ("args: {a: {default: '${b}'}, b: {default: 1}}\nnodes: {}\n", ("graph.yaml:1", "'b' before 'a'")),
        ("args: {a: {default: 1}, b: {default: '${ab}'}}\nnodes: {}\n", ("graph.yaml:1", "'ab'", "did you mean 'a'")),
        ("- 1\n", ("graph.yaml:1", "a map")),
        ("", ("graph.yaml:1", "empty")),
        ("nodes: {}\n", ("no node",)),
        ("a: &a [*a]\n", ("graph.yaml:1",)),
        ("nodes:\n  x: {type: 'graph_nodes:Ticker', keep: [{depth: 1}]}\n", ("graph.yaml:2", "names of output ports")),
        (
            "nodes:\n  x: {type: 'graph_nodes:Ticker', keep: [dept]}\n",
            ("graph.yaml:2", "no output 'dept'", "did you mean 'depth'"),
        ),
        (
            "nodes:\n  x: {type: 'graph_nodes:Ticker', keep: [depth], remap: {/cam0/dept: /cam1/depth}}\n",
            ("graph.yaml:2", "'/cam0/dept'", "did you mean '/cam0/depth'"),
        ),
    ],
)
def test_mistakes_are_named_with_place_and_remedy(write: Write, text: str, parts: tuple[str, ...]) -> None:
    message = fails(write(text))
    for part in parts:
        assert part in message


@pytest.mark.parametrize(
    "name, entry", [("''", ""), ('"a\\0"', ""), ("n" * 201, ""), ("a", "process: ''"), ("a", "process: " + "ä" * 101)]
)
def test_what_cannot_be_called_so_is_refused(write: Write, name: str, entry: str) -> None:
    """Log files and sockets are called after nodes and processes; the system says less of it, and later."""
    text = f"nodes:\n  ? {name}\n  : {{type: 'graph_nodes:Ticker', keep: [depth], {entry}}}\n"
    assert "bytes of printable characters" in fails(write(text))


def test_a_hostile_file_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    path.write_bytes(b"\xff\xfe\x00nodes")
    assert "graph.yaml" in fails(path)
    path.write_text("!!python/object/apply:os.system ['true']")
    assert "graph.yaml:1" in fails(path)
    path.write_text("x: " + "[" * 200 + "]" * 200)
    assert "graph.yaml:1" in fails(path)
    path.write_text("a" * (2 << 20))
    assert "not a launch file" in fails(path)
    assert "cannot be read" in fails(tmp_path / "missing.yaml")


@given(st.text(max_size=200))
@settings(max_examples=150, deadline=None)
def test_any_text_is_a_graph_or_a_launch_error(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_text(text, encoding="utf-8", errors="ignore")
    with pytest.raises(LaunchError):  # no text of hypothesis names a node that exists
        plan(path)


def test_pairs() -> None:
    assert parse_pairs(["a:=1", "b:=x:=y", "c:="]) == {"a": "1", "b": "x:=y", "c": ""}
    for word in ("a=1", ":=1", "a"):
        with pytest.raises(ArgumentError, match="key:=value"):
            parse_pairs([word])


def test_the_resolved_file_makes_the_same_graph(write: Write) -> None:
    path = write(
        "args: {n: {default: 4}, cams: {default: [a, b]}}\n"
        "nodes:\n"
        "  t: {type: 'graph_nodes:Ticker', foreach: {c: '${cams}'}, params: {camera: '${c}', count: '${n}'}}\n"
        "  r: {type: 'graph_nodes:Relay', foreach: {c: '${cams}'}, params: {camera: '${c}'}, keep: [events],\n"
        "      remap: {depth: '/${c}/depth'}}\n"
    )
    first = plan(path, n=9)
    again = plan(write(first.launch_text, "resolved.yaml"))
    assert again.nodes == first.nodes and again.topics == first.topics


@pytest.mark.parametrize("how", ["simulator", "{file: simulator}", "[simulator.yaml]"])
def test_an_include_by_name_is_one_that_comes_with_evis(how: str, write: Write) -> None:
    path = write(f"args: {{scene: {{default: spinning_disk}}}}\ninclude: {how}\n", "mine.yaml")
    assert {"physics", "renderer", "event_sensor"} <= {node.name for node in expanded(path).nodes}


def test_a_file_beside_the_launch_file_comes_before_one_of_evis(write: Write) -> None:
    write("nodes: {own: {type: 'graph_nodes:Ticker'}}\n", "simulator.yaml")
    for name in ("simulator", "simulator.yaml"):
        assert [n.name for n in expanded(write(f"include: {name}\n")).nodes] == ["own"]


def test_a_file_of_the_name_of_what_it_includes(write: Write) -> None:
    path = write("args: {scene: {default: spinning_disk}}\ninclude: simulator\n", "simulator.yaml")
    assert "physics" in {node.name for node in expanded(path).nodes}


def test_an_include_of_no_file_names_the_nearest(write: Write) -> None:
    assert "did you mean 'simulator'?" in fails(write("include: simulater\n"))


def test_nodes_beside_an_include_know_what_it_has_found(write: Write) -> None:
    """The scene's cameras, and the size that a preset brings."""
    text = (
        "args: {scene: {default: stereo_room}, preset: {default: dvs128}}\n"
        "include: simulator\n"
        "nodes:\n"
        "  relay: {type: 'graph_nodes:Relay', foreach: {camera: '${cameras}'}, params: {camera: '${camera}'},\n"
        "          otherwise: '${width}', unless: '${width != 128}'}\n"
    )
    made = expanded(write(text))
    assert [node.params["camera"] for node in made.nodes if node.name.startswith("relay")] == ["left", "right"]
    one = expanded(write(text), cameras="right")
    assert [node.params["camera"] for node in one.nodes if node.name.startswith("relay")] == ["right"]


def test_a_loop_over_nothing_is_told(write: Write) -> None:
    other = "  u: {type: 'graph_nodes:Ticker', keep: ['*']}\n"
    text = "nodes:\n  t: {type: 'graph_nodes:Ticker', foreach: {c: []}}\n" + other
    assert {item.what: item.why for item in plan(write(text)).left_out}["t"] == "its `foreach` has nothing to go over"
