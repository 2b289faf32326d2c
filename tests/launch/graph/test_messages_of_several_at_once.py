"""Several keyframes at once: message for message what single ones give."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from composed_runs import LENGTH_S, RECORDED_APART, Record, published, run_of
from launcher import Launcher
from mcap.reader import make_reader

from evis.runtime.executor import Executor
from evis.runtime.node import Node
from msgs.header import Header, Message
from msgs.world import Reset
from nodes.event_sensor.messages.calls_in_flight import CallsInFlight
from nodes.event_sensor.node import EventSensorNode
from nodes.event_sensor.readout.device_events import DeviceEvents
from nodes.event_sensor.sensor import EventSensor
from nodes.renderer.renderer import Renderer


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


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("noise", [{}, {"shot_rate": 100.0}])
def test_every_event_has_its_mark(device: str, noise: dict[str, float]) -> None:
    """A GPU's sensor has several calls in flight, and keys without a bit for noise where there is none."""
    records = published("spinning_disk", device=device, labels=["events"], **noise)
    events = sum(len(arrays["p"]) for port, _, arrays in records if port == "events")
    marks = b"".join(arrays["signal"] for port, _, arrays in records if port == "signal")
    assert len(marks) == events > 1000
    assert set(marks) == ({0, 1} if noise else {1})


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


def test_pixels_that_fill_up_a_batch_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 10 keyframes in batches of 4 the last two are rendered three times in all, and count once each."""

    def counted(batch: int) -> Any:
        counts = run_of("spinning_disk", batch=batch, time_tolerance=0)[1]
        return counts["renderer"].get("nonfinite_pixels")

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
