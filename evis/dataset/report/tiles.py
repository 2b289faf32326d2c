"""Makes the pictures of one sequence: frame, events, and each kind of label that can be drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from evis.dataset.about import About
from evis.dataset.layouts import reader_of
from evis.dataset.making.frame import FRAME
from evis.media.pictures.event_pictures import faded_events
from evis.runtime.clock import keyframe_count, keyframe_stamp
from msgs.camera import FLOWS
from nodes.visualizer.colour import Smoothed, depth_colours, flow_colours, id_colour, id_colours

TAU_NS = 10_000_000
"""Events fade over this time."""
IDS = ("segmentation", "semantic")


def tiles(folder: Path, layout: str) -> dict[str, np.ndarray]:
    """Draws the middle of a sequence, name -> uint8 [H, W, 3], all of the first camera. Raises LayoutError, OSError."""
    reader = reader_of(layout)(folder)
    camera, info = next(iter(reader.cameras.items()))
    middle = reader.about.start_ns + _middle(reader.about)
    found = {}
    if (folder / FRAME).is_file():
        found["frame"] = np.asarray(Image.open(folder / FRAME).convert("RGB"))
    events = reader.events(middle - 5 * TAU_NS, middle + 1, camera)
    t, x, y, p = (np.asarray(column) for column in events)
    found["events"] = faded_events(t, x, y, p, info.width, info.height, middle, TAU_NS)
    period = round(1e9 / reader.about.keyframe_rate) if reader.about.keyframe_rate else reader.duration_ns
    for kind in reader.kinds(camera):
        labels = reader.labels(kind, middle - period, middle + 2 * period, camera)
        picture = _label(kind, labels, middle, found.get("frame"), (info.height, info.width))
        if picture is not None:
            found[kind] = picture
    return found


def _middle(about: About) -> int:
    """Time of the frame that a sequence keeps [ns], from its start."""
    if not about.keyframe_rate:
        return about.duration_ns // 2
    return keyframe_stamp(keyframe_count(about.duration_ns, about.keyframe_rate) // 2, about.keyframe_rate)


def _label(
    kind: str, labels: dict[str, Any], at_ns: int, frame: np.ndarray | None, size: tuple[int, int]
) -> np.ndarray | None:
    """One kind of label, that whose pixels are those of a time; None for a kind that is no picture, or is not there."""
    if kind not in (*FLOWS, *IDS, "depth", "disparity", "boxes") or not len(labels["t"]):
        return None
    times = labels["flow_t"].min(axis=-1) if kind == "forward_flow" and "flow_t" in labels else labels["t"]
    nearest = int(np.abs(np.asarray(times, np.int64) - at_ns).argmin())
    if kind == "boxes":
        return _boxes(labels, nearest, frame, size)
    image = np.asarray(labels[kind][nearest])
    if kind in FLOWS:
        return flow_colours(image, Smoothed())[0]
    if kind == "disparity":  # as depth is, up to a factor; 0 is unknown
        image = np.divide(1.0, image, out=np.full(image.shape, np.inf, np.float32), where=image > 0)
    return id_colours(image) if kind in IDS else depth_colours(image, Smoothed())[0]


def _boxes(labels: dict[str, Any], at: int, frame: np.ndarray | None, size: tuple[int, int]) -> np.ndarray:
    picture = Image.fromarray(np.zeros((*size, 3), np.uint8) if frame is None else frame)
    draw = ImageDraw.Draw(picture)
    rows = slice(*map(int, labels["offsets"][at : at + 2])) if "offsets" in labels else slice(None)
    for box, instance in zip(labels["box"][rows], labels["box_id"][rows]):
        draw.rectangle([float(edge) for edge in box], outline=id_colour(int(instance)))
    return np.asarray(picture)
