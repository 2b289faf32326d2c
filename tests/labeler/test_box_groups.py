"""What has a box of its own: instances or bodies, of all classes or of some."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import evis
from msgs.camera import CameraInfo
from msgs.header import Header
from nodes.labeler.images.box_groups import groups
from nodes.labeler.images.image_labels import boxes

INFO = CameraInfo(
    Header(0),
    np.eye(3),
    np.zeros(0),
    instances=["", "floor", "cab", "mast", "load", "wheel", "wall"],
    instance_bodies=["", "", "lift", "lift", "load", "wheel", ""],
    semantic=np.array([0, 1, 2, 3, 4, 5, 1], np.int32),
    classes=["background", "building", "cab", "mast", "load", "wheel"],
)


def test_groups_by_hand() -> None:
    assert groups(INFO, "instance", None).tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert groups(INFO, "body", None).tolist() == [0, 1, 2, 2, 4, 5, 6]
    assert groups(INFO, "body", ["mast", "load"]).tolist() == [0, 0, 0, 3, 4, 0, 0]
    assert groups(INFO, "instance", ["building"]).tolist() == [0, 1, 0, 0, 0, 0, 6]
    assert groups(INFO, "body", ["cab", "mast"]).tolist() == [0, 0, 2, 2, 0, 0, 0]


def test_wrong_classes() -> None:
    with pytest.raises(ValueError, match=r"box_classes: there is no class 'lod'; did you mean 'load'"):
        groups(INFO, "instance", ["lod"])
    with pytest.raises(ValueError, match="has no classes"):
        groups(dataclasses.replace(INFO, semantic=None), "body", ["load"])


def test_a_box_of_a_body_is_around_its_instances_that_are_seen() -> None:
    """In a graph, beside the segmentation of the same stamp."""
    asked = ["labels.boxes", "labels.segmentation", "info"]
    given = {"width": 96, "height": 72, "box_of": "body", "box_classes": ["hub", "ring", "arm"]}
    with evis.Simulation("fidget_spinner", outputs=asked, **given) as sim:
        step = sim.reset()
        info, labels = step.info, sim.step().labels
    bodies = np.array(info.instance_bodies)
    seen = {body: [] for body in ("spinner", "arm_0", "arm_1", "arm_2")}
    for number in np.unique(labels.segmentation):
        if bodies[number] in seen:
            seen[bodies[number]].append(number)
    assert len(labels.box) == len(seen) and all(seen.values())
    for box, number in zip(labels.box, labels.box_id):
        rows, columns = np.nonzero(np.isin(labels.segmentation[0], seen[bodies[number]]))
        assert box.tolist() == [columns.min(), rows.min(), columns.max(), rows.max()]
        assert number == np.flatnonzero(bodies == bodies[number])[0]


def test_without_boxes_they_have_no_effect() -> None:
    from evis.simulation.errors import SimulationError

    with pytest.raises(SimulationError, match="no label is of boxes"):
        evis.Simulation("spinning_disk", outputs=["labels.depth"], box_of="body")


def test_boxes_of_merged_ids() -> None:
    ids = np.array([[[0, 2, 0, 3], [0, 0, 4, 0]]], np.int32)
    box, _, number = boxes(np.take(groups(INFO, "body", None), ids))
    assert number.tolist() == [2, 4] and box.tolist() == [[1, 0, 3, 0], [2, 1, 2, 1]]
