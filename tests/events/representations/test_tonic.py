"""Representations beside those of tonic (G. Lenz et al., 2021), where the two mean the same."""

from __future__ import annotations

import numpy as np
import pytest
from plain_definitions import some_events

from evis.events.representations import TimeSurface, count_image, event_stack, voxel_grid

functional = pytest.importorskip("tonic.functional", reason="tonic is not installed: make test-extras")
pytestmark = pytest.mark.extras

SENSOR = (9, 6, 2)
SIZE = {"height": 6, "width": 9}


def structured(n: int = 600) -> np.ndarray:
    """Events as tonic has them; the polarity signed, as its voxel grid writes -1 into it."""
    columns = some_events(n)
    events = np.zeros(n, [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "i1")])
    for name in "txyp":
        events[name] = columns[name]
    return events


@pytest.mark.parametrize("bins", [1, 4, 9])
def test_voxel_grid(bins: int) -> None:
    """tonic's spreads the times over [0, B], so that it is the grid of B + 1 bins without the last one."""
    theirs = functional.to_voxel_grid_numpy(structured().copy(), SENSOR, bins)[:, 0]
    np.testing.assert_allclose(voxel_grid(structured(), bins + 1, **SIZE).values[:bins], theirs, atol=1e-5)


@pytest.mark.parametrize("dt", [500_000, 2_000_000])
def test_time_surface(dt: int) -> None:
    events, tau = structured(), 1_500_000
    theirs = functional.to_timesurface_numpy(events, SENSOR, dt, tau)
    ours, start = TimeSurface(tau, **SIZE), int(events["t"][0])
    assert len(theirs) > 3
    for i, expected in enumerate(theirs):
        end = start + (i + 1) * dt
        part = events[(events["t"] >= end - dt) & (events["t"] < end)]
        np.testing.assert_allclose(ours.update(part, at=end).values, expected, atol=1e-5)


def test_count_images_of_windows() -> None:
    events, dt = structured(), 1_000_000
    start = int(events["t"][0])
    for i, expected in enumerate(functional.to_frame_numpy(events, SENSOR, time_window=dt)):
        window = (start + i * dt, start + (i + 1) * dt - 1)  # whole ns: the end is included here
        np.testing.assert_array_equal(count_image(events, window=window, **SIZE).values, expected)


@pytest.mark.parametrize("bins", [2, 5])
def test_stack_by_count(bins: int) -> None:
    """600 events are cut into equal parts by both."""
    theirs = functional.to_frame_numpy(structured(), SENSOR, n_event_bins=bins)
    ours = event_stack(structured(), bins, by="count", polarity="split", **SIZE).values
    np.testing.assert_array_equal(ours.reshape(2, bins, 6, 9).swapaxes(0, 1), theirs)
