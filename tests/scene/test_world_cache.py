"""Worlds that a seed draws are shared and kept for a while, and what was made for those before is given back."""

import gc
import weakref

import numpy as np

from evis.scene import worlds

SCENE = """
cameras: {cam0: {position: [0, -1, 0], look_at: [0, 0, 0], fov: 40 deg}}
materials:
  drawn: {texture: {kind: noise, size: 64, feature: 0.1, seed: {from: 0, to: 1000000000}}}
  common: {texture: {kind: noise, size: 32, feature: 0.1, seed: 1}}
world:
  - {name: near, shape: plane, size: [1, 1], position: [0, 0.5, 0], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: drawn}
  - {name: far, shape: plane, size: [1, 1], position: [0, 1, 0], rotation: {axis: [1, 0, 0], angle: 90 deg}, material: common}
environment: 1
"""  # noqa: E501
ONE = (64**2 + 32**2) * 3 * 4
"""Bytes of the pictures of a world."""


def textures(scene):
    return [material.texture for material in scene.materials]


def test_drawn_pictures_do_not_pile_up(tmp_path, monkeypatch):
    """Of 256 worlds one after the other all pictures were kept, 786 kB each with 256 texels: a training with `vary:=1`
    grew by 5 MB a reset, to more than a gigabyte. Here the last 4 worlds are, and 5 worlds' bytes beside."""
    monkeypatch.setattr(worlds, "WORLDS", 4)
    monkeypatch.setattr(worlds, "MUCH", 5 * ONE)
    (tmp_path / "s.yaml").write_text(SCENE)
    family = worlds.family(str(tmp_path / "s.yaml"), {})
    alive, common = [], []
    for seed in range(44):
        scene = family.world(seed)
        drawn, same = sorted(textures(scene), key=lambda texture: -texture.size)
        alive.append(weakref.ref(drawn))
        common.append(id(same))
        assert not same.flags.writeable and same.shape == (32, 32, 3)
        del scene, drawn, same
    gc.collect()
    # Those of 5 + 2 worlds are seen at the 8th, and 4 worlds and 16 small pictures are kept for themselves.
    assert sum(reference() is not None for reference in alive) <= 8 + 4 + 16
    assert len(set(common)) <= 6  # and neighbours share what they have in common


def test_bytes_are_counted_once():
    array = np.zeros((10, 3), np.float32)
    assert worlds.size_of({"a": [array, (array,)], "b": {"c": np.zeros(5)}, "d": "text"}) == 120 + 40
