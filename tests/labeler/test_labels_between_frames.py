"""Labels of the events of something thin, between sub-frames and at them."""

import numpy as np
import pytest

import evis

SCENE = """
cameras: {cam0: {position: [0, 0, 0], look_at: [0, 1, 0], fov: 40 deg}}
bodies:
  bar:
    position: [-0.5, 1, 0]
    motion: {kind: linear, velocity: [10, 0, 0]}
    shapes: [{shape: box, size: [0.012, 0.012, 2], material: dark}]
materials: {dark: {albedo: 0, emission: 0.1}, bright: {albedo: 0, emission: 1}}
world:
  - {shape: plane, size: [9, 9], position: [0, 2, 0], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: bright}
"""


GIVEN = {"width": 24, "height": 8, "outputs": ["events", "labels.events", "info"], "upsampling": 8, "audit": 0}


def labelled(tmp_path, count, **given):
    """Instances of the events of so many keyframe intervals, and that of the bar."""
    path = tmp_path / "bar.yaml"
    path.write_text(SCENE)
    with evis.Simulation(path, **GIVEN, **given) as sim:
        first = sim.reset()
        steps = [first, *(sim.step() for _ in range(count))]
    bar = list(first.info.instances).index("bar")
    return np.concatenate([step.labels.event_instance for step in steps]), bar


@pytest.mark.parametrize("tolerance", [1e-4, 5e-4])
def test_all_events_of_a_bar_before_an_even_wall_are_the_bars(tmp_path, tolerance):
    """Nothing else moves or changes: it is on a pixel for 1.2 ms, and sub-frames are 4 ms apart."""
    found, bar = labelled(tmp_path, 3, time_tolerance=tolerance)
    # It passes 11 columns of 8 pixels, and ln 10 is 11 thresholds, down and up again.
    assert len(found) == 11 * 8 * 22 and (found == bar).all()


@pytest.mark.parametrize("crossing", ["linear", "frame"])
def test_events_at_a_sub_frame_are_of_the_step_that_it_ends(tmp_path, crossing):
    """Stamps of sub-frames are rounded twice, to 58,333,334 ns for one of 58,333,333.3."""
    found, bar = labelled(tmp_path, 5, crossing=crossing)
    assert len(found) > 1500 and (found == bar).all()
