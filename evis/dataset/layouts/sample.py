"""Holds what a step has of one camera, in numpy arrays of a single environment, whatever the step's own are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.events.arrays import Events
from evis.gpu.host_copies import host_array
from evis.simulation.step import CameraOutputs, Step
from msgs.camera import Image, Labels
from msgs.fields import array_specs

DENSE = {
    "flow": ("flow",),
    "depth": ("depth",),
    "segmentation": ("segmentation",),
    "semantic": ("semantic",),
    "poses": ("pose",),
    "velocities": ("velocity",),
    "accelerations": ("acceleration",),
    "joints": ("qpos", "qvel"),
    "forward_flow": ("forward_flow", "forward_valid", "flow_t"),
    "backward_flow": ("backward_flow", "backward_valid", "flow_t"),
}
"""Kinds of labels with one array per stamp, of the same shape at all of them; the arrays are those of msgs' Labels."""
TABLES = {
    "boxes": ("box", "box_id"),
    "boxes3d": ("box3d_id", "box3d_size", "box3d_pose", "box3d_in_camera"),
    "contacts": ("contact_body", "contact_position", "contact_force"),
}
"""Kinds with as many rows at a stamp as there are boxes or contacts."""
EVENTS = ("event_instance", "event_flow", "event_signal")
"""Of the kind `events`: a row for each event."""
ENVIRONMENT_AXIS = frozenset(name for name, spec in array_specs(Labels).items() if spec.dims[0] == "E")
"""Arrays of Labels that have one row for each environment, which those of a sample have not."""


@dataclass
class Sample:
    """Holds the outputs of one camera in one step.

    stamp_ns: its end. t0_ns: start of the events' interval. labels: array name -> array, without the axis of the
    environments. bodies: those of poses, velocities and accelerations. has_packet: whether there was a packet of
    events, which may be of none; beside a further image of a step there is not, so that its stamps bound no events.
    """

    stamp_ns: int
    t0_ns: int
    events: Events
    labels: dict[str, np.ndarray] = field(default_factory=dict)
    image: Image | None = None
    bodies: tuple[str, ...] = ()
    has_packet: bool = False

    def kinds(self) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
        """Yields what there is of DENSE and TABLES, as (kind, its arrays)."""
        for kind, names in (*DENSE.items(), *TABLES.items()):
            if names[0] in self.labels:
                yield kind, {name: self.labels[name] for name in names}


def samples(step: Step, taken: Callable[[Any], Any] = host_array) -> Iterator[tuple[str, Sample]]:
    """Yields (camera, what the step has of it). Raises LayoutError for several environments, and undecoded events.

    taken: makes of an array, numpy's or Warp's, what the sample is to have.
    """
    if len(step.episodes) > 1:
        raise LayoutError(f"a sequence is of one environment, the step has {len(step.episodes)}; write each by itself")
    for camera, outputs in step.cameras.items():
        for image in vars(outputs).get("images", ())[:-1]:
            stamp_ns = image.header.stamp_ns
            yield camera, Sample(stamp_ns, stamp_ns, Events.empty(), image=image)
        yield camera, _sample(camera, step.stamp_ns, outputs, taken)


def _sample(camera: str, stamp_ns: int, outputs: CameraOutputs, taken: Callable[[Any], Any]) -> Sample:
    there = vars(outputs)
    sample = Sample(stamp_ns, stamp_ns, Events.empty())
    packet = there.get("events")
    if packet is not None:
        if packet.t is None:
            raise LayoutError(f"the events of {camera} are in the encoding '{packet.encoding}'; decode them first")
        sample.t0_ns, sample.has_packet = packet.t0_ns, True
        t, x, y, p = (taken(getattr(packet, name)) for name in "txyp")
        sample.events = Events(t, x, y, p)
    if there.get("labels") is not None:
        labels: Labels = there["labels"]
        for name, array in labels.arrays().items():
            if not name.endswith("_env"):
                whole = taken(array)
                sample.labels[name] = whole[0] if name in ENVIRONMENT_AXIS else whole
        sample.bodies = tuple(labels.names)
    for output, kind in (("depth", "depth"), ("ids", "segmentation")):
        if there.get(output) is not None:
            sample.labels.setdefault(kind, taken(there[output])[0])
    sample.image = there.get("image")
    return sample
