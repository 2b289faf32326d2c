"""`evis.EventSensor`: the node's bytes, state between calls, arrays of several makers."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import evis
from msgs.camera import EventPacket, Frames
from msgs.header import Header
from nodes.event_sensor.node import EventSensorNode
from nodes.event_sensor.simulate import simulate_frames

MS = 1_000_000
NAMES = ("t", "x", "y", "p")
FAULTS: dict[str, Any] = {"threshold_mismatch": 0.03, "refractory_us": 300.0, "leak_rate": 5.0, "shot_rate": 20.0}


def video(envs: int = 1, frames: int = 13, shape: tuple[int, ...] = (6, 8), seed: int = 0) -> np.ndarray:
    steps = np.random.default_rng(seed).normal(0, 0.2, (envs, frames, *shape))
    return np.exp(np.cumsum(steps, 1)).astype(np.float32)


def stamps(frames: int = 13, first: int = 5) -> np.ndarray:
    return np.arange(frames, dtype=np.int64) * MS + first


def same(events: Any, expected: Any) -> bool:
    return all(np.array_equal(getattr(events, n), getattr(expected, n)) for n in NAMES)


class Bus:
    """Stands for the executor."""

    def __init__(self) -> None:
        self.sent: list[EventPacket] = []

    def loan(self, node: Any, port: str, arrays: Any) -> Any:
        return {name: np.zeros(shape, dtype) for name, (shape, dtype) in arrays.items()}

    def wants(self, node: Any, port: str, array: str = "") -> bool:
        return port == "events"

    def publish(self, node: Any, port: str, message: EventPacket) -> None:
        self.sent.append(message)

    def count(self, *_: Any) -> None: ...

    def diagnose(self, *_: Any) -> None: ...


def by_node(frames: np.ndarray, t: np.ndarray, parts: list[slice], **params: Any) -> list[EventPacket]:
    node = EventSensorNode("event_sensor", params)
    node.runtime = Bus()  # type: ignore[assignment]
    node.setup()
    for part in parts:
        images, episodes = frames[:, part], np.zeros(len(frames), np.int32)
        node.update({"frames": Frames(Header(int(t[part][-1])), t[part], episodes, images)})
    return node.runtime.sent  # type: ignore[attr-defined]


@pytest.mark.parametrize("envs", [1, 3])
@pytest.mark.parametrize("params", [{}, FAULTS, {"preset": "davis346", "threshold": 0.1}, {"model": "v2e"}], ids=str)
def test_the_bytes_of_the_node(envs: int, params: dict[str, Any]) -> None:
    """Call by call, with the state that lies between."""
    frames, t = video(envs), stamps()
    parts = [slice(0, 1), slice(1, 4), slice(4, 5), slice(5, 13)]
    sensor = evis.EventSensor(6, 8, envs, seed=7, **params)
    packets = by_node(frames, t, parts, seed=7, **params)
    for part, packet in zip(parts, packets, strict=True):
        events = sensor(frames[:, part], t[part])
        assert same(events, packet) and events.env_offsets is not None
        assert events.env_offsets.tolist() == packet.env_offsets.tolist()
        assert (events.start_ns, events.end_ns) == (packet.t0_ns, packet.header.stamp_ns)
    assert sum(len(p.t) for p in packets if p.t is not None) > 100


def test_one_sensor_takes_frames_without_the_axis_of_environments() -> None:
    frames, t = video(), stamps()
    events = evis.EventSensor(6, 8)(frames[0], t)
    assert same(events, evis.EventSensor(6, 8)(frames, t)) and events.env_offsets is None
    assert len(events) == len(events.t) > 0


@pytest.mark.parametrize("colour", [False, True])
def test_warp_arrays_give_warp_arrays(colour: bool) -> None:
    shape = (6, 8, 3) if colour else (6, 8)
    frames, t = video(shape=shape), stamps()
    expected = evis.EventSensor(6, 8, colour=colour, **FAULTS)(frames, t)
    given = wp.array(frames, dtype=wp.vec3f if colour else wp.float32, device="cpu")
    events = evis.EventSensor(6, 8, colour=colour, **FAULTS)(given, wp.array(t, device="cpu"))
    columns = [getattr(events, n) for n in NAMES + (("c",) if colour else ())]
    assert all(isinstance(column, wp.array) for column in columns)
    for name, column in zip((*NAMES, "c"), columns):
        assert np.array_equal(column.numpy(), getattr(expected, name))


class Foreign:
    """An array of a library that is known by DLPack alone."""

    def __init__(self, values: np.ndarray) -> None:
        self._values, self.shape = values, values.shape

    def reshape(self, shape: tuple[int, ...]) -> Foreign:
        return Foreign(self._values.reshape(shape))

    def __dlpack__(self, **more: Any) -> Any:
        return self._values.__dlpack__()

    def __dlpack_device__(self) -> Any:
        return self._values.__dlpack_device__()


@pytest.mark.parametrize("colour", [False, True])
def test_anything_with_dlpack(colour: bool) -> None:
    """As PyTorch's tensors come in: the same code takes them."""
    frames, t = video(shape=(6, 8, 3) if colour else (6, 8)), stamps()
    events = evis.EventSensor(6, 8, colour=colour)(Foreign(frames[0]), t)
    expected = evis.EventSensor(6, 8, colour=colour)(frames[0], t)
    assert isinstance(events.t, wp.array)
    assert all(np.array_equal(np.from_dlpack(getattr(events, n)), getattr(expected, n)) for n in NAMES)


def test_frames_are_not_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the sensor is handed is the caller's memory."""
    frames, met = video(), []
    from nodes.event_sensor import batches as inner

    taken = inner.on_device
    monkeypatch.setattr(inner, "on_device", lambda v, d: met.append(taken(v, d)) or met[-1])
    evis.EventSensor(6, 8)(Foreign(frames), stamps())
    evis.EventSensor(6, 8)(frames, stamps())
    assert [array.ptr for array in met] == [frames.ctypes.data] * 2


@pytest.mark.parametrize("params", [FAULTS, {**FAULTS, "crossing": "cubic"}, {"model": "esim"}], ids=str)
def test_reset_with_a_seed_is_a_new_sensor(params: dict[str, Any]) -> None:
    frames, t = video(), stamps()
    sensor = evis.EventSensor(6, 8, seed=3, **params)
    first = sensor(frames, t)
    sensor.reset(seed=4)
    second = sensor(frames, t)
    assert same(second, evis.EventSensor(6, 8, seed=4, **params)(frames, t))
    sensor.reset(seed=3)
    assert same(sensor(frames, t), first)


def test_reset_without_a_seed_is_the_next_episode() -> None:
    """Other noise, as the node draws it in episode 1; time may begin anew."""
    frames, t = video(), stamps()
    sensor = evis.EventSensor(6, 8, **FAULTS)
    first = sensor(frames, t)
    sensor.reset()
    second = sensor(frames, t)
    assert not same(first, second) and abs(len(first) - len(second)) < 0.3 * len(first)


NOISES: list[dict[str, Any]] = [
    FAULTS,
    {"leak_rate": 50.0, "leak_model": "bernoulli"},
    {"model": "evis-paper", "shot_rate": 50.0, "leak_rate": 50.0},
    {"timestamp_jitter_us": 20.0},
    {"timestamp_jitter_us": 20.0, "crossing": "cubic"},
    {"model": "v2e", "shot_rate": 50.0},
]


@pytest.mark.parametrize("params", NOISES)
def test_noise_knows_the_time_since_the_episode_began_and_not_the_hour(params: dict[str, Any]) -> None:
    frames, t, late = video()[0], stamps(), 7_000_000 * MS
    sensor, other = (evis.EventSensor(6, 8, seed=4, **params) for _ in range(2))
    first, moved = sensor(frames, t), other(frames, t + late)
    assert len(first) and (np.asarray(moved.t) - late == first.t).all() and (moved.x == first.x).all()
    other.reset()
    assert other(frames, t + 2 * late).t.tobytes() != (first.t + 2 * late).tobytes()


@pytest.mark.parametrize("params", NOISES)
def test_another_episode_at_the_same_times_has_other_noise(params: dict[str, Any]) -> None:
    sensor = evis.EventSensor(6, 8, seed=4, **params)
    first = sensor(video()[0], stamps())
    sensor.reset()
    assert not same(sensor(video()[0], stamps()), first)


def test_one_environment_begins_anew() -> None:
    """The frame after it is the reference of that one alone."""
    frames = np.ones((3, 2, 6, 8), np.float32)
    frames[:, 1] = 2.0
    sensor = evis.EventSensor(6, 8, 3)
    sensor(frames[:, :1], stamps()[:1])
    sensor.reset(envs=[1])
    events = sensor(frames[:, 1:], stamps()[1:2])
    assert np.diff(events.env_offsets).tolist() == [144, 0, 144]  # ln 2 = 3.5 thresholds on 48 pixels


@pytest.mark.parametrize("axis", [False, True])
def test_a_flush_has_the_axes_of_the_frames(axis: bool) -> None:
    """So that its events can be joined to those before."""
    frames, t = (video() if axis else video()[0]), stamps()
    sensor = evis.EventSensor(6, 8, crossing="cubic")
    given, rest = sensor(frames, t), sensor.flush()
    assert (given.env_offsets is None, rest.env_offsets is None) == (not axis, not axis)
    if axis:
        assert rest.env_offsets.tolist() == [0, len(rest)] and len(rest) > 0


@pytest.mark.parametrize("crossing", ["linear", "cubic"])
def test_events_that_left_late_lie_in_the_interval_of_the_flush(crossing: str) -> None:
    """At 1000 events a second the last ones leave long after the last frame; all calls together cover time once."""
    sensor = evis.EventSensor(6, 8, readout_rate=1000.0, crossing=crossing)
    first = -40 * MS
    calls = [sensor(video()[0], stamps(first=first)), sensor.flush()]
    assert len(calls[1]) and calls[1].t[-1] > stamps(first=first)[-1]
    assert calls[0].end_ns == calls[1].start_ns and calls[1].end_ns == calls[1].t[-1]
    for events in calls:
        assert ((events.t > events.start_ns) & (events.t <= events.end_ns)).all()


def test_look_ahead_is_flushed() -> None:
    frames, t = video(), stamps()
    sensor = evis.EventSensor(6, 8, crossing="cubic")
    parts = [sensor(frames[0, :7], t[:7]), sensor(frames[0, 7:], t[7:])]
    assert parts[-1].end_ns == t[-2]
    parts.append(sensor.flush())
    assert parts[-1].end_ns == t[-1]
    expected = simulate_frames(frames[0], t, crossing="cubic")
    assert all(np.array_equal(np.concatenate([getattr(p, n) for p in parts]), expected[n]) for n in NAMES)


def test_a_preset_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("threshold: 0.15\nleak_rate: 5\n")
    frames, t = video(), stamps()
    sensor = evis.EventSensor(6, 8, preset=tmp_path / "mine.yaml", threshold=0.3)
    assert (sensor.parameters["threshold"], sensor.parameters["leak_rate"]) == (0.3, 5.0)
    assert same(sensor(frames, t), evis.EventSensor(6, 8, threshold=0.3, leak_rate=5.0)(frames, t))
    (tmp_path / "bad.yaml").write_text("treshold: 0.15\n")
    with pytest.raises(ValueError, match=r"bad\.yaml.*treshold.*threshold"):
        evis.EventSensor(6, 8, preset=tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    "params, message",
    [
        ({"model": "evis-paper", "leak_rate": 9.0, "leak_model": "drift"}, "leak_model='drift' has no effect: event"),
        ({"model": "evis-paper", "shot_rate": 9.0, "shot_on_share": 0.9}, "shot_on_share=0.9 has no effect: event"),
        ({"model": "evis-paper", "crossing": "linear"}, "crossing='linear' has no effect: event model evis-paper"),
        ({"model": "dvs_voltmeter", "refractory_us": 5.0}, "refractory_us=5.0 has no effect: event model"),
        ({"preset": "davis346", "shot_rate": 0.0, "shot_on_share": 0.9}, "shot_on_share=0.9 has no effect: shot"),
    ],
)
def test_a_parameter_that_changes_nothing_is_refused(params: dict[str, Any], message: str) -> None:
    """As in a launch file; and it is true: the events without it are those with another value of it."""
    for make in (lambda: evis.EventSensor(6, 8, **params), lambda: simulate_frames(video()[0], stamps(), **params)):
        with pytest.raises(ValueError, match="^" + message) as caught:
            make()
        assert str(caught.value).endswith("; leave it out")


def test_parameters_that_are_off_or_of_a_preset_are_no_mistake(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("model: evis-paper\nleak_rate: 5\nleak_model: drift\n")
    frames, t = video()[0], stamps()
    sensor = evis.EventSensor(6, 8, preset=tmp_path / "mine.yaml")
    assert same(sensor(frames, t), evis.EventSensor(6, 8, model="evis-paper", leak_rate=5.0, leak_jitter=0)(frames, t))
    assert len(evis.EventSensor(6, 8, model="esim", leak_rate=0, defocus_px=0.0)(frames, t))


def test_what_is_not_a_number_is_counted() -> None:
    frames = video()
    frames[0, 3, 2, 2] = np.nan
    sensor = evis.EventSensor(6, 8)
    sensor(frames, stamps())
    assert sensor.counts()["nonfinite"] == 1


RGB, CODES = np.ones((13, 6, 8, 3), np.float32), np.ones((13, 6, 8), np.uint8)
BAD: list[tuple[str, Any]] = [
    ("threshold", lambda: evis.EventSensor(6, 8, threshold=-1)),
    ("thresholds", lambda: evis.EventSensor(6, 8, thresholds=0.2)),
    ("dvs128", lambda: evis.EventSensor(6, 8, preset="dvs12")),
    ("no device 'cuda:99'", lambda: evis.EventSensor(6, 8, device="cuda:99")),
    ("crossing=hermite needs", lambda: evis.EventSensor(6, 8, crossing="hermite", bandwidth_hz=50)),
    ("takes luminance", lambda: evis.EventSensor(6, 8, model="esim", colour=True)),
    (
        r"have the shape \[13, 6, 9\]; they must be \[1, T, 6, 8\] or \[T, 6, 8\]$",
        lambda: evis.EventSensor(6, 8)(np.ones((13, 6, 9), "f4"), stamps()),
    ),
    (r"must be \[2, T, 6, 8\]", lambda: evis.EventSensor(6, 8, 2)(video()[0], stamps())),
    (r"must be .* or \[T, 6, 8\], or in R, G and B with colour=True", lambda: evis.EventSensor(6, 8)(RGB, stamps())),
    (r"shape \[1, 1, 13, 6, 8\]", lambda: evis.EventSensor(6, 8, 3)(np.ones((1, 1, 13, 6, 8), "f4"), stamps())),
    (r"uint8; they must be .*linear_from_srgb\(codes / 255\)", lambda: evis.EventSensor(6, 8)(CODES, stamps())),
    ("float64; they must be .* convert", lambda: evis.EventSensor(6, 8)(wp.ones((13, 6, 8), wp.float64), stamps())),
    (
        r"alpha$",
        lambda: evis.EventSensor(6, 8, colour=True)(np.ones((13, 6, 8, 4), "f4"), stamps()),
    ),
    (r"leaves out the last axis$", lambda: evis.EventSensor(6, 8)(np.ones((13, 6, 8, 1), "f4"), stamps())),
    ("dlog_dt has no effect", lambda: evis.EventSensor(6, 8)(video(), stamps(), video())),
    (r"np\.moveaxis", lambda: evis.EventSensor(6, 8, colour=True)(np.ones((13, 3, 6, 8), "f4"), stamps())),
    (r"whole nanoseconds.*np\.rint\(1e9 \* t\)", lambda: evis.EventSensor(6, 8)(video(), stamps() * 1e-9)),
    (
        r"frames are \[1, 13, 6, 8\] with 12 stamps; .* a stamp for each",
        lambda: evis.EventSensor(6, 8)(video(), stamps()[:12]),
    ),
    (
        r"frame 12 is at 0 ns after \d+ ns",
        lambda: evis.EventSensor(6, 8)(video(), np.append(stamps()[:12], 0)),
    ),
    (
        "t reaches 9223372036854775820, more than int64",
        lambda: evis.EventSensor(6, 8)(video(), stamps().astype(np.uint64) // 10**9 * 0 + np.uint64(2**63 + 12)),
    ),
    ("height is 0; it must be a whole number, 1 to 65536", lambda: evis.EventSensor(0, 8)),
    ("height is 70000; it must be a whole number, 1 to 65536", lambda: evis.EventSensor(70_000, 2)),
    ("width is 65537; it must be a whole number, 1 to 65536", lambda: evis.EventSensor(2, 65537)),
    ("height is 5.5; it must be", lambda: evis.EventSensor(5.5, 8)),  # type: ignore[arg-type]
    ("width is '8'; it must be", lambda: evis.EventSensor(6, "8")),  # type: ignore[arg-type]
    ("envs is 0; it must be", lambda: evis.EventSensor(6, 8, envs=0)),
    (
        r"frames are \[0, 6, 8\] with 0 stamps; a call takes one frame or more",
        lambda: evis.EventSensor(6, 8)(video()[0, :0], stamps()[:0]),
    ),
    ("had no frame", lambda: evis.EventSensor(6, 8).flush()),
    ("no environment 5", lambda: evis.EventSensor(6, 8).reset(envs=[5])),
    ("no mask; np.flatnonzero", lambda: evis.EventSensor(6, 8, envs=3).reset(envs=[True, False, True])),
    ("0.5 for envs; it takes whole numbers", lambda: evis.EventSensor(6, 8, envs=3).reset(envs=[0.5])),  # type: ignore[list-item]
    ("1 for envs; it takes whole numbers", lambda: evis.EventSensor(6, 8, envs=3).reset(envs=[-1])),
    ("seed is 'x'; it must be a whole number", lambda: evis.EventSensor(6, 8).reset(seed="x")),  # type: ignore[arg-type]
    ("seed is 1.5; it must be a whole number", lambda: evis.EventSensor(6, 8, seed=1.5)),  # type: ignore[arg-type]
    ("a seed is that of all", lambda: evis.EventSensor(6, 8).reset(seed=1, envs=[0])),
]


@pytest.mark.parametrize(("text", "call"), BAD, ids=[text for text, _ in BAD])
def test_bad_input_is_named(text: str, call: Any) -> None:
    with pytest.raises(ValueError, match=text):
        call()


@pytest.mark.gpu
@pytest.mark.parametrize("params", [{}, FAULTS], ids=str)
def test_on_a_gpu(params: dict[str, Any]) -> None:
    """Frames there give events there, those of a sensor on a CPU but for the last bit of a logarithm."""
    frames, t = video(2), stamps()
    events = evis.EventSensor(6, 8, 2, **params)(wp.array(frames, device="cuda"), t)
    assert events.t.device.is_cuda and events.p.device.is_cuda
    on_cuda = evis.EventSensor(6, 8, 2, device="cuda", **params)(frames, t)
    assert isinstance(on_cuda.t, np.ndarray) and np.array_equal(events.t.numpy(), on_cuda.t)
    expected = evis.EventSensor(6, 8, 2, **params)(frames, t)
    assert abs(len(events) - len(expected)) <= 2


def test_a_sensor_that_is_in_use_is_not_copied() -> None:
    """A shallow copy would go on with the same pixels; one that has seen nothing is its arguments."""
    sensor = pickle.loads(pickle.dumps(evis.EventSensor(2, 2, threshold=0.3)))
    assert sensor.parameters["threshold"] == 0.3
    sensor(np.ones((1, 2, 2), np.float32), np.array([0]))
    for copied in (copy.copy, copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match="pixels cannot be copied or pickled; make one with the same arguments"):
            copied(sensor)
