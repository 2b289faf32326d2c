"""Rows of pixels, which a CPU looks at sixteen at a time, against the same pixels alone; crossings of a cubic."""

import numpy as np
import pytest
import warp as wp

from nodes.event_sensor.model.crossing_kernels import root_of_cubic
from nodes.event_sensor.sensor import EventSensor

MS = 1_000_000
WIDTH = 50


def events_of(frames, slopes, t, a_call, **params):
    """(t, pixel, p) rows of frames [T, H, W], `a_call` of them a message, in the order in which they came."""
    sensor = EventSensor(*frames.shape[1:], **params)
    rows = []
    for first in range(0, len(t), a_call):
        part = slice(first, first + a_call)
        given = slopes[None, part] if params["crossing"] == "hermite" else None
        rows.append(sensor.process(frames[None, part], t[part], np.zeros(1, np.int32), given))
    rows.append(sensor.flush())
    return np.concatenate([np.stack((e.t, np.maximum(e.x, e.y), e.p), 1) for e in rows])


FAULT = {"refractory_us": 400.0, "leak_rate": 3.0}


@pytest.mark.parametrize("dark", [0.0, 0.5])
@pytest.mark.parametrize(
    ("crossing", "fault"), [("linear", FAULT), ("monotone", {}), ("cubic", {}), ("cubic", FAULT), ("hermite", {})]
)
def test_a_row_has_the_events_of_its_pixels_alone(crossing, dark, fault):
    """Few pixels move at a time, so that most runs of a row are quiet, or quiet but for one of them.

    Alone: as rows of one pixel each, in which it has the same number and so the same phase of its leak.
    """
    rng = np.random.default_rng(5)
    t = (np.arange(60) * 2 + 1).astype(np.int64) * MS
    rate = np.where(rng.random((1, WIDTH)) < 0.15, 25.0, 0.3) * rng.choice([-1, 1], (1, WIDTH))
    angle = 3 * rate * t[:, None] * 1e-9 + rng.uniform(0, 6, WIDTH)
    frames = (4 * np.exp(0.8 * np.sin(angle))).astype(np.float32)
    slopes = (0.8 * 3 * rate * np.cos(angle)).astype(np.float32)
    frames[rng.random(frames.shape) < 0.003] = np.nan
    slopes[rng.random(frames.shape) < 0.003] = np.nan
    params = {"crossing": crossing, "dark_level": dark, "threshold": 0.15, **fault}
    want = events_of(frames[:, :, None], slopes[:, :, None], t, 7, **params)
    assert len(want) > 150
    for a_call in (1, 2, 3, 20):
        events = events_of(frames[:, None], slopes[:, None], t, a_call, **params)
        assert events.tolist() == want.tolist(), a_call


@wp.kernel(enable_backward=False)
def cross(
    # in
    curves: wp.array(dtype=wp.vec4d),
    levels: wp.array(dtype=wp.float64),
    # out
    roots: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    roots[i] = root_of_cubic(curves[i], levels[i], wp.float64(0.0), wp.float64(1.0))


def test_the_crossing_of_a_monotone_cubic_is_exact():
    """Rising cubics through (0, 0) and (1, d), lines among them, and ends at which the slope is 0."""
    rng = np.random.default_rng(1)
    d = np.exp(rng.uniform(-6, 3, 4000))
    m = 3 * d[:, None] * rng.choice([0.0, 0.2, 1 / 3, 0.9, 1.0], (4000, 2))
    curves = np.stack((np.zeros(4000), m[:, 0], 3 * d - 2 * m[:, 0] - m[:, 1], m[:, 0] + m[:, 1] - 2 * d), 1)
    u = rng.uniform(1e-3, 0.999, 4000)
    levels = ((curves[:, 3] * u + curves[:, 2]) * u + curves[:, 1]) * u
    roots = wp.zeros(4000, dtype=wp.float64, device="cpu")
    inputs = [wp.array(curves, dtype=wp.vec4d, device="cpu"), wp.array(levels, dtype=wp.float64, device="cpu")]
    wp.launch(cross, 4000, inputs, [roots], device="cpu")
    slope = (3 * curves[:, 3] * u + 2 * curves[:, 2]) * u + curves[:, 1]
    # The level itself is known to 1e-16 of d.
    assert (np.abs(roots.numpy() - u) < 1e-10 + 1e-15 * d / slope).all()
