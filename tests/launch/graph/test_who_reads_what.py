"""The planner: who reads what, what is left out and why, and graphs that cannot work."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from evis.config.document import LaunchError
from evis.launch.explain import as_dict, as_text
from evis.launch.graph.order import data_flow_order
from evis.launch.planner import Options, plan_file, plan_target
from evis.runtime.plan import Plan

Write = Callable[..., Path]
TICKER = "  ticker: {type: 'graph_nodes:Ticker'}\n"
RELAY = "  relay: {type: 'graph_nodes:Relay'}\n"
COLLECTOR = "  collector: {type: 'graph_nodes:Collector'}\n"


def plan(path: Path, options: Options | None = None, **given: Any) -> Plan:
    return plan_file(path, given, options or Options())


def fails(path: Path, options: Options | None = None) -> str:
    with pytest.raises(LaunchError) as error:
        plan(path, options)
    return str(error.value)


def why(made: Plan, what: str) -> str:
    return next((item.why for item in made.left_out if item.what == what), "")


def test_a_chain_is_wired_in_data_flow_order(write: Write) -> None:
    made = plan(write("nodes:\n" + COLLECTOR + RELAY + TICKER))
    assert list(made.nodes) == ["ticker", "relay", "collector"]
    assert [(e.node, e.port, e.kind) for e in made.topics["/cam0/depth"].edges] == [("relay", "depth", "lockstep")]
    assert made.topics["/cam0/events"].node == "relay"
    assert list(made.processes()) == ["ticker", "relay", "collector"]
    assert Plan.load(_saved(made, write)) == made


def _saved(made: Plan, write: Write) -> Path:
    path = write("", "plan.json")
    made.save(path)
    return path


def test_what_nobody_reads_stays_open_for_viewers_only(write: Write) -> None:
    made = plan(write("nodes:\n" + TICKER + RELAY + COLLECTOR))
    assert made.topics["/cam0/ids"].edges == []
    assert "nobody reads" in why(made, "/cam0/ids")


def test_a_node_that_nobody_needs_is_left_out(write: Write) -> None:
    path = write(
        "nodes:\n" + TICKER + RELAY + COLLECTOR + "  other: {type: 'graph_nodes:Relay', params: {camera: cam1},\n"
        "          remap: {depth: /cam0/depth}}\n"
    )
    made = plan(path)
    assert "other" not in made.nodes and "/cam1/events" in why(made, "other")


def test_a_kept_output_is_enough_reason(write: Write) -> None:
    made = plan(write("nodes:\n" + TICKER + "  relay: {type: 'graph_nodes:Relay', keep: [events]}\n"))
    assert set(made.nodes) == {"ticker", "relay"}
    assert made.nodes["relay"].keep == ["events"]


def test_a_graph_that_nobody_reads_is_an_error(write: Write) -> None:
    assert "keep" in fails(write("nodes:\n" + TICKER + RELAY))


def test_needs_follow_the_wanted_outputs(write: Write) -> None:
    text = "nodes:\n" + TICKER + "  picky: {type: 'graph_nodes:Picky', keep: [PORT]}\n"
    events = plan(write(text.replace("PORT", "events")))
    assert events.nodes["picky"].inputs == {"depth": ["/cam0/depth"]}
    assert "labels" not in events.nodes["picky"].outputs, "ids are not connected, so labels cannot be made"
    assert why(events, "mujoco") == "nothing here moves by itself"
    assert why(events, "picky <- /action") == "nobody publishes it"
    assert "nobody reads" in why(events, "/cam0/ids")
    both = plan(write(text.replace("PORT", "events, labels")))
    assert set(both.nodes["picky"].inputs) == {"depth", "ids"}
    assert why(both, "/cam0/ids") == ""


def test_on_demand_nodes_sleep_until_somebody_asks(write: Write) -> None:
    text = (
        "nodes:\n" + TICKER + "  relay: {type: 'graph_nodes:Relay', remap: {labels: /cam9/labels}}\n" + COLLECTOR
        + "  labeler: {type: 'graph_nodes:Labeler', on_demand: true, keep: [KEEP]}\n"
        "  recorder: {type: 'graph_nodes:Recorder', params: {topics: '${record_topics}'}}\n"
    )  # fmt: skip
    asleep = plan(write(text.replace("KEEP", "")))
    assert asleep.nodes["labeler"].dormant and "labeler" not in asleep.processes()
    assert [(e.node, e.kind) for e in asleep.topics["/cam0/ids"].edges] == [("labeler", "tap")]
    assert "/cam0/labels" not in asleep.nodes["recorder"].inputs["messages"]
    assert "viewer" in why(asleep, "labeler")
    asked = plan(write(text.replace("KEEP", "labels")))
    assert not asked.nodes["labeler"].dormant and "/cam0/labels" in asked.nodes["recorder"].inputs["messages"]
    recorded = plan(write(text.replace("KEEP", "")), Options(record_topics=("/cam0/labels",)))
    assert not recorded.nodes["labeler"].dormant


def test_a_recorder_reads_the_recorded_topics_or_what_it_is_told(write: Write) -> None:
    path = write(
        "nodes:\n"
        + TICKER
        + RELAY
        + "  recorder: {type: 'graph_nodes:Recorder', params: {topics: '${record_topics}'}}\n"
    )
    assert plan(path).nodes["recorder"].inputs["messages"] == ["/cam0/events", "/cam0/labels", "/diagnostics"]
    some = plan(path, Options(record_topics=("/*/depth",)))
    assert some.nodes["recorder"].inputs["messages"] == ["/cam0/depth"]
    assert "relay" not in some.nodes
    assert "did you mean '/cam0/depth'" in fails(path, Options(record_topics=("/cam0/dept",)))


def test_a_viewer_makes_nothing_necessary(write: Write) -> None:
    view = "  viewer: {type: 'graph_nodes:Viewer', tap: true}\n"
    made = plan(write("nodes:\n" + TICKER + RELAY + COLLECTOR + view))
    assert list(made.nodes)[-1] == "viewer" or "viewer" in made.nodes
    tapped = "  peek: {type: 'graph_nodes:Collector', tap: true}\n"
    made = plan(write("nodes:\n" + TICKER + RELAY + COLLECTOR + tapped))
    assert [(e.node, e.kind) for e in made.topics["/cam0/events"].edges] == [("collector", "lockstep"), ("peek", "tap")]
    assert "keep" in fails(write("nodes:\n" + TICKER + RELAY + tapped))


def test_unpublished_topics_name_the_nearest(write: Write) -> None:
    message = fails(write("nodes:\n" + TICKER + "  relay: {type: 'graph_nodes:Relay', params: {camera: cam1}}\n"
                          "  collector: {type: 'graph_nodes:Collector', params: {camera: cam1}}\n"))  # fmt: skip
    assert "graph.yaml:3" in message and "'relay' reads /cam1/depth" in message and "'/cam0/depth'" in message


def test_two_publishers_of_a_topic_are_named(write: Write) -> None:
    message = fails(write("nodes:\n" + TICKER + "  second: {type: 'graph_nodes:Ticker'}\n" + RELAY + COLLECTOR))
    assert "'second'" in message and "'ticker'" in message and "/cam0/depth" in message


def test_remaps_check_types_and_names(write: Write) -> None:
    relay = "  relay: {type: 'graph_nodes:Relay', remap: {depth: TO}}\n"
    wrong = fails(write("nodes:\n" + TICKER + relay.replace("TO", "/cam0/ids") + COLLECTOR))
    assert "Depth" in wrong and "Ids" in wrong and "graph.yaml:3" in wrong
    unknown = fails(write("nodes:\n" + TICKER + relay.replace("TO", "/cam0/dpth") + COLLECTOR))
    assert "no topic '/cam0/dpth'" in unknown and "/<cam>/depth" in unknown
    other = plan(write("nodes:\n  ticker: {type: 'graph_nodes:Ticker', params: {camera: eye}}\n"
                       + relay.replace("TO", "/eye/depth") + COLLECTOR))  # fmt: skip
    assert other.topics["/eye/depth"].edges[0].node == "relay"


def test_a_cycle_is_named_and_delayed_inputs_break_it(write: Write) -> None:
    loop = fails(write("nodes:\n" + RELAY + COLLECTOR + "  loop: {type: 'graph_nodes:Loop'}\n"))
    assert "relay" in loop and "loop" in loop and "/cam0/events" in loop and "/cam0/depth" in loop and "delayed" in loop


def test_grouping(write: Write) -> None:
    path = write(
        "nodes:\n" + TICKER + "  relay: {type: 'graph_nodes:Relay', process: shared}\n"
        "  collector: {type: 'graph_nodes:Collector', process: shared}\n"
        "  viewer: {type: 'graph_nodes:Viewer', tap: true}\n"
    )
    groups = {p: [n.name for n in nodes] for p, nodes in plan(path).processes().items()}
    assert groups == {"viewer": ["viewer"], "ticker": ["ticker"], "shared": ["relay", "collector"]} or groups == {
        "ticker": ["ticker"], "shared": ["relay", "collector"], "viewer": ["viewer"]}  # fmt: skip
    composed = plan(path, Options(grouping="compose")).processes()
    assert sorted(map(len, composed.values())) == [1, 3]
    split = plan(path, Options(grouping="split")).processes()
    assert all(len(nodes) == 1 for nodes in split.values()) and len(split) == 4


def test_the_plan_prints_and_is_json(write: Write) -> None:
    made = plan(write("nodes:\n" + TICKER + RELAY + COLLECTOR))
    text = as_text(made)
    for part in ("ticker", "/cam0/depth", "ticker -> relay", "left out", "/cam0/ids: nobody reads it"):
        assert part in text
    body = json.loads(json.dumps(as_dict(made)))
    assert body["processes"] == {"ticker": ["ticker"], "relay": ["relay"], "collector": ["collector"]}
    assert {"what", "why"} == set(body["left_out"][0])


def test_files_that_parameters_name_are_looked_for(write: Write, tmp_path: Path) -> None:
    def recorder(target: Path) -> Path:
        return write(
            "nodes:\n" + TICKER + RELAY + f"  r: {{type: 'graph_nodes:Recorder', params: {{path: '{target}'}}}}\n"
        )

    assert plan(recorder(tmp_path / "x.mcap"))
    assert "no folder" in fails(recorder(tmp_path / "nowhere" / "x.mcap"))
    assert "is a folder" in fails(recorder(tmp_path))


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.integers(1, 8).flatmap(
        lambda n: st.tuples(st.just(n), st.sets(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1))))
    )
)
def test_order_against_brute_force(graph: tuple[int, set[tuple[int, int]]]) -> None:
    """Every edge goes forward, or the graph truly has a cycle (transitive closure says so)."""
    n, pairs = graph
    names = [f"n{i}" for i in range(n)]
    edges: dict[str, list[tuple[str, str]]] = {}
    for a, b in pairs:
        edges.setdefault(names[a], []).append((names[b], f"/t{a}"))
    reach = set(pairs)
    for k in range(n):
        reach |= {(a, b) for a in range(n) for b in range(n) if (a, k) in reach and (k, b) in reach}
    cyclic = any((a, a) in reach for a in range(n))
    try:
        order = data_flow_order(names, edges)
    except LaunchError:
        assert cyclic
        return
    assert not cyclic and sorted(order) == sorted(names)
    assert all(order.index(names[a]) < order.index(names[b]) for a, b in pairs)


@pytest.mark.parametrize("sensor", [{"model": "v2e"}, {"photoreceptor_noise": 0.05, "bandwidth_hz": 60.0}])
def test_a_recording_of_all_topics_goes_without_those_that_cannot_be(sensor: dict[str, Any], tmp_path: Path) -> None:
    """A sensor that cannot mark events has no topic of marks; who names it is told why before anything starts."""
    bag = str(tmp_path / "all.mcap")

    def planned(*topics: str, **more: Any) -> Plan:
        return plan_target("spinning_disk", {**sensor, **more}, Options(record=bag, record_topics=topics, view=False))

    marks, reason = "/cam0/signal", "does not say which|light and noise make"
    made, plain = planned("*"), plan_target("spinning_disk", {}, Options(record=bag, record_topics=("*",), view=False))
    recorded = [{t for t in p.topics if any(e.node == "recorder" for e in p.topics[t].edges)} for p in (made, plain)]
    assert marks in recorded[1] and recorded[0] == recorded[1] - {marks}
    assert re.search(reason, why(made, marks)) and ";" not in why(made, marks)
    for topics in ((marks,), ("*/depth", "cam0/sig*")):
        with pytest.raises(LaunchError, match=f"'recorder' reads {marks}, but .*({reason}).*; leave out"):
            planned(*topics)
    with pytest.raises(LaunchError, match=f"'labeler' reads {marks}, but .*({reason})"):
        planned(labels=["events"])
