"""What nodes stand on: the bus, the node runtime, launch, geometry, scenes, streams, bags, the command line."""

from importlib import import_module
from typing import Any

import evis.console.interrupt  # noqa: F401 - before anything else, so that no moment is left without it
from evis.neighbours import install as _meet_neighbours

_meet_neighbours()

_LAZY = {
    "connect": "evis.client:connect",
}
"""Public name -> where it stands, imported when it is asked for."""


def __getattr__(name: str) -> Any:
    """Imports a public name on first use."""
    if name not in _LAZY:
        raise AttributeError(f"module 'evis' has no attribute '{name}'")
    module, _, attribute = _LAZY[name].partition(":")
    return getattr(import_module(module), attribute)
