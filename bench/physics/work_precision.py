"""Error against run time of the dynamics: cases with a known course, by every integrator and time step.

    evis bench physics [--quick]

Each case is written as a scene and moved by the engine of the physics node, so what is measured is what a run
publishes. The truth is a closed form or an integration of our own in float64 (references.py), never the engine itself.
A case has a limit, the error that counts as right; what is off or diverges stays in the tables, with what was said of
it. CPU seconds are process time of one core, without loading.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from bench import command
from bench.physics import contacts, free, piles, springs
from bench.physics.plot import plot
from bench.physics.tables import sections
from bench.physics.trial import Method, run

__all__ = ["measure", "plot"]


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all tables; quick: the two longest time steps of each case, and shorter runs."""
    trials = []
    for case in [case for room in (free, springs, contacts, piles) for case in room.cases(quick)]:
        for integrator in case.integrators:
            for step in case.steps[:2] if quick else case.steps:
                with tempfile.TemporaryDirectory() as folder:
                    trials.append(run(case, Method(integrator, step), Path(folder)))
    return sections(trials)


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
