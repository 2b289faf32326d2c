"""An environment that is put back to its start while samples of single pixels are taken between the frames."""

from typing import Any

import numpy as np

import evis

HOW: dict[str, Any] = {"width": 32, "height": 24, "upsampling": 4, "time_tolerance": 1e-4, "audit": 0}


def test_a_reset_environment_has_the_events_that_it_has_alone() -> None:
    """In its own time, byte for byte, also the first one, whose sensor has another episode than its neighbour's."""
    with evis.Simulation("fidget_spinner", envs=2, **HOW) as sim:
        sim.reset(seed=1)
        sim.step()
        sim.reset(seed=[7], envs=[1])
        found = [sim.step().events for _ in range(2)]
    with evis.Simulation("fidget_spinner", **HOW) as alone:
        alone.reset(seed=7)
        expected = [alone.step().events for _ in range(2)]
    origin = expected[0].t[0] - found[0].t[found[0].env_offsets[1]]
    for events, own in zip(found, expected, strict=True):
        part = slice(*events.env_offsets[1:])
        assert len(own.t) > 1000 and np.array_equal(events.t[part] + origin, own.t)
        assert all(np.array_equal(getattr(events, name)[part], getattr(own, name)) for name in "xyp")
    assert origin == -33_333_333
