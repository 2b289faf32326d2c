"""Depth and motion against closed form, to 1e-3 px, float64 poses and ray intersections on the other side."""

import numpy as np
import pytest
from renderer_scenes import GEOMETRIC, at, camera, poses, quad, rays, scene, sphere

from evis.geometry import pinhole, se3
from nodes.renderer.renderer import BEHIND, Renderer

PIXEL = 1e-3


def plane_points(view, pose, camera_pose):
    """World points float64 [H, W, 3] where the rays meet the plane z = 0 of a pose, and their z-depth."""
    d = se3.rotate(camera_pose[3:], rays(view))
    normal = se3.rotate(pose[3:], np.array([0, 0, 1.0]))
    z = ((pose[:3] - camera_pose[:3]) @ normal) / (d @ normal)
    return camera_pose[:3] + z[..., None] * d, z


def check(renderer, now, before, extent=None):
    """The image of body 0, a plane, against closed form; extent: nearly all of the image must be it."""
    view = renderer.visibility.camera
    out = renderer.render(poses(*now), poses(*before), GEOMETRIC)
    seen = out["ids"][0] == 1
    assert seen.mean() > (extent or 0.2)
    points, z = plane_points(view, now[0], now[-1])
    np.testing.assert_allclose(out["depth"][0][seen], z[seen], rtol=2e-6)
    body = se3.transform(se3.inverse(now[0]), points)
    then = se3.transform(se3.inverse(before[-1]), se3.transform(before[0], body))
    y, x = np.indices(seen.shape)
    motion = pinhole.project(view.k, then) - np.stack([x, y], -1)
    assert np.abs(out["motion"][0][seen] - motion[seen]).max() < PIXEL
    return out


@pytest.fixture(scope="module")
def renderer():
    view = camera(160, 120, 150.0)
    return Renderer(world := scene([(quad(0.5, 0.5), 0, 0)], bodies=1, view=view, still_camera=False), world.cameras[0])


def test_spinning_tilted_plate(renderer):
    for angle in (0.01, 0.4, 1.6, 3.0):
        now = se3.compose(at(0.05, 0, 1.2, (0.6, 0, 0)), at(0, 0, 0, (0, 0, angle)))
        check(renderer, (now, at(0, 0, 0)), (at(0.05, 0, 1.2, (0.6, 0, 0)), at(0, 0, 0)))


def test_approaching_plate(renderer):
    for step in (0.001, 0.1, 2.0):
        check(renderer, (at(0, 0, 1.0, (0.2, 0.1, 0)), at(0, 0, 0)), (at(0, 0, 1.0 + step, (0.2, 0.1, 0)), at(0, 0, 0)))


def test_moving_camera_and_body(renderer):
    rng = np.random.default_rng(1)
    for _ in range(5):
        now, before = (
            (at(0, 0, 1.2, 0.3 * rng.standard_normal(3)), at(*(0.1 * rng.standard_normal(3)), 0.05 * rng.random(3)))
            for _ in range(2)
        )
        check(renderer, now, before)


def test_small_motion_is_as_exact_as_a_large_one(renderer):
    """1e-6 m at 1 m is 1.5e-4 px: two projections in float32 would lose it."""
    out = renderer.render(poses(at(1e-6, 0, 1.0), at(0, 0, 0)), poses(at(0, 0, 1.0), at(0, 0, 0)), GEOMETRIC)
    seen = out["ids"][0] == 1
    np.testing.assert_allclose(out["motion"][0][seen][:, 0], -150e-6, rtol=1e-4)
    assert np.abs(out["motion"][0][seen][:, 1]).max() < 1e-9


def test_far_from_the_origin(renderer):
    far = np.array([1e5, -3e5, 2e5, 0, 0, 0, 0])
    now, before = (at(0, 0, 1.0, (0.3, 0, 0.2)), at(0.02, 0, 0)), (at(0.1, 0, 1.0, (0.3, 0, 0)), at(0, 0, 0.01))
    check(renderer, [p + far for p in now], [p + far for p in before])


def test_sky_moves_with_the_cameras_rotation_only():
    view = camera()
    world = scene([], view=view, still_camera=False)
    now, before = at(5, 6, 7, (0.02, -0.03, 0.3)), at(-1, 0, 2, (0, 0.05, 0))
    out = Renderer(world, view).render(poses(now), poses(before), GEOMETRIC)
    direction = se3.rotate(se3.conjugate(before[3:]), se3.rotate(now[3:], rays(view)))
    y, x = np.indices(direction.shape[:2])
    motion = pinhole.project(view.k, direction) - np.stack([x, y], -1)
    assert np.abs(out["motion"][0] - motion).max() < PIXEL
    moved = Renderer(world, view).render(poses(at(1, 0, 0)), poses(at(0, 0, 0)), GEOMETRIC)
    assert not moved["motion"].any()


def test_no_motion_at_the_first_keyframe_and_where_nothing_moved(renderer):
    now = (at(0, 0, 1.0, (0.3, 0, 0.2)), at(0.1, 0.2, 0.3, (0.01, 0.02, 0.03)))
    for before in (None, poses(*now)):
        assert not renderer.render(poses(*now), before, GEOMETRIC)["motion"].any()
    # A still body in front of the same camera has none to the last bit, whatever else moves.
    two = scene([(quad(0.2, 0.2), 0, 0), (quad(3, 3), 1, 0)], bodies=2)
    still, eye = at(0, 0, 2, (0.1, 0.2, 0.3)), at(0.5, 0.3, 0.1, (0.1, 0, 0))
    out = Renderer(two, two.cameras[0]).render(
        poses(at(0.6, 0, 1.4), still, eye), poses(at(0.5, 0.1, 1.4), still, eye), GEOMETRIC
    )
    assert (out["ids"] == 2).any() and not out["motion"][out["ids"] == 2].any()
    assert out["motion"][out["ids"] == 1].any(-1).all()


def test_a_point_that_was_behind_the_camera_lies_outside_every_image(renderer):
    out = renderer.render(poses(at(0, 0, 1.0), at(0, 0, 0)), poses(at(0, 0, -1.0), at(0, 0, 0)), GEOMETRIC)
    assert (out["motion"][out["ids"] == 1] == BEHIND).all()


def test_sphere_depth_and_normals():
    """A fine tessellation lies between the sphere and the sagitta of its largest facet inside it."""
    radius, rings = 0.4, 150
    view = camera(120, 90, 150.0)
    world = scene([(sphere(radius, rings), 0, 0)], bodies=1, view=view)
    centre = np.array([0.05, -0.1, 1.5])
    out = Renderer(world, view).render(poses(at(*centre, (0.3, 0.2, 0.1)), at(0, 0, 0)), None, GEOMETRIC)
    d = rays(view)
    dd, dc = (d * d).sum(-1), d @ centre
    root = dc**2 - dd * (centre @ centre - radius**2)
    inside = root > 0.02
    assert inside.mean() > 0.2 and (out["ids"][0][inside] == 1).all()
    z = (dc - np.sqrt(np.where(inside, root, 1.0))) / dd
    normal = (z[..., None] * d - centre) / radius
    sagitta = radius * (np.pi / rings) ** 2
    excess = (out["depth"][0] - z) * np.abs((normal * d).sum(-1))
    assert excess[inside].min() > -1e-6 and excess[inside].max() < sagitta
    cosine = (out["normal"][0] * normal).sum(-1)[inside]
    assert cosine.min() > np.cos(1.5 * np.pi / rings)
