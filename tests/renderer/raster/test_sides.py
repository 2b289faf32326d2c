"""Which side of a triangle a pixel sees stands in the z-buffer."""

import numpy as np
import pytest

from bench.interpolation.cases import plain, scene_of, square
from evis.geometry import se3
from evis.scene.motion import Prescribed
from nodes.renderer.raster.depth_kernels import BACK
from nodes.renderer.raster.entries import triangles_of
from nodes.renderer.raster.visibility import Visibility


@pytest.mark.parametrize("tiled", [False, pytest.param(True, marks=pytest.mark.gpu)])
@pytest.mark.parametrize(("angle", "back"), [(0.3, False), (np.pi - 0.3, True)])
def test_a_plate_shows_its_back_when_it_has_turned(angle, back, tiled):
    """The front of `square` is the one that its normal (0, 0, 1) points from, away from the camera at angle 0."""
    pose = se3.make_pose(np.array([0.0, 0.0, 2.0]), se3.exp(np.array([0.0, np.pi + angle, 0.0])))
    scene = scene_of([(square(0.5), plain(0.5), Prescribed(pose))])
    visibility = Visibility(scene, scene.cameras[0], 1, **({"device": "cuda"} if tiled else {}))
    still = np.stack([body.trajectory.pose(np.zeros(1, np.int64))[0] for body in scene.bodies])
    visibility.update(still[None])
    packed = visibility.packed.numpy()[0]
    triangles = triangles_of(packed)
    assert set(np.unique(triangles)) == {-1, 0, 1}
    seen = (packed & np.uint64(int(BACK))) != 0
    assert (seen[triangles >= 0] == back).all() and (triangles >= 0).sum() > 500
    assert (packed[triangles < 0] == np.iinfo(np.uint64).max).all()
