"""Several keyframes at once only where nobody waits for one, which the plan says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from composed_runs import LENGTH_S, RECORDED_APART, SMALL, composed, on_gpu

from evis.client.requests import taker
from evis.config.document import LaunchError
from evis.launch.explain import as_text
from evis.launch.planner import Options, plan_file, plan_target
from evis.runtime.plan import COMPOSED


def test_on_a_gpu_one_process_makes_several_at_once(tmp_path: Path) -> None:
    """Who only takes of it, one topic at a time, may be another process; who looks is one."""
    plan = on_gpu("warehouse", record=str(tmp_path / "a.mcap"), labels=["flow"], imu=True)
    awake = {name: node.process for name, node in plan.nodes.items() if not node.dormant}
    graph = ("physics", "renderer", "interpolator", "event_sensor", "labeler")
    apart = ("recorder", "imu", "visualizer")
    assert awake == {**dict.fromkeys(graph, COMPOSED), **{name: name for name in apart}}
    assert plan.single == ""
    assert on_gpu("stereo_room", camera_rate=["right=15"]).single == ""
    assert "several processes" in on_gpu("warehouse", grouping="split").single
    stepped = on_gpu("falling_objects")
    assert stepped.nodes["physics"].process == "physics" and "several processes" in stepped.single
    assert on_gpu("falling_objects", physics="mujoco_warp", envs=2).nodes["physics"].process == COMPOSED
    shared = on_gpu("warehouse", device="cuda:0,cuda:1", envs=2)
    assert {node.process for node in shared.nodes.values() if not node.dormant} >= {"physics", "share0", "share1"}


def test_one_at_a_time_where_another_process_joins_two_topics(tmp_path: Path) -> None:
    """It has no room for the second state before the first keyframe, which comes with the others."""
    file = tmp_path / "apart.yaml"
    options = Options(record=str(tmp_path / "a.mcap"), duration_s=LENGTH_S)
    file.write_text(RECORDED_APART)
    assert plan_file(file, {"batch": 4}, options).single == ""
    labeler = "  labeler: {type: labeler, keep: [labels], params: {labels: [flow]}}\n"
    file.write_text(RECORDED_APART + labeler)
    assert "several processes" in plan_file(file, {}, options).single
    file.write_text(RECORDED_APART + labeler.replace("type: labeler,", "type: labeler, process: here,"))
    assert plan_file(file, {"batch": 4}, options).single == ""


def test_several_at_once_only_where_nobody_waits() -> None:
    assert composed("spinning_disk").single == ""
    assert "several processes" in composed("spinning_disk", "default").single
    assert "pace of the clock" in composed("spinning_disk", pace="realtime").single
    # It has no actuators; who asks for control is told so.
    assert composed("falling_objects").single == ""
    assert set(composed("falling_objects").nodes["physics"].outside) == {"action", "reset"}
    # Until one does, which the process is told of that has all nodes.
    assert composed("robot_arm").single == ""
    assert set(composed("robot_arm").nodes["physics"].outside) == {"action", "reset"}
    assert "a program outside may give /action" in composed("robot_arm").waits
    assert "several processes" in on_gpu("robot_arm").single
    asked = composed("robot_arm", batch=4)
    assert asked.single == ""
    assert list(asked.nodes["physics"].outside) == ["reset"]
    with pytest.raises(ConnectionRefusedError, match=r"robot_arm takes no /action .* makes 4 keyframes at once"):
        taker(asked, "/action")
    assert taker(composed("falling_objects", batch=4), "/action") == "physics", "which says that it has no actuators"
    with pytest.raises(LaunchError, match=r"batch:=4 with envs:=3: environments are a batch already; leave one out"):
        composed("spinning_disk", batch=4, envs=3)
    with pytest.raises(LaunchError, match="batch:=4 makes several keyframes at once, but a realtime graph keeps"):
        composed("spinning_disk", pace="realtime", batch=4)
    stepped = Options(view=False, grouping="compose", stepped=True)
    assert plan_target("spinning_disk", SMALL, stepped).single == "its caller takes one step at a time"


def test_what_comes_of_a_keyframe_may_lag_where_nobody_waits_for_it() -> None:
    """In several processes too, which make keyframes one by one."""
    assert composed("spinning_disk").waits == composed("spinning_disk", "default").waits == ""
    assert on_gpu("falling_objects", envs=4).waits == on_gpu("warehouse", device="cuda:0,cuda:1", envs=4).waits == ""
    assert "pace of the clock" in composed("spinning_disk", pace="realtime").waits
    slower = {"camera_rate": ["right=15"]}
    assert on_gpu("stereo_room", **slower).waits == composed("stereo_room", **slower).waits == ""
    assert "several rates" in composed("stereo_room", "default", **slower).waits
    assert "a program outside may give /action" in composed("robot_arm", "default").waits
    stepped = Options(view=False, grouping="compose", stepped=True)
    assert plan_target("spinning_disk", SMALL, stepped).waits == "its caller takes one step at a time"


def test_explain_says_how_many_or_why_one() -> None:
    def said(*words: Any, **given: Any) -> str:
        lines = as_text(composed(*words, explain=True, **given)).splitlines()
        return lines[lines.index("keyframes at once") + 1].strip()

    assert said("spinning_disk", batch=8) == "8"
    assert said("spinning_disk").startswith("as many as pay")
    assert said("spinning_disk", "default") == "one, for its nodes run as several processes (--compose makes them one)"
