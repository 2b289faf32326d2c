"""What the sensor node says its seed decides, against events of two seeds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from nodes.event_sensor.make import make_sensor
from nodes.event_sensor.node import EventSensorNode
from nodes.event_sensor.parameters import SENSOR, resolve_sensor

MS = 1_000_000
QUIET: list[dict[str, Any]] = [
    {},
    {"crossing": "cubic", "refractory_us": 100.0, "dark_level": 0.1, "defocus_px": 1.0},
    {"bandwidth_hz": 300.0, "readout_rate": 1e6},
    {"hot_pixel_rate": 1000.0},
    {"model": "evis-paper"},
    {"model": "esim", "refractory_us": 100.0},
    {"model": "v2e", "leak_rate": 20.0, "bandwidth_hz": 100.0},
]
DRAWN: list[tuple[dict[str, Any], str]] = [
    ({"threshold_mismatch": 0.05}, "threshold mismatch"),
    ({"leak_rate": 20.0}, "leak"),
    ({"leak_rate": 20.0, "leak_model": "bernoulli"}, "leak"),
    ({"shot_rate": 200.0, "shot_white": 100.0}, "shot noise"),
    ({"hot_pixel_fraction": 0.2, "hot_pixel_rate": 1000.0}, "hot pixels"),
    ({"timestamp_jitter_us": 10.0}, "timestamp jitter"),
    ({"photoreceptor_noise": 0.1, "bandwidth_hz": 100.0}, "photoreceptor noise"),
    ({"model": "evis-paper", "leak_rate": 20.0}, "leak"),
    ({"model": "esim", "threshold_mismatch": 0.05}, "threshold mismatch"),
    ({"model": "v2e", "leak_rate": 20.0, "leak_jitter": 0.5}, "leak"),
    ({"model": "v2e", "shot_rate": 500.0, "shot_white": 100.0}, "shot noise"),
    ({"model": "dvs_voltmeter", "shot_white": 30.0}, "its model of every crossing"),
]


def random(parameters: dict[str, Any], preset: str = "ideal") -> tuple[str, ...]:
    """What the node says."""
    return EventSensorNode.random({**dict.fromkeys(SENSOR), "preset": preset, **parameters})


def differ(parameters: dict[str, Any]) -> bool:
    """Whether two seeds give other events of a picture that brightens and darkens."""
    t = np.arange(60, dtype=np.int64) * MS
    light = 1 + 0.9 * np.sin(np.arange(60) / 9)[:, None, None] * np.linspace(0.2, 1, 12 * 16).reshape(12, 16)
    resolved, frames = resolve_sensor("sensor", "ideal", parameters), light[None].astype(np.float32)
    sensors = (make_sensor(resolved, (12, 16), colour=False, device="cpu", seed=seed) for seed in (1, 2))
    first, second = ((one.process(frames, t, np.zeros(1, np.int32)), one.flush()) for one in sensors)
    assert len(first[0].t) > 100
    pairs = list(zip(first, second, strict=True))
    return any(not np.array_equal(getattr(a, name), getattr(b, name)) for a, b in pairs for name in "txyp")


@pytest.mark.parametrize("parameters", QUIET)
def test_where_it_says_nothing_every_seed_gives_the_same(parameters: dict[str, Any]) -> None:
    assert random(parameters) == () and not differ(parameters)


@pytest.mark.parametrize(("parameters", "what"), DRAWN)
def test_what_it_names_differs_by_seed(parameters: dict[str, Any], what: str) -> None:
    assert random(parameters) == (what,) and differ(parameters)


def test_a_presets_faults_are_named() -> None:
    assert random({}, "davis346") == ("threshold mismatch", "leak", "shot noise", "hot pixels", "timestamp jitter")
