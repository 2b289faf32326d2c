"""What the nodes of a process make of a scene that they share: once, and no longer than somebody has the scene."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from evis.scene.load import load_scene
from evis.scene.worlds import Family
from nodes.renderer.geometry.triangles import Geometry, flatten, geometry_of
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents


def test_renderer_and_interpolator_have_the_same_arrays() -> None:
    scene = Family("spinning_disk", {"width": 20, "height": 16}, True, True).world(0)
    first, second = (Visibility(scene, scene.cameras[0], envs) for envs in (1, 3))
    assert first.geometry is second.geometry
    fresh = flatten(scene)
    for name in ("vertices", "triangles", "normals", "first", "translation", "radius"):
        assert np.array_equal(getattr(first.geometry, name), getattr(fresh, name))
    assert half_extents(first) is half_extents(second)
    box = [np.abs(fresh.vertices[fresh.vertex_instance == k]).max(0) for k in range(len(fresh.body))]
    np.testing.assert_allclose(half_extents(first), box, rtol=2e-6)
    with pytest.raises(ValueError, match="read-only"):
        first.geometry.vertices[0] = 1.0


def test_a_scene_of_ones_own_may_be_changed() -> None:
    scene = load_scene("spinning_disk")
    before = geometry_of(scene)
    del scene.instances[1:]
    assert len(geometry_of(scene).body) == 1 < len(before.body)


def test_what_was_made_goes_with_the_scene() -> None:
    family = Family("spinning_disk", {}, True, True)
    made: weakref.ref[Geometry] = weakref.ref(geometry_of(family.world(0)))
    assert made() is geometry_of(family.world(0))
    del family
    gc.collect()
    assert made() is None
