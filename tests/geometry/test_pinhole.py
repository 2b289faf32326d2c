"""The camera model and image motion against hand values and difference quotients."""

import numpy as np

from evis.geometry import pinhole, se3


def test_the_middle_of_the_image_is_half_way_between_its_edges():
    """Pixel (0, 0) is a centre: a 4 x 2 image runs from -0.5 to 3.5 and from -0.5 to 1.5."""
    k = pinhole.intrinsics(4, 2, pinhole.focal_from_fov(2, np.radians(90)))
    assert np.allclose(pinhole.project(k, np.array([0.0, 0.0, 2.0])), [1.5, 0.5])
    assert np.allclose(pinhole.project(k, np.array([0.0, 3.0, 3.0])), [1.5, 1.5])  # 45 deg down: the lower edge


def test_unproject_undoes_project():
    """Also with skew, at depths from millimetres to kilometres."""
    k = np.array([[300.0, 1.5, 170.0], [0.0, 310.0, 120.0], [0.0, 0.0, 1.0]])
    random = np.random.default_rng(0)
    pixels, depth = random.uniform(0, 300, (50, 2)), 10 ** random.uniform(-3, 3, 50)
    points = pinhole.unproject(k, pixels, depth)
    assert np.array_equal(points[:, 2], depth)
    assert np.abs(pinhole.project(k, points) - pixels).max() < 1e-12


def test_backward_motion_of_a_sideways_step():
    """A body 2 m away that moved 0.1 m to the right was f * 0.1 / 2 px to the left."""
    k = pinhole.intrinsics(100, 100, 400.0)
    body, before = se3.IDENTITY.copy(), se3.IDENTITY.copy()
    before[0] = -0.1
    pixel = np.array([[20.0, 70.0]])
    motion = pinhole.backward_motion(k, pixel, np.array([2.0]), se3.IDENTITY, body, se3.IDENTITY, before)
    assert np.allclose(motion, [[-20.0, 0.0]])
