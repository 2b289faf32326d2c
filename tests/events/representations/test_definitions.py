"""Representations equal their definitions, written out event by event."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from plain_definitions import Columns, counts, some_events, surface, voxels

from evis.events.representations import TimeSurface, count_image, event_stack, time_surface, voxel_grid

SIZE = {"height": 6, "width": 9}
SHAPE = (6, 9)
POLARITIES = ("signed", "split", "merged")
FLOAT = 1e-5
"""float32 results of a few hundred weights of at most 1: their rounding is 2^-24 of the sum."""


@pytest.fixture(scope="module")
def events() -> Columns:
    return some_events()


@pytest.mark.parametrize("polarity", POLARITIES)
@pytest.mark.parametrize("bins", [1, 2, 5])
def test_voxel_grid(events: Columns, bins: int, polarity: str) -> None:
    made = voxel_grid(events, bins, polarity=polarity, **SIZE)
    assert made.values.dtype == np.float32
    np.testing.assert_allclose(made.values, voxels(events, bins, SHAPE, polarity), atol=FLOAT)
    assert made.outside.tolist() == [0, 0]


@pytest.mark.parametrize("polarity", POLARITIES)
@pytest.mark.parametrize("by", ["time", "count"])
@pytest.mark.parametrize("bins", [1, 3, 7])
def test_event_stack(events: Columns, bins: int, by: str, polarity: str) -> None:
    made = event_stack(events, bins, by=by, polarity=polarity, **SIZE)
    assert made.values.dtype == np.int32
    np.testing.assert_array_equal(made.values, counts(events, bins, SHAPE, polarity, by))


@pytest.mark.parametrize("polarity", POLARITIES)
def test_count_image(events: Columns, polarity: str) -> None:
    made = count_image(events, polarity=polarity, **SIZE).values
    expected = counts(events, 1, SHAPE, polarity, "time")
    np.testing.assert_array_equal(made, expected if polarity == "split" else expected[0])


@pytest.mark.parametrize("polarity", POLARITIES)
@pytest.mark.parametrize("decay", ["exponential", "linear"])
def test_time_surface(events: Columns, decay: str, polarity: str) -> None:
    tau = 2_000_000
    made = time_surface(events, tau, decay=decay, polarity=polarity, **SIZE)
    at = int(events["t"][-1])
    np.testing.assert_allclose(made.values, surface(events, tau, SHAPE, polarity, decay, at), atol=FLOAT)


def test_time_surface_ignores_and_counts_what_comes_later(events: Columns) -> None:
    at = 9_000_000
    made = time_surface(events, 1_000_000, at=at, **SIZE)
    np.testing.assert_allclose(made.values, surface(events, 1_000_000, SHAPE, "split", "exponential", at), atol=FLOAT)
    assert made.outside.tolist() == [(events["t"] > at).sum(), 0]


def test_a_time_surface_remembers(events: Columns) -> None:
    """Packet by packet it ends as that of all events at once; reset, as that of the rest."""
    kept = TimeSurface(3_000_000, **SIZE)
    parts = [{n: c[i : i + 100] for n, c in events.items()} for i in range(0, 400, 100)]
    for part in parts:
        last = kept.update(part)
    np.testing.assert_array_equal(last.values, time_surface(events, 3_000_000, **SIZE).values)
    kept.reset()
    np.testing.assert_array_equal(kept.update(parts[0]).values, time_surface(parts[0], 3_000_000, **SIZE).values)


def test_a_time_surface_fades_without_events(events: Columns) -> None:
    kept = TimeSurface(3_000_000, **SIZE)
    before = kept.update(events, at=15_000_000).values
    nothing = {n: c[:0] for n, c in events.items()}
    np.testing.assert_allclose(kept.update(nothing, at=18_000_000).values, before * np.exp(-1), rtol=1e-6)


def test_the_convention_of_e2vid(events: Columns) -> None:
    """As E2VID's `events_to_voxel_grid` and its normalisation compute them, in its order."""
    bins, (height, width) = 5, SHAPE
    t, x, y = (events[n].astype(np.int64) for n in "txy")
    grid = np.zeros(bins * height * width, np.float32)
    ts = (bins - 1) * (t - t[0]).astype(float) / float(t[-1] - t[0])
    sign = np.where(events["p"], 1.0, -1.0)
    left = ts.astype(int)
    part = ts - left
    at = x + y * width + left * width * height
    np.add.at(grid, at[left < bins], (sign * (1.0 - part))[left < bins])
    inside = left + 1 < bins
    np.add.at(grid, at[inside] + width * height, (sign * part)[inside])
    filled = grid != 0
    mean = grid[filled].mean()
    grid[filled] = (grid[filled] - mean) / np.sqrt((grid[filled] ** 2).mean() - mean**2)
    made = voxel_grid(events, bins, normalise=True, **SIZE).values
    # A voxel whose weights cancel is 0 here, and there the rest of their rounding.
    tiny = np.abs(voxels(events, bins, SHAPE, "signed")) < 1e-6
    np.testing.assert_allclose(made[~tiny], grid.reshape(made.shape)[~tiny], atol=1e-4)
    assert tiny.mean() < 0.5 and filled.mean() > 0.5


def test_equal_voxels_normalise_to_zero() -> None:
    events = {"t": np.array([0, 10]), "x": np.array([1, 2]), "y": np.array([0, 0]), "p": np.array([1, 1])}
    assert not voxel_grid(events, 2, normalise=True, height=1, width=4).values.any()


def test_one_instant_falls_into_the_first_bin() -> None:
    events = {"t": np.array([7, 7]), "x": np.array([1, 1]), "y": np.array([0, 0]), "p": np.array([1, 0])}
    grid = voxel_grid(events, 3, polarity="merged", height=1, width=2).values
    assert grid[:, 0, 1].tolist() == [2.0, 0.0, 0.0]


def test_no_events_make_an_empty_array() -> None:
    nothing = {"t": np.zeros(0, np.int64), "x": [], "y": [], "p": []}
    nothing |= {n: np.zeros(0, np.uint16) for n in "xyp"}
    assert voxel_grid(nothing, 3, normalise=True, **SIZE).values.shape == (3, 6, 9)
    assert not count_image(nothing, **SIZE).values.any()
    assert not time_surface(nothing, 1000, **SIZE).values.any()


def test_a_copy_of_a_surface_goes_its_own_way(events: Columns) -> None:
    """Copied between two packets, it fades and grows as the one does that it was copied from."""
    first, later = ({name: column[part] for name, column in events.items()} for part in (slice(-20), slice(-20, None)))
    one = TimeSurface(10_000_000, **SIZE)
    empty = copy.deepcopy(one)
    one.update(first)
    copied = copy.deepcopy(one)
    expected = one.update(later).values
    assert np.array_equal(copied.update(later).values, expected)
    np.testing.assert_allclose(empty.update(events).values, expected, atol=FLOAT)
    assert (TimeSurface(10_000_000, **SIZE).update(later).values != expected).any()
