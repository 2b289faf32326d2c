"""COCO's layout against the simulator's truth, by json and PIL alone; pycocotools is with the extras."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as PilImage
from sequences import events_of, framed, frames_of, labels_of, simulated, written

from evis.dataset.about import About
from evis.dataset.layouts import reader_of, writer_of
from evis.dataset.layouts.coco.masks import run_lengths
from msgs.camera import Image
from msgs.header import Header


@pytest.fixture(scope="module")
def document(tmp_path_factory: Any) -> tuple[Path, dict[str, Any]]:
    about, steps = simulated("warehouse", "boxes", "segmentation")
    folder = tmp_path_factory.mktemp("coco") / "s"
    written("coco", folder, about, steps)
    return folder, json.loads((folder / "annotations/instances.json").read_text())


def decoded(coded: dict[str, Any]) -> np.ndarray:
    """A mask out of run lengths, cell by cell down the columns, as COCO defines them."""
    height, width = coded["size"]
    cells: list[int] = []
    for k, count in enumerate(coded["counts"]):
        cells += [k % 2] * count
    return np.array([[cells[x * height + y] for x in range(width)] for y in range(height)], bool)


def test_boxes_and_masks_are_those_of_the_labels(document: tuple[Path, dict[str, Any]]) -> None:
    """Every instance that is seen, with its class; a mask has as many pixels as its area says."""
    about, steps = simulated("warehouse", "boxes", "segmentation")
    stamps, ids = labels_of(steps, "cam0", "segmentation")
    _, boxes = labels_of(steps, "cam0", "box")
    info, (_, whole) = about.cameras["cam0"], document
    assert info.semantic is not None
    names = {category["id"]: category["name"] for category in whole["categories"]}
    assert names == {k: name for k, name in enumerate(info.classes) if k}
    assert [image["stamp_ns"] for image in whole["images"]] == stamps.tolist()
    assert [a["id"] for a in whole["annotations"]] == list(range(1, len(whole["annotations"]) + 1))
    for image, truth, box in zip(whole["images"], ids, boxes):
        mine = [a for a in whole["annotations"] if a["image_id"] == image["id"]]
        assert len(mine) == len(box) > 80
        assert [[x, y, x + w - 1, y + h - 1] for x, y, w, h in (a["bbox"] for a in mine)] == box.tolist()
        for annotation in mine:
            mask = decoded(annotation["segmentation"])
            assert np.array_equal(mask, truth[0] == annotation["track_id"]) and mask.sum() == annotation["area"] > 0
            assert annotation["category_id"] == info.semantic[annotation["track_id"]]


def test_the_events_beside_it_are_a_sequence_that_tells_how_many(document: tuple[Path, dict[str, Any]]) -> None:
    """It is in NPZ's layout, for who reads events alone."""
    about, steps = simulated("warehouse", "boxes", "segmentation")
    counts = {camera: len(events_of(steps, camera)["t"]) for camera in about.cameras}
    assert About.load(document[0] / "events").counts == About.load(document[0]).counts == counts
    assert sum(counts.values()) > 100


def test_boxes_of_bodies_have_no_mask_of_one_part(tmp_path: Path) -> None:
    """A box's id is that of one part, which may be hidden: masks of no pixels were written. The writer tells it."""
    about, steps = simulated("warehouse", "boxes", "segmentation", box_of="body")
    writer = written("coco", tmp_path / "s", about, steps)
    whole = json.loads((tmp_path / "s" / "annotations/instances.json").read_text())
    _, boxes = labels_of(steps, "cam0", "box")
    assert len(whole["annotations"]) == sum(map(len, boxes)) > 80
    for annotation in whole["annotations"]:
        _, _, width, height = annotation["bbox"]
        assert annotation["segmentation"] == [] and annotation["area"] == width * height
    assert any("box_of: instance gives both" in note for note in writer.notes)


def test_an_image_shows_the_events_of_its_interval(document: tuple[Path, dict[str, Any]]) -> None:
    """The pixels that are not white are those that had one."""
    folder, whole = document
    _, steps = simulated("warehouse", "boxes", "segmentation")
    want = events_of(steps, "cam0")
    before = 0
    for image in whole["images"]:
        with PilImage.open(folder / "images" / image["file_name"]) as file:
            pixels = np.asarray(file)
        part = (want["t"] > before) & (want["t"] <= image["stamp_ns"])
        seen = np.zeros(pixels.shape[:2], bool)
        seen[want["y"][part], want["x"][part]] = True
        assert np.array_equal((pixels != 255).any(-1), seen) and (seen.any() or not image["stamp_ns"])
        before = image["stamp_ns"]


def test_the_reader_gives_the_labels(document: tuple[Path, dict[str, Any]]) -> None:
    _, steps = simulated("warehouse", "boxes", "segmentation")
    reader = reader_of("coco")(document[0])
    stamps, ids = labels_of(steps, "cam0", "segmentation")
    _, boxes = labels_of(steps, "cam0", "box")
    assert np.array_equal(reader.labels("segmentation", 0, 10**12)["segmentation"], np.concatenate(ids))
    got = reader.labels("boxes", int(stamps[1]), int(stamps[3]))
    assert np.array_equal(got["box"], np.concatenate(boxes[1:3])) and got["t"].tolist() == stamps[1:3].tolist()


@pytest.mark.parametrize("late", [1, 2])
def test_a_frame_is_the_image_of_the_stamp_that_is_nearest_to_its_middle(late: int, tmp_path: Path) -> None:
    """It comes with the step after its exposure's end, here a step or two after the one that it belongs to."""
    about, steps = simulated("spinning_disk", "boxes")
    writer = writer_of("coco")(tmp_path / "s", about)
    for k, step in enumerate(steps[:5]):
        outputs = dict(vars(step.cameras["cam0"]))
        if k >= late:
            pixels = np.full((48, 64, 1), 10 * (k - late), np.uint8)
            outputs["image"] = Image(Header(steps[k - late].stamp_ns + 2_000_000), pixels, "mono8", 4_000_000)
        writer.add(type(step)(step.stamp_ns, step.episodes, {"cam0": outputs}, {}, step.over))
    writer.close()
    assert writer.notes == []
    seen = []
    for number in range(1, 6):
        with PilImage.open(tmp_path / f"s/images/cam0/{number:06d}.png") as file:
            seen.append(file.getpixel((3, 4)) if file.mode == "L" else "events")
    assert seen == [*(10 * k for k in range(5 - late)), *["events"] * late]


def test_frames_without_boxes_are_left_out_and_said(tmp_path: Path) -> None:
    """Of three frames between two stamps the last is the image of the second."""
    about, plain = simulated("warehouse", "boxes", "segmentation")
    frames = framed(plain)
    writer = writer_of("coco")(tmp_path / "s", about)
    bare = [dict(vars(step.cameras["cam0"])) for step in frames[1:3]]
    for outputs in bare:
        outputs.pop("labels")
    for step, outputs in zip(frames[:4], [None, *bare, None]):
        writer.add(step if outputs is None else type(step)(step.stamp_ns, step.episodes, {"cam0": outputs}, {}, False))
    writer.close()
    assert writer.notes == ["COCO has frames of stamps with boxes or a segmentation: others are left out"]
    whole = json.loads((tmp_path / "s/annotations/instances.json").read_text())
    for image, k in zip(whole["images"], (0, 3), strict=True):
        with PilImage.open(tmp_path / "s/images" / image["file_name"]) as file:
            assert np.array_equal(np.asarray(file), frames_of(frames, "cam0")[k, ..., 0])


@pytest.mark.parametrize("cells", [[[0, 0], [0, 0]], [[1, 1], [1, 1]], [[1, 0], [0, 1]], [[0, 1], [0, 1]]])
def test_run_lengths(cells: list[list[int]]) -> None:
    """Of masks that begin or end with a run of 1, and of none."""
    mask = np.array(cells, bool)
    coded = run_lengths(mask)
    assert np.array_equal(decoded(coded), mask) and sum(coded["counts"]) == mask.size
