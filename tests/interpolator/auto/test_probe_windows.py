"""Errors in cut-outs of the image: nothing for what is the reference itself, and several windows as one sensor."""

import pytest

from evis.scene import load_scene
from nodes.interpolator.auto.error import Windows
from nodes.interpolator.auto.setting import Grid, Setting
from nodes.interpolator.auto.world import World

CUTS = [(4, 8, 16, 12), (24, 14, 16, 12)]
STARTS = [0, 30_000_000]
RATE, K = 125.0, 4


@pytest.fixture(scope="module")
def made():
    scene = load_scene("spinning_disk", {"width": 48, "height": 36, "omega": 30})
    s = Setting(scene, scene.camera("cam0"), 60_000_000, keyframe_rate=RATE, upsampling=K, sensor={"threshold": 0.2})
    grid, world = Grid.of(s, 2000), World(scene, 60_000_000)
    found = []
    for starts, cuts in ((STARTS, CUTS), *(([t], [c]) for t, c in zip(STARTS, CUTS))):
        windows = Windows(s, world, starts, cuts)
        windows.draw(grid)
        found.append(windows)
    return grid, found


def test_the_reference_has_no_error_and_fewer_frames_have_some(made):
    grid, (windows, *_) = made
    exact, half, few = windows.errors([("none", grid.base / n, 1) for n in (1, 2, 4)])
    assert exact == 0 and 0 < half < few < 1


@pytest.mark.parametrize("way", [("none", RATE, K), ("splat", RATE, K), ("rigid", RATE, K)])
def test_windows_count_by_their_events(made, way):
    """Together they have the mean of what each has by itself, weighted by the events of both streams, which lies
    between the two."""
    _, (both, *single) = made
    (together,), apart = both.errors([way]), [windows.errors([way])[0] for windows in single]
    assert 0 < min(apart) <= together <= max(apart) < 1
