"""Writes COCO: boxes and masks of objects in images, `annotations/instances.json`, with the events beside them.

An image is the frame whose exposure's middle is nearest to the stamp or, without one, a picture of the events since the
stamp before. The events are in `events/<camera>/events.npz`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag.export.png import encoded
from evis.dataset.layouts.coco.lines import Lines
from evis.dataset.layouts.coco.masks import run_lengths
from evis.dataset.layouts.coco.nearest_frames import NearestFrames
from evis.dataset.layouts.npz.writer import NpzWriter
from evis.dataset.layouts.sample import Sample
from evis.dataset.layouts.writer import SequenceWriter
from evis.events.arrays import Events
from msgs.camera import CameraInfo, Image

ANNOTATIONS = "annotations/instances.json"
EVENTS = "events"
_OFF, _ON, _NONE = (30, 70, 220), (220, 40, 40), (255, 255, 255)
_HELD = {"boxes", "segmentation"}


class CocoWriter(SequenceWriter):
    """Writes an image for each stamp with boxes or a segmentation, and an annotation for each instance in it."""

    LAYOUT = "coco"

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        # of the events alone, in a folder of its own
        self._events = NpzWriter(self.directory / EVENTS, self.about)
        folder = self.directory / Path(ANNOTATIONS).parent
        folder.mkdir()
        self._parts = {name: Lines(folder / f".{name}.part") for name in ("images", "annotations")}
        self._frames = {camera: NearestFrames() for camera in self.about.cameras}

    def _add(self, camera: str, sample: Sample) -> None:
        self._events.add_sample(camera, Sample(sample.stamp_ns, sample.t0_ns, sample.events))
        if sample.image is not None:
            self._place(camera, self._frames[camera].came(sample.image))
        for kind, _ in sample.kinds():
            if kind not in _HELD:
                self.note(f"COCO has no {kind}: it is left out")
        if "event_instance" in sample.labels:
            self.note("COCO has no labels of events: they are left out")
        if _HELD & dict(sample.kinds()).keys():
            self._annotate(camera, sample)

    def _place(self, camera: str, placed: list[tuple[int | None, Image]]) -> None:
        """Writes frames in place of the pictures of their stamps."""
        for number, frame in placed:
            if number is None:
                self.note("COCO has frames of stamps with boxes or a segmentation: others are left out")
            else:
                self._path(camera, number).write_bytes(encoded(np.asarray(frame.data), frame.encoding))

    def _path(self, camera: str, number: int) -> Path:
        return self.directory / "images" / camera / f"{number:06d}.png"

    def _annotate(self, camera: str, sample: Sample) -> None:
        number, info = self._parts["images"].count + 1, self.about.cameras[camera]
        path = self._path(camera, number)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(encoded(picture(sample.events, info), ""))
        self._place(camera, self._frames[camera].annotated(number, sample.stamp_ns))
        told = {"id": number, "file_name": f"{camera}/{path.name}", "width": info.width, "height": info.height}
        self._parts["images"].add({**told, "stamp_ns": sample.stamp_ns, "camera": camera})
        labels = sample.labels
        if {"box", "segmentation"} <= labels.keys() and self.about.arguments.get("box_of") == "body":
            # A body's box has the id of its first part, whose mask is not the body's, and empty where it is hidden.
            labels = {name: array for name, array in labels.items() if name != "segmentation"}
            self.note("COCO has masks of instances, left out beside boxes of bodies: box_of: instance gives both")
        for instance, box, mask in visible_instances(labels):
            width, height = box[2] - box[0] + 1, box[3] - box[1] + 1
            category = int(info.semantic[instance]) if info.semantic is not None else 1
            self._parts["annotations"].add(
                {
                    "id": self._parts["annotations"].count + 1, "image_id": number, "category_id": category,
                    "bbox": [box[0], box[1], width, height], "iscrowd": 0, "track_id": instance,
                    "area": width * height if mask is None else int(mask.sum()),
                    "segmentation": [] if mask is None else run_lengths(mask),
                }
            )  # fmt: skip

    def _finish(self) -> None:
        self._events.close()
        for camera, frames in self._frames.items():
            self._place(camera, frames.rest())
        infos = self.about.cameras.values()
        classes = next((info.classes for info in infos if info.semantic is not None), ["background", "thing"])
        categories = [{"id": k, "name": name, "supercategory": "thing"} for k, name in enumerate(classes) if k]
        head = {"info": {"description": self.about.name, "version": "1.0"}, "licenses": [], "categories": categories}
        with (self.directory / ANNOTATIONS).open("w") as out:
            out.write(json.dumps(head)[:-1])
            for name, lines in self._parts.items():
                out.write(f', "{name}": [')
                lines.pour(out)
                out.write("]")
            out.write("}\n")


def visible_instances(labels: Mapping[str, np.ndarray]) -> Iterator[tuple[int, list[int], np.ndarray | None]]:
    """Yields (instance, box x0 y0 x1 y1 px inclusive, mask [H, W] or None) of what is seen, without the background.

    Boxes are the labels' own; without them they are those of the masks.
    """
    ids = labels.get("segmentation")
    if "box" in labels:
        for box, instance in zip(labels["box"].tolist(), labels["box_id"].tolist()):
            yield instance, [int(v) for v in box], None if ids is None else ids == instance
        return
    assert ids is not None
    for instance in np.unique(ids[ids > 0]).tolist():
        mask = ids == instance
        rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
        yield instance, [int(v) for v in (columns[0], rows[0], columns[-1], rows[-1])], mask


def picture(events: Events, info: CameraInfo) -> np.ndarray:
    """Draws events uint8 [H, W, 3], the last one of a pixel: ON red, OFF blue, over white."""
    image = np.full((info.height, info.width, 3), _NONE, np.uint8)
    image[events.y, events.x] = np.array((_OFF, _ON), np.uint8)[events.p]
    return image
