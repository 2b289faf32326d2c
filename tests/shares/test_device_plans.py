"""What is planned for several devices: who gets which environments, cameras and seeds, and what cannot be shared."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

import evis
from evis.config.document import LaunchError
from evis.launch.planner import Options, plan_target
from evis.runtime.plan import Plan

SMALL = {"width": "32", "height": "24"}


def plan(scene: str = "spinning_disk", options: Options | None = None, **given: Any) -> Plan:
    return plan_target(scene, {**SMALL, **given}, options or Options(view=False))


def recorded(*topics: str, grouping: str = "default") -> Options:
    return Options(record="never.mcap", record_topics=topics, view=False, grouping=grouping)


def test_each_device_has_neighbouring_environments_with_their_own_seeds() -> None:
    made = plan(device="cpu,cuda:0,cuda:1", envs="7", seed="10", audit="0")
    of = {k: {n: made.nodes[f"share{k}/{n}"].params for n in ("renderer", "event_sensor")} for k in range(3)}
    assert [of[k]["renderer"]["device"] for k in range(3)] == ["cpu", "cuda:0", "cuda:1"]
    assert [(of[k]["renderer"]["envs"], of[k]["renderer"]["seed"]) for k in range(3)] == [(3, 10), (2, 13), (2, 15)]
    assert [of[k]["event_sensor"]["seed"] for k in range(3)] == [10, 13, 15]
    assert made.nodes["physics"].params["envs"] == 7 and made.nodes["physics"].params["seed"] == 10


@pytest.mark.parametrize("grouping", ["default", "compose"])
def test_a_share_is_a_process(grouping: str) -> None:
    processes = plan(options=recorded(grouping=grouping), device="cpu,cpu", envs="2").processes()
    for k in range(2):
        names = [node.name for node in processes[f"share{k}"]]
        assert names == [f"share{k}/{n}" for n in ("state", "renderer", "interpolator", "event_sensor")]
    rest = {"physics", "join", "sensor", "recorder"} if grouping == "default" else {"graph"}
    assert set(processes) == {"share0", "share1"} | rest


def test_nothing_is_joined_that_nobody_reads() -> None:
    made = plan(device="cpu,cpu", envs="2", audit="0")
    joins = [node for node in made.nodes.values() if node.joins]
    assert joins and all(node.dormant for node in joins), "but a viewer may ask for it"
    assert set(made.open_topics()) == set(plan(envs="2", audit="0").topics), "also for what dormant nodes make of it"
    assert made.nodes["share0/event_sensor"].keep == ["events"]


def test_readers_find_the_topics_of_one_device() -> None:
    one, two = (plan(options=recorded("/*"), device=device, envs="2", labels="flow") for device in ("cpu", "cpu,cpu"))
    assert two.nodes["recorder"].inputs == one.nodes["recorder"].inputs
    assert set(two.open_topics()) == set(one.topics)
    assert {item.what for item in two.left_out} == {item.what for item in one.left_out}
    assert "keyframes" in {item.what for item in plan(device="cpu,cpu", envs="2").left_out}, "luminance alone"
    assert two.random == one.random


def test_a_bag_keeps_the_graph_as_it_was_asked_for() -> None:
    made = plan(device="cpu,cpu", envs="2")
    nodes = yaml.safe_load(made.launch_text)["nodes"]
    assert "renderer" in nodes and not any("share" in name or "join" in name for name in nodes)
    assert {body["params"]["device"] for body in nodes.values() if "device" in body["params"]} == {"cpu,cpu"}


@pytest.mark.parametrize("given", [{"interpolator": "none"}, {"upsampling": "1"}])
def test_the_interpolator_may_be_left_out(given: dict[str, str]) -> None:
    """What the sensor reads is then a share's keyframe, and nothing that nobody makes is dealt out."""
    made = plan(device="cpu,cpu", envs="2", audit="0", **given)
    assert {node.name for node in made.nodes.values() if node.process == "share1"} >= {
        "share1/state", "share1/renderer", "share1/event_sensor",
    }  # fmt: skip
    assert made.nodes["share1/event_sensor"].inputs == {"keyframe": ["/share1/cam0/keyframe"]}
    assert not [name for name in made.nodes if name.endswith(("/frames", "/samples", "/interpolator"))]


def test_what_looks_at_all_environments_is_on_the_first_device() -> None:
    made = plan(options=recorded(), device="cpu,cuda", envs="2")
    assert made.nodes["audit"].params["device"] == "cpu" and made.nodes["audit"].params["envs"] == 2
    assert made.nodes["audit"].inputs["frames"] == ["/cam0/frames"]


def test_cameras_are_shared_where_environments_are_not_enough() -> None:
    made = plan("stereo_room", cameras="left,right", device="cpu,cuda:1")
    for camera, device, process in (("left", "cpu", "share0"), ("right", "cuda:1", "share1")):
        for kind in ("renderer", "interpolator", "event_sensor", "audit"):
            node = made.nodes[f"{kind}_{camera}"]
            assert (node.params["device"], node.process) == (device, process)
    assert set(made.open_topics()) == set(made.topics)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"device": "cpu,cpu"}, "names 2 devices for 1 environment and 1 camera: .* envs:=2"),
        ({"device": "cpu,cpu,cpu", "envs": "2"}, "names 3 devices for 2 environments and 1 camera"),
        ({"device": "cpu,,cpu", "envs": "3"}, "lacks a name beside a comma"),
        ({"device": "cpu,gpu", "envs": "3"}, "device is 'gpu', must be cpu, cuda or cuda:N"),
        ({"device": ",".join(["cpu"] * 17), "envs": "17"}, "names 17 devices, the most is 16"),
        ({"device": "cpu,cpu", "envs": "2", "flow_from": "0.5"}, "flow_from:=0.5 has no effect"),
    ],
)
def test_what_cannot_be_shared_is_told(given: dict[str, str], text: str) -> None:
    with pytest.raises(LaunchError, match=text):
        plan(options=recorded(), **given)


def test_a_simulation_that_is_stepped_has_one_device() -> None:
    with pytest.raises(ValueError, match="device is cpu,cpu: a simulation that is stepped is one process"):
        evis.Simulation("spinning_disk", device="cpu,cpu", envs=2)
