"""Nodes of a process share a scene for as long as every file it was made of stays as it was."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evis.scene.parameters import scene_of

SCENE = """\
include: part.yaml
cameras: {cam0: {position: [0, -2, 1], look_at: [0, 0, 0], fov: 60 deg}}
materials: {painted: {texture: {kind: image, file: picture.png}}}
world:
  - {name: ball, shape: sphere, radius: 0.4, position: [0, 0, 0.5], material: painted}
"""
PART = "world:\n  - {name: floor, shape: plane, size: [2, 2], material: painted}\n"
MODEL = """<mujoco><include file="part.xml"/></mujoco>"""
MODEL_PART = (
    """<mujoco><worldbody><body name="ball" pos="0 0 1"><freejoint/><geom size="0.1"/></body></worldbody></mujoco>"""
)


def written(folder: Path) -> dict[str, Path]:
    """A scene of three files, and a model of two."""
    files = {"scene": "scene.yaml", "part": "part.yaml", "picture": "picture.png", "model": "model.xml",
             "model part": "part.xml"}  # fmt: skip
    paths = {what: folder / name for what, name in files.items()}
    for what, text in (("scene", SCENE), ("part", PART), ("model", MODEL), ("model part", MODEL_PART)):
        paths[what].write_text(text)
    Image.fromarray(np.full((2, 2, 3), 128, np.uint8)).save(paths["picture"])
    return paths


def test_a_scene_is_loaded_once_and_nobody_can_write_to_it(tmp_path: Path) -> None:
    scene = str(written(tmp_path)["scene"])
    first = scene_of("renderer", {"scene": scene, "width": 32})
    assert scene_of("interpolator", {"scene": scene, "width": 32}) is first
    assert scene_of("interpolator", {"scene": scene, "width": 64}) is not first
    with pytest.raises(ValueError, match="read-only"):
        first.instances[0].mesh.vertices[0] = 0.0


def test_who_sees_nothing_has_the_world_that_is_there(tmp_path: Path) -> None:
    paths = written(tmp_path)
    scene = {"scene": str(paths["scene"])}
    alone = scene_of("physics", scene, visuals=False)
    assert not alone.instances
    seen = scene_of("renderer", scene)
    assert seen.instances
    assert scene_of("physics", scene, visuals=False) is seen
    # Of a model more is told to who sees it, and a world is drawn by its seed: these have their own.
    drawn = paths["scene"].with_name("drawn.yaml")
    drawn.write_text(SCENE.replace("radius: 0.4", "radius: {from: 0.1, to: 0.4}"))
    for other in ({"scene": str(paths["model"])}, {"scene": str(drawn)}):
        seen = scene_of("renderer", other)
        assert scene_of("physics", other, visuals=False) is not seen


@pytest.mark.parametrize(
    ("what", "changed"), [("scene", "scene"), ("scene", "part"), ("scene", "picture"), ("model", "model part")]
)
def test_a_file_that_changes_is_read_again(what: str, changed: str, tmp_path: Path) -> None:
    paths = written(tmp_path)
    params = {"scene": str(paths[what])}
    first = scene_of("renderer", params)
    status = paths[changed].stat()
    os.utime(paths[changed], ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    assert scene_of("renderer", params) is not first
