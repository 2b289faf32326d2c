"""Sizes, distances and meshes at the ends of what a scene may hold."""

import numpy as np
import pytest
from renderer_scenes import ALL, GEOMETRIC, at, camera, poses, quad, rays, scene, sphere

from evis.geometry import se3
from evis.scene.model import Camera, Light, Material, Mesh
from nodes.renderer.renderer import Renderer


def lit(world, *lights):
    world.lights = list(lights)
    return world


def test_a_whole_lit_scene_1e5_m_from_the_origin():
    """Shadows too: world, bodies, camera and lights shifted together look the same."""
    far = np.array([1e5, -1e5, 1e5])
    images = []
    for shift in (np.zeros(3), far):
        move = np.concatenate([shift, np.zeros(4)])
        world = scene([(sphere(0.3, 10), 0, 0), (quad(3, 3), -1, 0)], bodies=1, environment=(0.1, 0.1, 0.1))
        world.instances[1].pose = at(0, 0, 2.5) + move
        lit(world, Light("lamp", "point", np.full(3, 9.0), np.array([1.0, -1.0, 0.5]) + shift))
        instant = poses(at(0.1, 0, 1.5) + move, at(0, 0, 0) + move)
        out = Renderer(world, world.cameras[0]).render(instant, None, ("radiance", "ids", "depth"))
        images.append({name: image[0].copy() for name, image in out.items()})
    same = images[0]["ids"] == images[1]["ids"]
    assert same.mean() > 0.999
    np.testing.assert_allclose(images[0]["depth"][same], images[1]["depth"][same], rtol=1e-5)
    close = np.isclose(images[0]["radiance"], images[1]["radiance"], rtol=1e-3).all(-1)
    # The shadow's edge may fall on the other side of a pixel's centre.
    assert close.mean() > 0.998
    assert len(np.unique(images[0]["radiance"][..., 0].round(3))) > 50


def test_a_tenth_of_a_millimetre_before_a_kilometre():
    """A ball of 0.1 mm, 5 mm away, lit, with its own shading, before a plane of 1 km that it hides where it must."""
    view = camera(64, 48, 600.0, near=1e-4)
    world = scene([(sphere(5e-5, 40), 0, 0), (quad(1000, 1000), -1, 0)], bodies=1, view=view)
    world.instances[1].pose = at(0, 0, 800.0)
    world.materials = [Material("m", np.full(3, 0.5), two_sided=True)]
    lit(world, Light("sun", "directional", np.full(3, np.pi), np.array([0, 0, 1.0])))
    out = Renderer(world, view).render(poses(at(0, 0, 5e-3), at(0, 0, 0)), None, ALL)
    d = rays(view)
    unit = d / np.linalg.norm(d, axis=-1, keepdims=True)
    miss = np.linalg.norm(np.cross(unit, np.array([0, 0, 5e-3])), axis=-1)
    ball = out["ids"][0] == 1
    # Facets of 2.25 degrees lie within 0.2 % of the sphere.
    assert ball[miss < 5e-5 * 0.996].all() and not ball[miss > 5e-5].any() and ball.sum() > 50
    along = unit @ np.array([0, 0, 5e-3])
    depth = (along - np.sqrt(np.maximum(5e-5**2 - miss**2, 0))) * unit[..., 2]
    inner = miss < 4e-5
    np.testing.assert_allclose(out["depth"][0][inner], depth[inner], atol=2e-7)
    np.testing.assert_allclose(out["depth"][0][~ball], 800.0, rtol=1e-6)
    normal = (depth[..., None] * d - np.array([0, 0, 5e-3])) / 5e-5
    np.testing.assert_allclose(out["radiance"][0][inner][:, 0], -0.5 * normal[inner][:, 2], rtol=2e-2)


def test_degenerate_and_duplicate_triangles_in_every_image():
    """A plane twice, with needles, points and a NaN-free line in it: each image is that of the plane alone."""
    plain = quad(1.0, 1.0)
    extra = np.array([(0, 0, 0), (1, 1, 1), (0, 1, 0), (0, 2, 1)], np.int32)
    dirty = Mesh(plain.vertices, np.concatenate([plain.faces, plain.faces, extra]))
    images = []
    for mesh in (Mesh(plain.vertices, plain.faces), dirty):
        world = scene([(mesh, 0, 0)], bodies=1, lights=[Light("sun", "directional", np.ones(3), np.array([0, 0.2, 1]))])
        out = Renderer(world, world.cameras[0]).render(
            poses(at(0, 0, 1.2, (0.2, 0.1, 0)), at(0, 0, 0)), poses(at(0, 0.1, 1.2), at(0, 0, 0)), ALL
        )
        images.append({name: image.copy() for name, image in out.items()})
    assert images[0]["radiance"].any()
    for name in ALL:
        np.testing.assert_array_equal(images[0][name], images[1][name])


def test_the_camera_inside_a_mesh():
    """Of a one-sided ball nothing, of a two-sided one its inner side everywhere, lit by the lamp within."""
    lamp = Light("lamp", "point", np.full(3, np.pi), np.zeros(3))
    for two_sided in (False, True):
        material = Material("m", np.full(3, 0.5), two_sided=two_sided)
        world = scene([(sphere(2.0, 60), 0, 0)], bodies=1, materials=[material], lights=[lamp])
        out = Renderer(world, world.cameras[0]).render(poses(at(0, 0, 0), at(0, 0, 0)), None, ALL)
        assert (out["ids"] == int(two_sided)).all()
        if two_sided:
            # At 2 m, facing the lamp: pi / 4 W/m^2 times 0.5 / pi.
            np.testing.assert_allclose(out["radiance"], 0.125, rtol=5e-3)
            towards = -rays(world.cameras[0]) / np.linalg.norm(rays(world.cameras[0]), axis=-1, keepdims=True)
            assert (np.sum(out["normal"][0] * towards, -1) > 0.99).all()
        else:
            assert np.isinf(out["depth"]).all()


def test_a_body_that_crosses_the_near_plane():
    """A ball that flies through the camera: everything stays finite, and its front is cut where the plane is."""
    view = camera(near=0.2)
    world = scene([(sphere(0.5, 24), 0, 0)], bodies=1, view=view)
    world.materials = [Material("m", np.ones(3), two_sided=False)]
    renderer = Renderer(world, view)
    seen = []
    before = None
    for z in np.linspace(1.5, -1.0, 26):
        instant = poses(at(0.1, 0, z), at(0, 0, 0))
        out = renderer.render(instant, before, ALL)
        before = instant
        hit = out["ids"][0] == 1
        seen.append(hit.sum())
        assert np.isfinite(out["motion"]).all() and np.isfinite(out["radiance"]).all()
        assert (out["depth"][0][hit] >= 0.2).all() and np.isinf(out["depth"][0][~hit]).all()
    # In front of the plane wholly, then cut, then only back faces or nothing are left.
    assert seen[0] > 100 and seen[-1] == 0
    unit = rays(view)
    z = 0.68
    a, b, c = (unit**2).sum(-1), unit @ np.array([0.1, 0, z]), 0.1**2 + z**2 - 0.25
    with np.errstate(invalid="ignore"):
        front = (b - np.sqrt(b * b - a * c)) / a
    out = renderer.render(poses(at(0.1, 0, z), at(0, 0, 0)), None, ALL)
    # The facets are up to 0.3 % of the radius inside the sphere.
    sure = np.abs(front - 0.2) > 5e-3
    assert (front < 0.19).any() and (front > 0.21).any()
    np.testing.assert_array_equal((out["ids"][0] == 1)[sure & (b * b > a * c * 1.05)],
                                  (front > 0.2)[sure & (b * b > a * c * 1.05)])  # fmt: skip


@pytest.mark.parametrize("width,height", [(1, 1), (1, 64), (8192, 2), (2, 8192)])
def test_images_from_one_to_8192_pixels_wide(width, height):
    """Every pixel against the plane's closed form, motion included."""
    focal = 0.8 * max(width, height)
    k = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    view = Camera("cam0", width, height, k)
    world = scene([(quad(50, 50), 0, 0)], bodies=1, view=view)
    step = at(0.01, -0.02, 2.0, (0.2, 0.1, 0))
    out = Renderer(world, view).render(poses(step, at(0, 0, 0)), poses(at(0, 0, 2.0, (0.2, 0.1, 0)), at(0, 0, 0)), ALL)
    assert (out["ids"] == 1).all()
    d = rays(view)
    normal = se3.rotate(step[3:], np.array([0, 0, 1.0]))
    z = (step[:3] @ normal) / (d @ normal)
    np.testing.assert_allclose(out["depth"][0], z, rtol=2e-6)
    before = d * z[..., None] - [0.01, -0.02, 0]
    motion = before[..., :2] / before[..., 2:] * focal - d[..., :2] * focal
    assert np.abs(out["motion"][0] - motion).max() < 1e-3


def test_an_empty_scene_with_lights():
    world = lit(scene([], environment=(0.1, 0.2, 0.3)), Light("sun", "directional", np.ones(3), np.array([0, 0, 1.0])))
    out = Renderer(world, world.cameras[0], envs=2).render(np.tile(poses(at(1, 2, 3)), (2, 1, 1)), None, ALL)
    np.testing.assert_allclose(out["radiance"], np.broadcast_to([0.1, 0.2, 0.3], out["radiance"].shape), rtol=1e-6)
    assert not out["ids"].any() and np.isinf(out["depth"]).all()


def test_a_kilometre_of_floor_under_the_camera():
    """Two triangles from behind the camera to the horizon, z exact to float32 over five decades."""
    view = camera(64, 480, 300.0)
    world = scene([(quad(1000, 1000), -1, 0)], view=view)
    world.instances[0].pose = at(0, 1.0, 0, (np.pi / 2, 0, 0))
    out = Renderer(world, view).render(poses(at(0, 0, 0)), None, GEOMETRIC)
    d = rays(view)
    z = 1.0 / d[..., 1]
    sure = (d[..., 1] > 0) & (z < 990)
    np.testing.assert_allclose(out["depth"][0][sure], z[sure], rtol=1e-5)
    assert not out["ids"][0][d[..., 1] <= 0].any() and sure.sum() > 10_000


def test_what_is_not_finite_is_named():
    world = scene([(quad(1, 1), 0, 0)], bodies=1)
    renderer = Renderer(world, world.cameras[0])
    bad = poses(at(0, 0, 1), at(0, 0, 0))
    bad[0, 1, 4] = np.inf
    with pytest.raises(ValueError, match=r"pose of body 'cam0' is not finite \(environment 0\)"):
        renderer.render(bad)
    world.instances[0].pose = np.array([0, np.nan, 0, 0, 0, 0, 1.0])
    with pytest.raises(ValueError, match="instance 'thing0' has a vertex or pose that is not finite"):
        Renderer(world, world.cameras[0])
    plane = quad(1, 1)
    plane.uv = plane.uv.copy()
    plane.uv[1, 2, 0] = np.nan
    # Behind a textured instance too.
    painted = Material("paint", np.ones(3), np.ones((2, 2, 3), np.float32))
    with pytest.raises(ValueError, match="instance 'thing1' has uv that are not finite"):
        Renderer(scene([(quad(1, 1), -1, 0), (plane, -1, 0)], materials=[painted]), camera())
