"""Measures error against run time of the dynamics on known courses, by every integrator, time step and tolerance.

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
from bench.physics.tables import FIRST, sections
from bench.physics.trial import Method, run

__all__ = ["measure", "plot"]


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all tables; quick: the two longest time steps of each case, one tolerance, and shorter runs."""
    trials = []
    for case in [case for room in (free, springs, contacts, piles) for case in room.cases(quick)]:
        steps, tolerances = (case.steps[:2], case.tolerances[1:2]) if quick else (case.steps, case.tolerances)
        methods = [Method(integrator, step) for integrator in case.integrators for step in steps]
        for method in [*methods, *(Method(*FIRST, tolerance) for tolerance in tolerances)]:
            with tempfile.TemporaryDirectory() as folder:
                trials.append(run(case, method, Path(folder)))
    return sections(trials)


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
