"""What nodes stand on: the bus, the node runtime, launch, geometry, scenes, streams, bags, the command line."""

from evis import interrupt as interrupt  # before anything else, so that no moment is left without it
from evis.neighbours import install as _meet_neighbours

_meet_neighbours()
