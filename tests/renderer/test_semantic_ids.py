"""Semantic ids: what kind of thing each pixel shows, in /info by instance and as a label by pixel."""

import numpy as np
import pytest
from node_bus import Bus, state

from evis.scene import load_scene
from msgs.camera import CameraInfo, Ids
from msgs.header import Header
from nodes.labeler.node import LabelerNode
from nodes.renderer.node import RendererNode

YARD = """
cameras: {cam0: {position: [0, -6, 1], look_at: [0, 0, 1], fov: 60 deg}}
materials: {grey: {albedo: 0.5}}
bodies:
  cart:
    position: [-1.5, 0, 0.5]
    copies: {over: {k: 2}}
    shapes:
      - {shape: box, size: [0.8, 0.8, 0.5], material: grey}
      - {shape: sphere, name: "lamp ${k}", radius: 0.2, position: [0, 0, 0.6], material: grey, semantic: light}
  dog:
    semantic: animal
    position: [1.5, 0, 0.5]
    shapes:
      - {shape: sphere, name: head, radius: 0.3, position: [0, 0, 0.6], material: grey}
      - {shape: box, size: [0.4, 0.4, 0.4], material: grey}
world:
  - name: post
    shape: box
    size: [0.6, 0.2, 2]
    position: ["${k}", 2, 1]
    material: grey
    copies: {over: {k: [-0.5, 0.5]}}
  - {shape: box, size: [9, 9, 0.1], material: grey}
lights: {sun: {kind: directional, direction: [0, 1, -1], irradiance: 3}}
"""


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "yard.yaml"
    path.write_text(YARD)
    return path


def test_a_thing_is_what_it_or_its_body_says_or_is_called(yard):
    found = {instance.name: instance.semantic for instance in load_scene(str(yard)).instances}
    assert sorted(found.values()) == sorted(["cart", "light"] * 2 + ["animal"] * 2 + ["post"] * 2 + ["world"])
    assert {kind for name, kind in found.items() if name.startswith("lamp")} == {"light"}
    assert {kind for name, kind in found.items() if name.startswith("post")} == {"post"}
    assert found["head"] == "animal"


def test_links_of_a_robot_are_classes():
    scene = load_scene("robot_arm", {"width": 16, "height": 12})
    of = {instance.name: instance.semantic for instance in scene.instances if instance.body >= 0}
    bodies = {instance.name: scene.bodies[instance.body].name for instance in scene.instances if instance.body >= 0}
    assert of and of == bodies


def test_the_label_tells_the_class_of_every_pixel(yard):
    size = {"width": 48, "height": 36}
    scene = load_scene(str(yard), size)
    renderer = RendererNode("renderer", {**size, "scene": str(yard)})
    renderer.runtime = bus = Bus("ids")
    renderer.setup()
    info = bus.take()["info"]
    info.check()
    assert info.classes[0] == "background" and len(set(info.classes)) == len(info.classes) == 6
    assert [info.classes[k] for k in info.semantic] == ["background", *(i.semantic for i in scene.instances)]
    renderer.update({"state": state(scene, 0.0)})
    ids = bus.take()["ids"]
    labeler = LabelerNode("labeler", {"labels": ["semantic"]})
    assert LabelerNode.needs(labeler.params, frozenset({"labels"})) == {"ids", "info"}
    labeler.runtime = out = Bus("labels")
    labeler.setup()
    labeler.receive("info", info)
    labeler.update({"ids": ids})
    ((_, labels),) = out.sent
    by_hand = [["background", *(i.semantic for i in scene.instances)][k] for k in ids.ids.ravel()]
    assert [info.classes[k] for k in labels.semantic.ravel()] == by_hand
    assert set(by_hand) == {"background", "cart", "light", "animal", "post", "world"}
    assert labels.segmentation is None


def test_without_a_table_the_label_is_an_error():
    labeler = LabelerNode("labeler", {"labels": ["semantic"]})
    labeler.runtime = Bus("labels")
    labeler.setup()
    labeler.receive("info", CameraInfo(Header(0), np.eye(3), np.zeros(0)))
    with pytest.raises(ValueError, match="/cam0/info has no semantic ids"):
        labeler.update({"ids": Ids(Header(0), np.zeros((1, 2, 2), np.int32))})
