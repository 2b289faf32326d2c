"""Reads a sequence in COCO's layout."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from evis.dataset.layouts import LayoutError
from evis.dataset.layouts.coco.masks import mask_of
from evis.dataset.layouts.coco.writer import ANNOTATIONS, EVENTS
from evis.dataset.layouts.joined import joined
from evis.dataset.layouts.npz.reader import NpzReader
from evis.dataset.layouts.reader import ANEW, EventArrays, SequenceReader
from evis.files.json_text import parsed
from evis.files.regular import check_file


class CocoReader(SequenceReader):
    """Reads events in parts; the annotations, which are one JSON document, as a whole."""

    LAYOUT = "coco"

    @cached_property
    def _events_reader(self) -> NpzReader:
        return NpzReader(self.directory / EVENTS)

    @cached_property
    def _stamps(self) -> dict[str, list[tuple[int, list[dict[str, Any]]]]]:
        """Camera -> (stamp, annotations) of its images, in order of time."""
        path = self.directory / ANNOTATIONS
        check_file(path)
        try:
            whole = parsed(path.read_text())
            found: dict[int, list[dict[str, Any]]] = {image["id"]: [] for image in whole["images"]}
            for annotation in whole["annotations"]:
                found[annotation["image_id"]].append(annotation)
            cameras: dict[str, list[tuple[int, list[dict[str, Any]]]]] = {camera: [] for camera in self.cameras}
            for image in whole["images"]:
                cameras[image["camera"]].append((image["stamp_ns"], found[image["id"]]))
        except (OSError, ValueError, KeyError, TypeError) as error:  # another program's COCO has no stamps
            raise LayoutError(f"{path} cannot be read ({error!r}); {ANEW}") from None
        return cameras

    def _count_of(self, camera: str) -> int:
        return self._events_reader.count_of(camera)

    def _kinds(self, camera: str) -> tuple[str, ...]:
        stamps = self._stamps[camera]
        masks = any(a["segmentation"] for _, things in stamps for a in things)
        return (*(["boxes"] if stamps else []), *(["segmentation"] if masks else []))

    def _events(self, t0: int, t1: int, camera: str) -> EventArrays:
        return self._events_reader.events(t0, t1, camera)

    def _rows(self, first: int, end: int, camera: str) -> EventArrays:
        return self._events_reader.rows(first, end, camera)

    def _labels(self, kind: str, t0: int, t1: int, camera: str) -> dict[str, np.ndarray]:
        info = self.cameras[camera]
        pieces: list[tuple[int, dict[str, np.ndarray]]] = []
        for stamp, things in self._stamps[camera]:
            if not t0 <= stamp < t1:
                continue
            if kind == "segmentation":
                ids = np.zeros((info.height, info.width), np.int32)
                for annotation in things:
                    ids[mask_of(annotation["segmentation"], ids.shape)] = annotation["track_id"]
                pieces.append((stamp, {"segmentation": ids}))
                continue
            box = np.array([a["bbox"] for a in things], np.float32).reshape(-1, 4)
            box[:, 2:] += box[:, :2] - 1
            pieces.append((stamp, {"box": box, "box_id": np.array([a["track_id"] for a in things], np.int32)}))
        return joined(kind, pieces, info)
