"""Writes a bag of ROS 2 messages, `sequence.mcap`, as `evis launch --record` makes one: events, labels, info, image."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.bag.writer import BagWriter
from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.sample import ENVIRONMENT_AXIS, Sample
from evis.dataset.layouts.writer import SequenceWriter
from evis.events.arrays import Events
from msgs.camera import EventPacket, Labels
from msgs.fields import environment_key
from msgs.header import Header, Message

FILE = "sequence.mcap"
COUNTS = "events"


class McapWriter(SequenceWriter):
    """Writes a bag, exact to the nanosecond."""

    LAYOUT = "mcap"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        about = self.about
        told = {"name": about.name, "scene": about.scene, "seed": str(about.seed), "labels": ",".join(about.labels)}
        # Chunks by their size alone: where the time of day cuts them, the same messages are other bytes.
        # One thread: data sets are made by a process on each core.
        self._bag = BagWriter(self.directory / FILE, {"sequence": told}, chunk_period_s=math.inf, threads=1)
        self._without = set(about.cameras)
        """Cameras of which no packet is written."""
        for name, info in about.cameras.items():
            self._write(f"/{name}/info", dataclasses.replace(info, header=Header(about.start_ns)))

    def _add(self, camera: str, sample: Sample) -> None:
        if sample.has_packet:  # an empty one beside an image would be out of order, and readers go by their stamps
            self._packet(camera, sample.events, sample.t0_ns, sample.stamp_ns)
        if sample.labels:
            self._write(f"/{camera}/labels", _message(sample))
        if sample.image is not None:
            self._write(f"/{camera}/image", sample.image)

    def _packet(self, camera: str, e: Events, t0_ns: int, stamp_ns: int) -> None:
        info, offsets = self.about.cameras[camera], np.array([0, len(e)], np.int64)
        size: dict[str, Any] = {"width": info.width, "height": info.height, "t0_ns": t0_ns}
        self._write(f"/{camera}/events", EventPacket(Header(stamp_ns), offsets, e.t, e.x, e.y, e.p, **size))
        self._without.discard(camera)

    def _write(self, topic: str, message: Message) -> None:
        try:
            self._bag.write(topic, message)
        except BagError as error:
            raise LayoutError(str(error)) from None

    def _finish(self) -> None:
        for camera in sorted(self._without):  # a topic without a message is none to a reader
            self._packet(camera, Events.empty(), self.about.start_ns, self.about.start_ns)
        self._bag.close({COUNTS: {camera: str(count) for camera, count in self.counts.items()}})


def _message(sample: Sample) -> Labels:
    """The labels as a message, of one environment."""
    arrays: dict[str, Any] = {
        name: array[None] if name in ENVIRONMENT_AXIS else array for name, array in sample.labels.items()
    }
    for name, array in sample.labels.items():
        if owner := environment_key(name, Labels):
            arrays[owner] = np.zeros(len(array), np.int32)
    return Labels(Header(sample.stamp_ns), names=list(sample.bodies), **arrays)
