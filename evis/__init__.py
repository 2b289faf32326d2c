"""What nodes stand on: the bus, the node runtime, launch, geometry, scenes, streams, bags, the command line."""

import evis.console.interrupt  # noqa: F401 - before anything else, so that no moment is left without it
from evis.neighbours import install as _meet_neighbours

_meet_neighbours()
