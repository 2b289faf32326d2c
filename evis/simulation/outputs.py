"""Reads the outputs that a caller asks for, and finds the topics that they stand for."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from evis.simulation.errors import SimulationError
from evis.simulation.output_names import LABELS, NAMES, OF_CAMERA, meant
from msgs.topics import SYSTEM_TOPICS


@dataclass(frozen=True)
class RequestedOutputs:
    """Holds what a caller wants to get. globs: of the topics. labels: kinds of labels that were named."""

    globs: tuple[str, ...]
    labels: tuple[str, ...]

    @property
    def names(self) -> frozenset[str]:
        """Returns the names without their cameras: events, image, ..."""
        return frozenset(glob.rpartition("/")[2] for glob in self.globs)

    def topics(self, available: Iterable[str]) -> list[str]:
        """Lists the topics of a graph that were asked for. Raises ValueError where it has none of a name."""
        names = [name for name in available if name not in SYSTEM_TOPICS]
        found: dict[str, None] = {}
        for glob in self.globs:
            hits = fnmatch.filter(names, glob)
            if not hits:
                camera, _, name = glob[1:].rpartition("/")
                cameras = dict.fromkeys(n[1:].rpartition("/")[0] for n in names if n.count("/") > 1)
                if camera not in ("", "*", *cameras):
                    raise ValueError(
                        f"the graph has no output {name} of camera {camera}; it has {', '.join(cameras)}; "
                        f"where the scene has it, cameras={[*cameras, camera]} adds it"
                    )
                of = f" of camera {camera}" if camera not in ("", "*") else ""
                there = dict.fromkeys(n.strip("/").replace("/", ".") if of else n.rpartition("/")[2] for n in names)
                raise ValueError(f"the graph has no output {name}{of}; it has {', '.join(sorted(there))}")
            found |= dict.fromkeys(hits)
        return list(found)


def parse(outputs: Sequence[str] | str) -> RequestedOutputs:
    """Reads output names: `events`, of one camera as `cam1.events`, one kind of label as `labels.flow`, `state`.

    Raises SimulationError naming the nearest one.
    """
    globs: dict[str, None] = {}
    labels: dict[str, None] = {}
    if not isinstance(outputs, Iterable):
        raise SimulationError(f"outputs is {outputs!r:.60}; it must be a list of names, as ['events']")
    for name in (outputs,) if isinstance(outputs, str) else outputs:
        parts = str(name).split(".")
        if len(parts) > 1 and LABELS in parts[-2:-1]:
            labels[parts.pop()] = None
        *camera, last = parts
        if last not in NAMES or (camera and last not in OF_CAMERA):
            raise SimulationError(f"there is no output '{name}'; {meant(parts)}")
        globs["/" + "/".join([*(camera or (["*"] if last in OF_CAMERA else [])), last])] = None
    if not globs:
        raise SimulationError("a simulation with no output would compute nothing; outputs=('events',) is usual")
    return RequestedOutputs(tuple(globs), tuple(labels))
