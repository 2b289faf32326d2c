"""A whole sensor of a preset, noise apart, event by event against a model of a pixel in float64."""

import math

import numpy as np
import pytest

from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
NO_NOISE = {"leak_rate": 0, "shot_rate": 0, "threshold_mismatch": 0, "timestamp_jitter_us": 0, "readout_rate": 0}
ROUNDING = 2e-7
"""Of L: the filtered light is float32 again, 6e-8 of itself, at both ends of a step; and the tolerance of 2^-23."""


def receptor(light, t, p):
    """What leaves the photoreceptor, as L, for one pixel: dy/dt = (L - y) / tau with L linear between samples."""
    level = light.astype(np.float64) + p["dark_level"]
    share = np.minimum(1, level / p["bandwidth_level"])
    out, behind = [math.log(level[0])], 0.0
    for k in range(1, len(t)):
        a = 2 * math.pi * p["bandwidth_hz"] * 0.5 * (share[k - 1] + share[k]) * (t[k] - t[k - 1]) * 1e-9
        behind = behind * math.exp(-a) + math.log(level[k] / level[k - 1]) * math.expm1(-a) / a
        out.append(math.log(level[k]) + behind)
    return np.array(out)


def pixel(y, t, p):
    """Events (time, polarity, bound of its error) of y, linear between stamps, up to one that hangs on a rounding."""
    events, reference, doubt, dead = [], y[0], ROUNDING, -math.inf
    for k in range(1, len(t)):
        slope = (y[k] - y[k - 1]) / (t[k] - t[k - 1])
        while True:
            if dead != -math.inf:
                if dead > t[k]:
                    break
                at = max(dead, t[k - 1])
                reference, late = y[k - 1] + slope * (at - t[k - 1]), events[-1][2] if dead > t[k - 1] else 0.0
                doubt, dead = ROUNDING + late * abs(slope), -math.inf
            up = y[k] > reference
            c = p["threshold_on"] if up else p["threshold_off"]
            over = abs(y[k] - reference) - c
            if abs(over) < 2 * doubt:
                return events, False
            if over < 0:
                break
            when = t[k - 1] + (reference + (c if up else -c) - y[k - 1]) / slope
            if events and abs(when + 1e3 * p["refractory_us"] - t[k]) < 2 * (1 + 2 * doubt / abs(slope)):
                return events, False
            events.append((when, int(up), 1.0 + (doubt + ROUNDING) / abs(slope)))
            dead = when + 1e3 * p["refractory_us"]
    return events, True


@pytest.mark.parametrize("preset", ["davis346", "dvs128", "imx636"])
@pytest.mark.parametrize("brightness", [2e-4, 0.02, 2.0])
def test_events_of_a_preset_are_those_of_a_float64_pixel(preset, brightness):
    """Edges and ramps about this radiance, a hundredth of the preset's white and a ten-thousandth included.

    An event is late by what the rounding of the light is over the slope at it: little on an edge, much where a dark
    and slow pixel creeps over its threshold.
    """
    rng = np.random.default_rng(8)
    height, width, frames = 9, 21, 120
    walk = np.cumsum(rng.normal(0, 0.02, (frames, height, width)) + rng.normal(0, 8, (1, height, width)) / frames, 0)
    walk += 1.5 * np.cumsum(rng.random((frames, height, width)) < 0.02, 0) * rng.choice([-1, 1], (1, height, width))
    light = (brightness * np.exp(walk)).astype(np.float32)
    t = np.arange(frames, dtype=np.int64) * MS
    sensor = EventSensor(height, width, preset=preset, **NO_NOISE)
    packets = [sensor.process(light[None, k : k + 7], t[k : k + 7], np.zeros(1, np.int32)) for k in range(0, 120, 7)]
    got = {c: np.concatenate([getattr(p, c) for p in packets]) for c in "txyp"}
    seen = 0
    for y, x in np.ndindex(height, width):
        want, whole = pixel(receptor(light[:, y, x], t, sensor.parameters), t, sensor.parameters)
        mine = np.flatnonzero((got["x"] == x) & (got["y"] == y))
        assert len(mine) == len(want) if whole else len(mine) >= len(want)
        mine = mine[: len(want)]
        assert got["p"][mine].tolist() == [p for _, p, _ in want]
        late = np.abs(got["t"][mine] - np.array([when for when, _, _ in want]))
        assert (late <= np.array([bound for _, _, bound in want])).all()
        seen += len(want)
    assert seen > max(100, 0.95 * len(got["t"]))
