"""What nodes stand on: the bus, the node runtime, launch, geometry, scenes, streams, bags, the command line."""

import evis.console.interrupt  # noqa: F401, isort: skip - before anything else, so that no moment is left without it
import importlib
from typing import Any

from evis.neighbours import install as _meet_neighbours

_meet_neighbours()

_PUBLIC = {
    "Diverged": "evis.simulation.errors:Diverged",
    "Simulation": "evis.simulation.simulation:Simulation",
    "SimulationError": "evis.simulation.errors:SimulationError",
    "SimulationWarning": "evis.simulation.errors:SimulationWarning",
}
"""Name -> where it is; imported when it is first used."""
__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'evis' has no attribute '{name}'")
    module, _, attribute = _PUBLIC[name].partition(":")
    value = globals()[name] = getattr(importlib.import_module(module), attribute)
    return value
