"""`evis.Simulation` on a GPU: as many steps as one likes, and what each returned stays as it was."""

import numpy as np
import pytest

import evis

SMALL = {"width": 64, "height": 48, "keyframe_rate": 120, "upsampling": 4}


@pytest.mark.gpu
@pytest.mark.parametrize(("time_tolerance", "supersampling"), [(0.0, 0), (1e-4, 0), (1e-4, 2)])
def test_steps_on_a_gpu_are_those_on_a_cpu(time_tolerance, supersampling):
    """Within what `rigid` may differ: where a pixel is shaded anew on one device only."""
    how, taken = {"time_tolerance": time_tolerance, "supersampling": supersampling, **SMALL}, {}
    for device in ("cpu", "cuda"):
        with evis.Simulation("spinning_disk", device=device, interpolator="rigid", **how) as sim:
            taken[device] = [sim.step() for _ in range(6)]
    columns = {device: [np.asarray(on_host(step.events.t)) for step in steps] for device, steps in taken.items()}
    for ours, theirs in zip(columns["cuda"], columns["cpu"], strict=True):
        assert len(ours) == pytest.approx(len(theirs), rel=0.02) and (np.diff(ours) >= 0).all()
    assert sum(map(len, columns["cpu"])) > 1000


def on_host(array):
    return array.numpy() if hasattr(array, "numpy") else array
