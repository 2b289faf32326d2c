"""Several keyframes at once: message for message what single ones give, and only where nobody waits for them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launcher import Launcher
from mcap.reader import make_reader

from evis.client.requests import taker
from evis.config.document import LaunchError
from evis.launch.explain import as_text
from evis.launch.planner import WINDOW_AT_ONCE, WINDOW_ON_CPU, Options, plan_file, plan_target
from evis.runtime.executor import Executor
from evis.runtime.node import Node
from evis.runtime.plan import COMPOSED, Plan
from msgs.header import Header, Message
from msgs.world import Reset
from nodes.event_sensor.messages.calls_in_flight import CallsInFlight
from nodes.event_sensor.node import EventSensorNode
from nodes.event_sensor.readout.device_events import DeviceEvents
from nodes.event_sensor.sensor import EventSensor
from nodes.renderer.at_once import MOST, MOST_ON_CPU, at_once, keyframes_of, refined_at_once
from nodes.renderer.renderer import Renderer

SMALL = {"width": 48, "height": 36, "audit": 0}
LENGTH_S = 0.3
Record = tuple[str, Header, dict[str, bytes]]


def composed(scene: str, grouping: str = "compose", explain: bool = False, **given: Any) -> Plan:
    options = Options(duration_s=LENGTH_S, view=False, grouping=grouping, explain=explain)
    return plan_target(scene, {**SMALL, **given}, options)


def published(scene: str, at_state: Callable[[Executor, int], None] | None = None, **given: Any) -> list[Record]:
    """What a composed run publishes on the topics of its camera, in the order of each topic."""
    return run_of(scene, at_state, **given)[0]


def run_of(
    scene: str, at_state: Callable[[Executor, int], None] | None = None, **given: Any
) -> tuple[list[Record], dict[str, dict[str, int]]]:
    """What a composed run publishes on the topics of its camera, in the order of each topic; what its nodes count."""
    plan = composed(scene, **given)
    plan.nodes = {name: node for name, node in plan.nodes.items() if node.process == COMPOSED and not node.dormant}
    plan.topics = {name: topic for name, topic in plan.topics.items() if topic.node in plan.nodes}
    for node in plan.nodes.values():
        node.outside = {}  # no socket where tests that run beside this one have theirs
    executor = Executor(plan, COMPOSED)
    found: list[Record] = []
    states = 0

    def note(node: Node, port: str, message: Message) -> None:
        nonlocal states
        if port == "state":
            states += 1
            if at_state is not None:
                at_state(executor, states - 1)
        elif port not in ("error", "info"):
            on_host = {n: a if isinstance(a, np.ndarray) else a.numpy() for n, a in message.arrays().items()}
            arrays = {name: array.tobytes() for name, array in on_host.items()}
            found.append((port, message.header, arrays))

    one, many = executor.publish, executor.publish_all

    def publish(node: Node, port: str, message: Message) -> None:
        one(node, port, message)
        note(node, port, message)

    def publish_all(node: Node, port: str, messages: list[Message]) -> None:
        many(node, port, messages)
        for message in messages:
            note(node, port, message)

    executor.publish, executor.publish_all = publish, publish_all  # type: ignore[method-assign, assignment]
    try:
        executor.setup()
        executor.run()
    finally:
        executor.close()
    counts = {name: dict(node["counters"]) for name, node in executor.summary().items()}
    return sorted(found, key=lambda record: (record[0], record[1].seq)), counts


@pytest.mark.parametrize(
    "scene, given",
    [
        ("spinning_disk", {"preset": "davis346", "time_tolerance": 0, "width": 48, "height": 36}),
        ("falling_objects", {"time_tolerance": 0}),
        ("flying_shapes", {}),
        ("balls", {"interpolator": "splat"}),
        ("spinning_disk", {"interpolator": "none", "upsampling": 2, "crossing": "cubic"}),
        ("spinning_disk", {"time_tolerance": 0, "colour": True, "supersampling": 2}),
        pytest.param("balls", {"time_tolerance": 0.0002, "margin": 3}, marks=pytest.mark.slow),
        pytest.param(
            "fidget_spinner",
            {"time_tolerance": 0.0005, "refractory_us": 300, "leak_rate": 2, "bandwidth_hz": 900},
            marks=pytest.mark.slow,
        ),
        ("spinning_disk", {"time_tolerance": 0.0005, "colour": True}),
        ("spinning_disk", {"time_tolerance": 0.0005, "supersampling": 2, "margin": 2}),
    ],
)
def test_every_message_is_the_same(scene: str, given: dict[str, Any]) -> None:
    """For methods that make several gaps at once and for those that do not, sensors with faults and with look-ahead."""
    want = published(scene, batch=1, **given)
    assert sum(len(arrays["t"]) for port, _, arrays in want if port == "events") > 1000
    for batch in (4, 16):
        assert published(scene, batch=batch, **given) == want


MAINS = """
cameras: {cam0: {position: [0, -1.5, 0], look_at: [0, 0, 0], fov: 45 deg}}
materials: {wall: {albedo: 0.9, texture: {kind: leaves, size: 64, seed: 3}}, a: {albedo: 0.8}}
bodies:
  blade: {motion: {kind: spin, axis: [0, 1, 0], rate: 30}, shapes: [{shape: box, size: [0.9, 0.02, 0.08], material: a}]}
world: [{shape: box, size: [6, 0.1, 5], position: [0, 1, 0], material: wall}]
lights:
  lamp: {kind: point, position: [-0.3, -1.2, 0.4], intensity: 9, flicker: {kind: sine, frequency: 120, depth: 0.8}}
"""


def test_gaps_under_a_lamp_of_the_mains_are_the_same(tmp_path: Path) -> None:
    """32 instants of each of its four periods are just as many as there are, or twice as many, by a nanosecond."""
    scene = tmp_path / "mains.yaml"
    scene.write_text(MAINS)
    given = {"time_tolerance": 0.0005, "upsampling": 8}
    want = published(str(scene), batch=1, **given)
    assert sum(len(arrays["further"]) for port, _, arrays in want if port == "samples") > 10_000
    assert published(str(scene), batch=4, **given) == want


@pytest.mark.gpu
@pytest.mark.parametrize("tolerance", [0, 0.0003])
@pytest.mark.parametrize("scene, preset", [("warehouse", "ideal"), ("tunnel_exit", "davis346")])
def test_every_message_is_the_same_on_a_gpu(scene: str, preset: str, tolerance: float) -> None:
    given = {"device": "cuda", "preset": preset, "time_tolerance": tolerance, "width": 48, "height": 36}
    want = published(scene, batch=1, **given)
    for batch in (4, 16):
        assert published(scene, batch=batch, **given) == want


@pytest.mark.gpu
def test_every_message_of_supersampled_pixels_is_the_same_on_a_gpu() -> None:
    given = {"device": "cuda", "supersampling": 2, "time_tolerance": 0.0003, "width": 48, "height": 36}
    want = published("spinning_disk", batch=1, **given)
    assert published("spinning_disk", batch=4, **given) == want


def of_environment(records: list[Record], env: int) -> np.ndarray:
    """Events of one environment, a row each of t, x, y, p."""
    found = []
    for port, _, arrays in records:
        if port == "events":
            first, end = np.frombuffer(arrays["env_offsets"], np.int64)[env : env + 2]
            kinds = {"t": np.int64, "x": np.uint16, "y": np.uint16, "p": np.uint8}
            found.append(np.stack([np.frombuffer(arrays[name], kind)[first:end] for name, kind in kinds.items()], 1))
    return np.concatenate(found)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
@pytest.mark.parametrize(
    "scene, given",
    [
        ("warehouse", {"preset": "davis346", "upsampling": 4}),
        ("flying_shapes", {"vary": 1}),
        pytest.param("drone", {"refractory_us": 300, "time_tolerance": 0.0005}, marks=pytest.mark.slow),
    ],
)
def test_environments_are_each_as_by_itself(device: str, scene: str, given: dict[str, Any]) -> None:
    """On a GPU their counts and events are fetched when the next gap is under way; alone, they are several gaps at
    once."""
    given = {"device": device, "time_tolerance": 0, **given}
    together, counts = run_of(scene, envs=3, seed=5, **given)
    alone = [run_of(scene, seed=5 + env, **given) for env in range(3)]
    for env, (one, _) in enumerate(alone):
        events = of_environment(one, 0)
        assert len(events) > 1000
        assert np.array_equal(of_environment(together, env), events)
    for node in ("renderer", "interpolator", "event_sensor"):
        assert counts[node] == sum((Counter(own[node]) for _, own in alone), Counter())


def test_environments_of_drawn_sensors_are_each_as_by_itself(tmp_path: Path) -> None:
    """They are sensed one by one in a process in which all else may come several at once."""
    scene = tmp_path / "drawn.yaml"
    scene.write_text(f"{MAINS}sensor: {{threshold: {{from: 0.15, to: 0.3}}}}\n")
    given = {"seed": 5, "upsampling": 2, "interpolator": "splat"}
    together = published(str(scene), envs=2, **given)
    alone = [published(str(scene), **{**given, "seed": 5 + env}) for env in range(2)]
    for env, one in enumerate(alone):
        events = of_environment(one, 0)
        assert len(events) > 1000
        assert np.array_equal(of_environment(together, env), events)
    assert len(of_environment(alone[0], 0)) != len(of_environment(alone[1], 0))


@pytest.mark.parametrize("tolerance", [0, 0.0005])
def test_a_reset_amid_a_batch_is_followed(tolerance: float) -> None:
    """After the states that are made at once, numbers 4 to 7; from there on keyframes are made one by one."""

    def reset_with(number: int, executor: Executor, k: int) -> None:
        if k == number:
            executor.node("physics").receive("reset", Reset(Header(0), np.zeros(0, np.int32), np.zeros(0, np.int64)))

    given = {"time_tolerance": tolerance}
    want = published("spinning_disk", partial(reset_with, 7), batch=1, **given)
    assert {header.episode for _, header, _ in want} == {0, 1}
    for number in (5, 7):
        assert published("spinning_disk", partial(reset_with, number), batch=4, **given) == want


RECORDED_APART = """
args:
  batch: {type: int, default: 1, help: keyframes at once}
nodes:
  physics: {type: physics, process: here, params: {scene: balls, width: 48, height: 36, duration: "${duration}"}}
  renderer:
    {type: renderer, process: here, params: {scene: balls, width: 48, height: 36, samples_apart: true, frame_rate: 240,
      batch: "${batch}"}}
  interpolator:
    {type: interpolator, process: here, params: {scene: balls, width: 48, height: 36, batch: "${batch}"}}
  event_sensor: {type: event_sensor, process: here, keep: [events], params: {source: frames, scene: balls}}
  imu: {type: imu, keep: [imu]}
  recorder: {type: recorder, params: {path: "${record}", topics: "${record_topics}"}}
"""
"""All that makes keyframes in one process; what only takes of it in others."""


@pytest.mark.parametrize("apart", [False, True], ids=["composed", "recorded apart"])
def test_every_topic_of_a_bag_is_the_same(launch: Callable[..., Launcher], tmp_path: Path, apart: bool) -> None:
    """With what single messages count, beside their arrays."""
    found = []
    graph = tmp_path / "apart.yaml"
    graph.write_text(RECORDED_APART)
    for batch in (1, 4):
        bag = tmp_path / f"{batch}.mcap"
        size = ("width:=48", "height:=36", "time_tolerance:=0", "--compose", "--no-view")
        words = (f"batch:={batch}", "--duration", str(LENGTH_S), *(() if apart else size))
        topics = ("--record", str(bag), "--record-topics", "*,/cam0/frames")
        code, out, err = launch(graph if apart else Path("balls"), *words, *topics).end()
        assert code == 0, out + err
        with bag.open("rb") as file:
            messages = list(make_reader(file).iter_messages(log_time_order=False))
        # But for how fast it went.
        found.append(
            [(c.topic, m.log_time, m.data) for _, c, m in messages if c.topic not in ("/clock", "/diagnostics")]
        )
    counts = [re.search(rb'"reshaded": *([0-9]+)', data) for topic, _, data in found[0] if topic == "/cam0/frames/meta"]
    assert sum(count is not None and int(count[1]) > 0 for count in counts) > 5
    assert sorted(found[0]) == sorted(found[1])


def test_who_looks_at_frames_for_a_while_changes_nothing() -> None:
    """Gaps are made one by one meanwhile, so that each message has its own counts."""
    counts: list[int] = []

    def look(executor: Executor, k: int) -> None:
        wants, made = executor.wants, executor.publish
        if k == 3:
            executor.wants = lambda *asked: asked[1:] == ("frames", "reshaded") or wants(*asked)  # type: ignore[method-assign]
        elif k == 6:
            del executor.wants
        elif k == 0:

            def publish(node: Node, port: str, message: Message) -> None:
                made(node, port, message)
                counts.append(getattr(message, "reshaded", 0))

            executor.publish = publish  # type: ignore[method-assign]

    given = {"time_tolerance": 0}
    want = published("balls", batch=1, **given)
    assert published("balls", look, batch=2, **given) == want
    assert sum(count > 0 for count in counts) >= 2


def on_gpu(scene: str, *, grouping: str = "default", **given: Any) -> Plan:
    record = given.pop("record", None)
    options = Options(duration_s=LENGTH_S, view=True, grouping=grouping, record=record)
    return plan_target(scene, {"width": 48, "height": 36, "device": "cuda", **given}, options)


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


@pytest.mark.parametrize("given", [{}, {"time_tolerance": 0.0005, "preset": "davis346", "width": 48, "height": 36}])
def test_who_takes_control_in_a_batch_changes_no_message_before_an_action(given: dict[str, Any]) -> None:
    """And from then on the events of a state are there before the next one."""
    order: list[tuple[int, int]] = []

    def at_state(executor: Executor, k: int) -> None:
        if k == 5:
            executor._take_singly()
        order.append((k, executor.progress()["events"]))

    want = published("robot_arm", batch=1, **given)
    assert published("robot_arm", at_state, **given) == want
    seen = dict(order)
    assert seen[1] == seen[4] == 0, "nothing of a batch before it is there"
    assert seen[6] > 0 and len({seen[k] for k in range(5, 9)}) == 4


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


def test_on_a_cpu_small_pictures_come_several_at_once() -> None:
    """But not those by paths, of which one too many costs more than all else; who asks gets what is asked for."""
    assert at_once("renderer", 0, "cpu", 1, 96 * 72, 8) == 8
    assert at_once("renderer", 0, "cpu", 1, 346 * 260, 8) == 4
    assert at_once("renderer", 0, "cpu", 1, 1280 * 720, 8) == 1
    assert at_once("renderer", 0, "cpu", 1, 96 * 72, 8, paths=True) == 1
    assert at_once("renderer", 3, "cpu", 1, 96 * 72, 8, paths=True) == 3
    assert refined_at_once(8, 0, "cpu", 96 * 72 * 255) == 4
    assert refined_at_once(8, 0, "cpu", 346 * 260 * 255) == 1
    assert refined_at_once(4, 4, "cpu", 346 * 260 * 255) == 4


def test_all_that_are_made_at_once_may_be_under_way() -> None:
    """And two more, so that a recorder in another process does not hold up the batch after them."""
    assert (WINDOW_AT_ONCE, WINDOW_ON_CPU) == (MOST + 2, MOST_ON_CPU + 2)
    assert on_gpu("warehouse").window == WINDOW_AT_ONCE and composed("warehouse").window == WINDOW_ON_CPU


@pytest.mark.gpu
def test_a_short_run_takes_fewer_on_a_gpu() -> None:
    """It would be filled up in the last batch, and its buffers grow in the first."""
    count = lambda run_s, rate: at_once("renderer", 0, "cuda", 1, 1000, 8, keyframes=keyframes_of(run_s, rate))
    assert [count(*run) for run in ((1, 30), (12, 30), (16, 30), (4, 125), (None, 30))] == [8, 16, 32, 32, 32]


@pytest.mark.gpu
def test_a_recorded_run_takes_fewer_on_a_gpu() -> None:
    """Its recorder would wait for the events of a batch, and then be waited for."""
    assert [at_once("renderer", 0, "cuda", 1, 1000, 8, recorded=recorded) for recorded in (False, True)] == [32, 8]


def test_nodes_are_told_of_a_recorder(tmp_path: Path) -> None:
    recorded = plan_target("spinning_disk", SMALL, Options(view=False, record=str(tmp_path / "a.mcap")))
    assert recorded.recorded and not composed("spinning_disk").recorded
    node = recorded.nodes["event_sensor"]
    plan = replace(recorded, directory="", topics={}, nodes={"event_sensor": replace(node, inputs={}, outputs={})})
    executor = Executor(plan, node.process)
    try:
        executor._introduce(host := executor._hosts["event_sensor"])
        assert host.node.recorded
    finally:
        executor.close()


def test_a_graph_of_small_pictures_takes_several_on_a_cpu() -> None:
    taken: list[int] = []
    plan = composed("spinning_disk", time_tolerance=0)
    plan.nodes = {name: node for name, node in plan.nodes.items() if node.process == COMPOSED and not node.dormant}
    plan.topics = {name: topic for name, topic in plan.topics.items() if topic.node in plan.nodes}
    executor = Executor(plan, COMPOSED)
    try:
        executor.setup()
        interpolator = executor._hosts["interpolator"].node
        update = interpolator.update_all
        interpolator.update_all = lambda inputs: taken.append(len(inputs)) or update(inputs)
        executor.run()
    finally:
        executor.close()
    assert max(taken) == 8


def test_environments_are_a_batch_already() -> None:
    assert at_once("renderer", 0, "cpu", 8, 1000, 8) == 1
    assert at_once("renderer", 5, "cpu", 1, 1000, 8) == 5
    with pytest.raises(ValueError, match="batch:=4 with envs:=8: environments are a batch already"):
        at_once("renderer", 4, "cpu", 8, 1000, 8)


def test_pixels_that_fill_up_a_batch_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 10 keyframes in batches of 4 the last two are rendered three times in all, and count once each."""

    def counted(batch: int) -> Any:
        plan = composed("spinning_disk", batch=batch, time_tolerance=0)
        plan.nodes = {name: node for name, node in plan.nodes.items() if node.process == COMPOSED and not node.dormant}
        plan.topics = {name: topic for name, topic in plan.topics.items() if topic.node in plan.nodes}
        executor = Executor(plan, COMPOSED)
        try:
            executor.setup()
            executor.run()
        finally:
            executor.close()
        return executor.summary()["renderer"]["counters"].get("nonfinite_pixels")

    real = Renderer.render

    def render(self: Renderer, *args: Any, **how: Any) -> Any:
        images = real(self, *args, **how)
        # As many as there are environments with some light in them.
        self.shading._counts.fill_(0)
        self.shading._counts[0].fill_(7 * self.shape[0])
        return images

    monkeypatch.setattr(Renderer, "render", render)
    assert counted(1) == 7 * 10
    assert counted(4) == 7 * 10


def test_events_fetched_a_call_later_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a GPU, where the next batch is on its way by then."""

    class Late:
        """A call whose events are asked for later, and copied by then."""

        def __init__(self, events: DeviceEvents) -> None:
            self._events = events.copy()

        def result(self) -> DeviceEvents:
            return self._events

    begun = []

    def process_async(self: EventSensor, *args: Any, **how: Any) -> Late:
        begun.append(args[1])
        return Late(EventSensor.begin(self, *args, **how).result())  # type: ignore[attr-defined]

    def setup(self: EventSensorNode) -> None:
        set_up(self)
        self._calls_in_flight = CallsInFlight() if self.may_gather else None

    want = published("spinning_disk", batch=1, time_tolerance=0)
    set_up = EventSensorNode.setup
    monkeypatch.setattr(EventSensor, "begin", EventSensor.process_async, raising=False)
    monkeypatch.setattr(EventSensor, "process_async", process_async)
    monkeypatch.setattr(EventSensorNode, "setup", setup)
    assert published("spinning_disk", batch=3, time_tolerance=0) == want
    assert [len(t) for t in begun] == [16, 24, 24, 8][: len(begun)] and len(begun) >= 3
