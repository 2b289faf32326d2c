"""What auto's probe looks at, and what it makes of measured gaps, on costs and errors that are known by hand."""

import functools

import numpy as np
import pytest

from evis.scene import load_scene
from nodes.interpolator.auto.choice import choose
from nodes.interpolator.auto.cost import FullSize, GapCost
from nodes.interpolator.auto.probe import Search
from nodes.interpolator.auto.setting import Grid, Setting

ABOVE = {"rigid": 0.01, "splat": 0.3}
"""Error above dense rendering."""


@functools.cache
def disk():
    return load_scene("spinning_disk", {"width": 48, "height": 36})


def setting(**given):
    return Setting(disk(), disk().camera("cam0"), 1_000_000_000, **given)


def dense_error(frame_rate):
    return 100.0 / frame_rate


class Windows:
    """Errors by a formula, and what was asked for."""

    def __init__(self):
        self.asked = []

    def errors(self, ways):
        self.asked += ways
        return [dense_error(rate * k) + ABOVE.get(method, 0.0) for method, rate, k in ways]


def full_size(keyframe, per_frame, **given):
    """Costs of a keyframe and, by method, of a sub-frame [s]; nothing else costs anything."""
    full = FullSize(setting(**given), None, [])
    full.keyframe = dict.fromkeys(("none", "splat", "rigid"), keyframe)
    full.measured = []

    def measure_gap(method, rate):
        full.measured.append((method, rate))
        full.gaps[method, rate] = GapCost(0.0, per_frame[method])

    full.measure_gap = measure_gap
    return full


def searched(keyframe, per_frame, reference_hz=8000, **given):
    s = setting(**given)
    windows, full = Windows(), full_size(keyframe, per_frame, **given)
    search = Search(s, Grid.of(s, reference_hz), full, windows, 0.0, lambda line: None)
    search.run()
    return search, windows, full


def test_the_best_of_all_ways_is_found():
    """Against every way of the grid, worked out: at any real-time factor the choice is at most GAIN from the best."""
    keyframe, per_frame = 0.02, {"splat": 1e-3, "rigid": 4e-3}
    search, windows, _ = searched(keyframe, per_frame)
    every = []
    for method, rate, k in Grid.of(setting()).ways:
        seconds = (rate * k if method == "none" else rate) * keyframe + rate * k * per_frame.get(method, 0.0)
        every.append((seconds, dense_error(rate * k) + ABOVE.get(method, 0.0)))
    for rtf in (1.0, 0.5, 0.2, 0.1, 0.05, 0.02):
        best = min(error for seconds, error in every if seconds * rtf <= 1)
        assert choose(search.found, wanted_rtf=rtf).candidate.error <= 1.1 * best + 1e-6
    assert len(windows.asked) == len(set(windows.asked)) < len(every)


def test_what_costs_more_than_dense_rendering_is_not_looked_at():
    """Rigid frames that cost twice a keyframe cannot pay: of the same frames dense rendering has the least error."""
    search, windows, full = searched(1e-3, {"splat": 1e-4, "rigid": 2e-3})
    assert all(method != "rigid" for method, _, _ in windows.asked)
    assert [rate for method, rate in full.measured if method == "rigid"] == [62.5]
    assert {c.method for c in search.found} == {"none", "splat"}


def test_errors_beyond_a_coarse_reference_go_on_as_they_did():
    """Errors are those of the formula, where nothing was looked at; a fine reference leaves nothing to add."""
    search, _, _ = searched(0.02, {"splat": 1e-3, "rigid": 4e-3}, reference_hz=2000)
    looked_at = len(search.found)
    assert max(c.frame_rate for c in search.found) == 1000
    search.extrapolate()
    added = search.found[looked_at:]
    assert {(c.method, c.frame_rate) for c in added} >= {("none", 2000), ("rigid", 2000)}
    for c in added:
        assert c.error == pytest.approx(dense_error(c.frame_rate) + ABOVE.get(c.method, 0.0), abs=1e-6)
        per_frame = {"none": 0.02, "splat": 1e-3, "rigid": 4e-3}[c.method]
        keyframes = 0.0 if c.method == "none" else c.keyframe_rate * 0.02
        assert c.seconds == pytest.approx(keyframes + c.frame_rate * per_frame)
    fine, _, _ = searched(0.02, {"splat": 1e-3, "rigid": 4e-3})
    before = len(fine.found)
    fine.extrapolate()
    assert len(fine.found) == before


def test_what_the_user_gives_is_compared_by_all_methods():
    search, windows, _ = searched(1e-2, {"splat": 1e-4, "rigid": 1e-3}, keyframe_rate=60.0, upsampling=5)
    assert {(c.method, c.keyframe_rate, c.upsampling) for c in search.found} == {
        (method, 60.0, 5) for method in ("none", "splat", "rigid")
    }
    assert sorted(windows.asked) == [(method, 60.0, 5) for method in ("none", "rigid", "splat")]


def test_one_method_is_compared_with_itself_alone():
    """Dense rendering of the same frames is cheaper and better here, and no choice where the method is given."""
    cheap, dear = 1e-3, {"splat": 1e-4, "rigid": 2e-3}
    _, everything, _ = searched(cheap, dear, keyframe_rate=31.25)
    assert all(method != "rigid" or k <= 2 for method, _, k in everything.asked)
    search, windows, _ = searched(cheap, dear, methods=("rigid",), keyframe_rate=31.25)
    assert {c.upsampling for c in search.found if c.method == "rigid"} == {8, 16, 32, 64, 128}
    assert {method for method, _, _ in windows.asked} == {"none", "rigid"}


def test_without_time_every_method_is_still_looked_at_once(monkeypatch):
    monkeypatch.setattr("nodes.interpolator.auto.probe.ALLOWED_S", 0.0)
    search, _, full = searched(0.02, {"splat": 1e-3, "rigid": 4e-3})
    assert full.measured == [("rigid", 62.5), ("splat", 125.0)]
    assert {c.method for c in search.found} == {"none", "splat", "rigid"}


def test_cost_between_measured_rates_lies_between():
    full = full_size(0.01, {})
    full.sense, full.events = 1e-3, 0.5
    assert full.seconds(("none", 100.0, 1)) == pytest.approx(100 * 0.01 + 100 * 1e-3 + 0.5)
    assert full.seconds(("rigid", 100.0, 4)) is None
    full.gaps = {("rigid", 50.0): GapCost(0.002, 0.004), ("rigid", 200.0): GapCost(0.004, 0.002)}
    for rate, fixed, frame in (
        (50.0, 0.002, 0.004),
        (100.0, 0.003, 0.003),
        (25.0, 0.002, 0.004),
        (400.0, 0.004, 0.002),
    ):
        expected = rate * 0.01 + 8 * rate * 1e-3 + 0.5 + rate * (fixed + 8 * frame)
        assert full.seconds(("rigid", rate, 8)) == pytest.approx(expected)


def test_a_gap_of_two_lengths_tells_what_does_not_grow_with_it():
    """Gaps of 3 ms + K x 2 ms, by a clock that only the method moves."""
    full = FullSize(setting(), None, [0])
    full._interpolator = lambda method, k: k
    full._gap = lambda method, k, rate: 0.003 + 0.002 * k * (2 if rate == 31.25 else 1)
    full.measure_gap("rigid", 62.5)
    assert full.gaps["rigid", 62.5].fixed == pytest.approx(0.003)
    assert full.gaps["rigid", 62.5].frame == pytest.approx(0.002)
    full.measure_gap("rigid", 31.25)
    gap = full.gaps["rigid", 31.25]
    assert gap.fixed + 8 * gap.frame == pytest.approx(0.003 + 0.004 * 8)
    assert gap.fixed / gap.frame == pytest.approx(1.5)


@pytest.mark.parametrize(
    "given", [{}, {"keyframe_rate": 30.0}, {"upsampling": 6}, {"keyframe_rate": 7.0, "upsampling": 3}]
)
@pytest.mark.parametrize("reference_hz", [8000, 2000])
def test_every_frame_is_one_of_the_reference(given, reference_hz):
    grid = Grid.of(setting(**given), reference_hz)
    assert {method for method, _, _ in grid.ways} == {"none", "splat", "rigid"}
    for _, rate, k in grid.ways:
        steps = grid.base / (rate * k)
        assert steps == pytest.approx(round(steps)) and steps >= 2
        assert given.get("keyframe_rate", rate) == rate and given.get("upsampling", k) == k
    assert np.isclose(grid.base * grid.length * 1e-9, grid.gap, atol=1e-3)
