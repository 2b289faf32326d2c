"""`EventSensor.state` and `restore`: the bytes of a run that was never interrupted, and what is refused."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np
import pytest

import evis
from evis.config.params import Param
from nodes.event_sensor.parameters import MODELS, SENSOR
from nodes.event_sensor.presets import PRESETS

SHAPE = (9, 21)
"""More pixels than a CPU looks at together, and some left over."""
VALUES: dict[str, float] = {
    "threshold_mismatch": 0.03, "refractory_us": 900.0, "leak_rate": 20.0, "leak_jitter": 0.3, "shot_rate": 50.0,
    "hot_pixel_fraction": 0.1, "hot_pixel_rate": 200.0, "hot_pixel_spread": 0.5, "bandwidth_hz": 150.0,
    "readout_rate": 1e5, "timestamp_jitter_us": 20.0, "event_cap": 1, "dark_level": 0.01, "defocus_px": 0.8,
}  # fmt: skip
BESIDE: dict[str, dict[str, float]] = {
    "leak_jitter": {"leak_rate": 20.0},
    "hot_pixel_fraction": {"hot_pixel_rate": 200.0}, "hot_pixel_rate": {"hot_pixel_fraction": 0.1},
    "hot_pixel_spread": {"hot_pixel_fraction": 0.1, "hot_pixel_rate": 100.0},
    "bandwidth_level": {"bandwidth_hz": 150.0}, "photoreceptor_noise": {"bandwidth_hz": 150.0},
    "photoreceptor_noise_level": {"bandwidth_hz": 150.0, "photoreceptor_noise": 0.1},
}  # fmt: skip
"""What a parameter needs to have an effect."""


def turned_on(name: str, param: Param) -> dict[str, Any]:
    """Gives arguments with which a fault is there that the ideal sensor lacks."""
    value = VALUES.get(name, 0.1 if param.maximum is None else min(0.1, param.maximum))
    return {name: value if param.type is float else 1, **BESIDE.get(name, {})}


FAULTS = [turned_on(name, p) for name, p in SENSOR.items() if p.type in (float, int) and p.default == 0]
"""Each fault by itself, those too that are declared after this test was written."""
SENSORS: list[dict[str, Any]] = [
    *({"preset": name} for name in PRESETS),
    *FAULTS,
    *({"model": name} for name in MODELS if name != "evis"),
    *({"preset": "davis346", "crossing": crossing} for crossing in ("frame", "monotone", "cubic")),
    {"preset": "dvs128", "bandwidth_poles": 2, "timestamp_jitter_us": 10.0},
    {"preset": "dvs128", "photoreceptor_noise": 0.1, "bandwidth_hz": 150.0, "bandwidth_poles": 2},
    {"model": "v2e", "threshold_mismatch": 0.03, "leak_rate": 5.0, "shot_rate": 20.0, "bandwidth_hz": 100.0},
    {"colour": True, "preset": "genx320"},
    {"crossing": "hermite", "refractory_us": 200.0},
]


def film(rng: np.random.Generator, envs: int, colour: bool, frames: int = 14) -> tuple[np.ndarray, np.ndarray]:
    size = (envs, frames, *SHAPE, *((3,) if colour else ()))
    light = np.exp(np.cumsum(rng.normal(0, 0.15, size), axis=1)).astype(np.float32)
    return light, 7 + np.cumsum(rng.integers(1000, 3_000_000, frames))


def played(sensor: evis.EventSensor, light: np.ndarray, t: np.ndarray, part: slice) -> list[Any]:
    """Gives the events of frames, in calls of one and of several."""
    places = np.arange(len(t))[part]
    calls = [places[:1], places[1:]] if len(places) > 1 else [places]
    found = []
    for at in calls:
        more = {}
        if sensor.parameters["crossing"] == "hermite":
            more["dlog_dt"] = np.gradient(np.log(light), t * 1e-9, axis=1).astype(np.float32)[:, at]
        found.append(sensor(light[:, at], t[at], **more))
    return found


def stream(parts: list[Any]) -> dict[str, bytes]:
    names = ("t", "x", "y", "p", "c", "env_offsets")
    columns = {n: [getattr(p, n) for p in parts] for n in names}
    return {n: b"".join(b"" if a is None else np.asarray(a).tobytes() for a in c) for n, c in columns.items()}


def stored(state: dict[str, Any]) -> Any:
    """Writes a state to a file and reads it, without pickle."""
    file = io.BytesIO()
    np.savez(file, **state)
    file.seek(0)
    return np.load(file, allow_pickle=False)


@pytest.mark.parametrize("envs", [1, 3])
@pytest.mark.parametrize("arguments", SENSORS, ids=str)
def test_a_restored_sensor_goes_on_as_if_never_interrupted(arguments: dict[str, Any], envs: int) -> None:
    rng = np.random.default_rng([envs, SENSORS.index(arguments)])
    light, t = film(rng, envs, arguments.get("colour", False))
    cut = int(rng.integers(1, len(t) - 1))
    whole = evis.EventSensor(*SHAPE, envs, seed=5, **arguments)
    played(whole, light, t, slice(cut))
    state = stored(whole.state())
    expected = [*played(whole, light, t, slice(cut, None)), whole.flush()]
    assert sum(map(len, expected)) > 50

    other = evis.EventSensor(*SHAPE, envs, seed=8, **arguments)
    played(other, light[:, ::-1].copy(), t, slice(3))  # what it did before is forgotten
    for _ in range(2):  # and a state is there for any number of branches
        other.restore(state)
        found = [*played(other, light, t, slice(cut, None)), other.flush()]
        assert stream(found) == stream(expected)
        assert other.counts() == whole.counts()
        spans = [(events.start_ns, events.end_ns) for events in found]
        assert spans == [(events.start_ns, events.end_ns) for events in expected]


def test_further_samples_after_a_state() -> None:
    light, t = film(np.random.default_rng(3), 1, False, frames=6)
    pixels = SHAPE[0] * SHAPE[1]
    first = np.arange(pixels + 1) * 2
    values = np.exp(np.random.default_rng(4).normal(0, 0.3, 2 * pixels)).astype(np.float32)

    def between(at: int) -> evis.Further:
        gap = int(t[at] - t[at - 1])
        offset = np.tile(np.array([gap // 3, gap // 2], np.int64), pixels)
        return evis.Further(first, offset, values)

    def go_on(sensor: evis.EventSensor) -> list[Any]:
        return [sensor(light[:, k : k + 1], t[k : k + 1], further=between(k)) for k in range(3, 6)]

    for arguments in ({}, {"preset": "dvs128"}):
        whole = evis.EventSensor(*SHAPE, **arguments)
        played(whole, light, t, slice(3))
        state, expected = whole.state(), go_on(whole)
        other = evis.EventSensor(*SHAPE, **arguments)
        other.restore(state)
        assert stream(go_on(other)) == stream(expected)


def test_episodes_go_on_too() -> None:
    """Noise of a further episode, and environments of which some were reset, are those of the uninterrupted run."""
    light, t = film(np.random.default_rng(1), 3, False)

    def until_cut() -> evis.EventSensor:
        sensor = evis.EventSensor(*SHAPE, 3, preset="dvs128", seed=2)
        played(sensor, light, t, slice(4))
        sensor.reset()
        played(sensor, light, t, slice(5))
        sensor.reset(envs=[1])
        return sensor

    whole = until_cut()
    state = whole.state()
    expected = played(whole, light, t, slice(5, None))
    other = evis.EventSensor(*SHAPE, 3, preset="dvs128")
    other.restore(state)
    assert stream(played(other, light, t, slice(5, None))) == stream(expected)
    plain = evis.EventSensor(*SHAPE, 3, preset="dvs128", seed=2)
    assert stream(played(plain, light, t, slice(5, None))) != stream(expected)


def test_a_state_before_the_first_frame_has_the_seed() -> None:
    light, t = film(np.random.default_rng(1), 1, False)
    for seed in (4, -3, 2**70 + 1):
        for device in (None, "cpu"):
            fresh = evis.EventSensor(*SHAPE, preset="dvs128", seed=seed, device=device)
            other = evis.EventSensor(*SHAPE, preset="dvs128", seed=0)
            played(other, light, t, slice(4))
            other.restore(stored(fresh.state()))
            assert stream(played(other, light, t, slice(None))) == stream(played(fresh, light, t, slice(None)))


def test_a_seed_given_by_a_reset_is_part_of_the_state() -> None:
    light, t = film(np.random.default_rng(1), 1, False)
    sensor = evis.EventSensor(*SHAPE, preset="dvs128", seed=1)
    played(sensor, light, t, slice(5))
    state = sensor.state()
    expected = stream(played(sensor, light, t, slice(5, None)))
    sensor.reset(seed=6)
    played(sensor, light, t, slice(5))
    sensor.restore(state)
    assert sensor.seed == 1
    assert stream(played(sensor, light, t, slice(5, None))) == expected


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"height": 8}, "height=9, and this one has 8"),
    ({"envs": 2}, "envs=1, and this one has 2"),
    ({"colour": True}, "colour=False, and this one has True"),
    ({"threshold": 0.3}, "threshold=0.2, and this one has 0.3"),
    ({"preset": "dvs128"}, "bandwidth_exponent|bandwidth_hz"),
]


@pytest.mark.parametrize(("own", "text"), REFUSED, ids=[text for _, text in REFUSED])
def test_a_state_of_another_sensor_is_refused(own: dict[str, Any], text: str) -> None:
    light, t = film(np.random.default_rng(1), 1, False)
    sensor = evis.EventSensor(*SHAPE)
    played(sensor, light, t, slice(3))
    other = evis.EventSensor(**{"height": SHAPE[0], "width": SHAPE[1], **own})
    with pytest.raises(ValueError, match=text) as error:
        other.restore(sensor.state())
    assert str(error.value).startswith("event sensor: the state is of a sensor with ")
    assert str(error.value).endswith("; make one that is alike")


def test_a_state_that_is_none_or_damaged_is_refused_and_nothing_happens() -> None:
    light, t = film(np.random.default_rng(1), 1, False)
    sensor, alike = (evis.EventSensor(*SHAPE, preset="dvs128") for _ in range(2))
    for one in (sensor, alike):
        played(one, light, t, slice(4))
    state = sensor.state()
    base = "sensor.pixels.rare.base"
    cases: list[tuple[Any, str]] = [
        ({**state, "version": 99}, "has version 99, and this EVIS reads version 1; run from the start"),
        ({n: v for n, v in state.items() if n != "until"}, "lacks until"),
        ({n: v for n, v in state.items() if n != base}, re.escape("lacks rare.base")),
        ({n: v for n, v in state.items() if n != "sensor.settled"}, "lacks sensor.settled"),
        ({**state, base: state[base].astype(np.float32)}, "is float32 .* and is float64"),
        ({**state, "device": "cuda:0"}, "is of a sensor on cuda:0, and this one is on cpu"),
        ({}, "is no state of a sensor"),
        (None, "is no state of a sensor"),
    ]
    for given, text in cases:
        with pytest.raises(ValueError, match=text):
            sensor.restore(given)
    assert stream(played(sensor, light, t, slice(4, None))) == stream(played(alike, light, t, slice(4, None)))


@pytest.mark.gpu
@pytest.mark.parametrize("arguments", [{}, {"preset": "dvs128"}, {"crossing": "cubic"}, {"model": "evis-paper"}])
def test_on_a_gpu(arguments: dict[str, Any]) -> None:
    light, t = film(np.random.default_rng(1), 2, False)
    whole, other = (evis.EventSensor(*SHAPE, 2, device="cuda", seed=3, **arguments) for _ in range(2))
    played(whole, light, t, slice(5))
    state = stored(whole.state())
    expected = [*played(whole, light, t, slice(5, None)), whole.flush()]
    played(other, light, t, slice(7))
    other.restore(state)
    assert stream([*played(other, light, t, slice(5, None)), other.flush()]) == stream(expected)
