"""A sensor that gets frames in messages of any length."""

import numpy as np
import pytest

from nodes.event_sensor.sensor import EventSensor


@pytest.mark.parametrize("crossing", ["linear", "monotone"])
def test_the_sensor_does_not_see_how_frames_are_bundled(crossing):
    """Frames in bundles of 1, 4, 2, 16, 1 and one at a time are the same events."""
    rng = np.random.default_rng(5)
    frames = np.exp(rng.normal(0, 0.5, (1, 24, 6, 7))).astype(np.float32)
    t = np.cumsum(rng.integers(1000, 90_000, 24))

    def events(bundles):
        sensor = EventSensor(6, 7, threshold=0.2, crossing=crossing)
        parts, at = [], 0
        for n in bundles:
            parts.append(sensor.process(frames[:, at : at + n], t[at : at + n], np.zeros(1, np.int32)))
            at += n
        parts.append(sensor.flush())
        return [np.concatenate([getattr(p, name) for p in parts]) for name in "txyp"]

    single = events([1] * 24)
    assert len(single[0]) > 100
    for a, b in zip(events([1, 4, 2, 16, 1]), single, strict=True):
        assert np.array_equal(a, b)
