"""Labels of events between frames: what is thin is on a pixel between two sub-frames alone."""

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


@pytest.mark.parametrize("tolerance", [1e-4, 5e-4])
def test_all_events_of_a_bar_before_an_even_wall_are_the_bars(tmp_path, tolerance):
    """Nothing else moves or changes: it is on a pixel for 1.2 ms, and sub-frames are 4 ms apart."""
    path = tmp_path / "bar.yaml"
    path.write_text(SCENE)
    given = {"width": 24, "height": 8, "outputs": ["events", "labels.events", "info"], "upsampling": 8}
    with evis.Simulation(path, time_tolerance=tolerance, audit=0, **given) as sim:
        steps = [sim.reset(), *(sim.step() for _ in range(3))]
        bar = list(sim.reset().info.instances).index("bar")
    found = np.concatenate([step.labels.event_instance for step in steps])
    # It passes 11 columns of 8 pixels, and ln 10 is 11 thresholds, down and up again.
    assert len(found) == 11 * 8 * 22 and (found == bar).all()
