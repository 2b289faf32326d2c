"""Simulates event cameras for robots, from Python; docs/python.md is the tour.

    sim = evis.Simulation("spinning_disk")        a scene, stepped by its caller
    run = evis.connect()                          a graph that runs elsewhere
    events = evis.open("recording.raw")           any recording or bag
    sensor = evis.EventSensor(260, 346)           frames in, events out
    scene = evis.load_scene("spinning_disk")      bodies, cameras, lights
    data = evis.dataset.open("disks")             sequences of a data set, for training

What stands here is imported when it is first used, so that `import evis` takes next to no time.
"""

import evis.console.interrupt  # noqa: F401, I001 - before anything else, so that no moment is left without it
from importlib import import_module

from evis.neighbours import install as _meet_neighbours

TYPE_CHECKING = False
"""As typing's, which takes more time than the rest of this import; type checkers and editors go by the name."""
if TYPE_CHECKING:
    from evis import dataset as dataset
    from evis.client import connect as connect
    from evis.event_sensor import EventSensor as EventSensor
    from evis.event_sensor import Further as Further
    from evis.recordings import open_recorded as open
    from evis.scene.load import load_scene as load_scene
    from evis.simulation.errors import Diverged as Diverged
    from evis.simulation.errors import SimulationError as SimulationError
    from evis.simulation.errors import SimulationWarning as SimulationWarning
    from evis.simulation.simulation import Simulation as Simulation

    __version__: str

__all__ = [
    "Diverged", "EventSensor", "Further", "Simulation", "SimulationError", "SimulationWarning", "__version__",
    "connect", "dataset", "load_scene", "open",
]  # fmt: skip
_LAZY = {
    "Diverged": "evis.simulation.errors:Diverged",
    "EventSensor": "evis.event_sensor:EventSensor",
    "Further": "evis.event_sensor:Further",
    "Simulation": "evis.simulation.simulation:Simulation",
    "SimulationError": "evis.simulation.errors:SimulationError",
    "SimulationWarning": "evis.simulation.errors:SimulationWarning",
    "connect": "evis.client:connect",
    "dataset": "evis.dataset:",
    "load_scene": "evis.scene.load:load_scene",
    "open": "evis.recordings:open_recorded",
}
"""Public name -> module:attribute, or the module itself."""

_meet_neighbours()

if not TYPE_CHECKING:  # who checks types shall not take any name for granted

    def __getattr__(name: str) -> object:
        """Imports a public name at its first use (PEP 562). Raises AttributeError."""
        if name == "__version__":
            from importlib.metadata import version

            value = version("evis")
        elif name in _LAZY:
            module, _, attribute = _LAZY[name].partition(":")
            value = getattr(import_module(module), attribute) if attribute else import_module(module)
        else:
            raise AttributeError(f"module 'evis' has no attribute '{name}'; it has {', '.join(__all__)}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Lists the public names, imported or not."""
    return sorted({*globals(), *__all__})
