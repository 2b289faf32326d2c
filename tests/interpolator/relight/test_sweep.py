"""The boxes of what moves, against the corners of every thing at every instant."""

import itertools

import numpy as np

from evis.geometry import se3
from evis.scene.load import load_scene
from evis.scene.model import Camera
from nodes.interpolator.relight.sweep import Sweep
from nodes.interpolator.rigid.placement import Placement
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents

CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))


def test_boxes_hold_all_corners_and_touch_them():
    """Of the warehouse's forklift, wheels, barrel and parcels, in two environments of which one stands at the start."""
    scene = load_scene("warehouse", textures=False)
    camera: Camera = scene.cameras[0]
    v = Visibility(scene, camera, 2, drawn=False)
    movers = Placement(scene).movers
    sweep = Sweep(v, 2, movers, half_extents(v))
    t = np.arange(5) * 400_000_000
    poses = np.stack([scene.bodies[n].trajectory.pose(t) for n in movers], 1)
    moved = np.stack([poses[1:], np.tile(poses[:1], (4, 1, 1))], 1)
    origin = np.array([0.5, -3.0, 100.0])
    for k in (2, 4):  # gaps of any number of frames
        sweep.send(moved[:k], np.stack([poses[0], poses[0]]), origin)
        lower, upper = sweep.lower.numpy(), sweep.upper.numpy()
        found = []
        half = half_extents(v)
        for place, m in enumerate(sweep.casters):
            points = []
            for i in np.flatnonzero(v.geometry.body == movers[m]):
                corners = half[i] * CORNERS @ v.geometry.rotation[i].T + v.geometry.translation[i]
                points.append([se3.transform(pose, corners) for pose in poses[: k + 1, m]])
            corners = np.concatenate(points, 1) - origin
            for env, part in enumerate((corners, corners[:1])):
                low, high = part.min((0, 1)), part.max((0, 1))
                found.append((env, low, high))
                np.testing.assert_allclose(lower[env, place + 1], low, rtol=1e-6)
                np.testing.assert_allclose(upper[env, place + 1], high, rtol=1e-6)
        for env in (0, 1):
            np.testing.assert_allclose(lower[env, 0], np.min([low for e, low, _ in found if e == env], 0), rtol=1e-6)
            np.testing.assert_allclose(upper[env, 0], np.max([high for e, _, high in found if e == env], 0), rtol=1e-6)
    assert len(sweep.casters) == 21 and np.all(sweep.size > 0)
