"""Flow over a part of the interval, in an environment that was reset by itself: as in a run of its own."""

import numpy as np
import pytest

import evis

GIVEN = {"width": 48, "height": 36, "audit": 0, "flow_from": 0.3, "flow_to": 0.7}
KINDS = ("forward", "backward")


@pytest.mark.parametrize(("scene", "own"), [("drone", {"shiver": 1.0}), ("stereo_room", {})])
def test_flow_over_a_part_of_the_interval_is_that_of_a_run_of_its_own(scene, own):
    """The environment's sub-steps lie elsewhere on the clock of the stamps, as 1/30 s is no whole number of them."""
    given = GIVEN | own | {"outputs": [f"labels.{kind}_flow" for kind in KINDS]}
    with evis.Simulation(scene, envs=2, **given) as sim:
        sim.reset(seed=0)
        sim.step()
        sim.reset(envs=[1], seed=[1])
        together = [sim.step().labels for _ in range(2)]
    with evis.Simulation(scene, **given) as sim:
        sim.reset(seed=1)
        alone = [sim.step().labels for _ in range(2)]
    for a, b in zip(together, alone):
        for kind in KINDS:
            assert np.nanmax(np.abs(getattr(b, f"{kind}_flow"))) > 0.1
            for what in ("flow", "valid"):
                one, other = (getattr(labels, f"{kind}_{what}") for labels in (a, b))
                np.testing.assert_array_equal(one[1], other[0])
