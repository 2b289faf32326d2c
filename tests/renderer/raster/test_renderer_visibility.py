"""Who is seen, against every ray cast at every triangle in float64."""

import numpy as np
import pytest
from renderer_scenes import GEOMETRIC, at, camera, cast, poses, quad, rays, scene, sphere

from evis.scene.model import Material, Mesh
from nodes.renderer.raster import raster
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import Renderer

# A pixel centre this near to an edge (in barycentric coordinates) may fall to either side: float32 rounds a vertex that
# crosses the near plane far outside the image by up to 1e-4 of the triangle.
EDGE = 1e-3


def soup(seed, count=200, spread=2.0, depth=(-1.0, 3.0), size=0.8):
    rng = np.random.default_rng(seed)
    centre = np.stack([*rng.uniform(-spread, spread, (2, count)), rng.uniform(*depth, count)], -1)
    triangles = (centre[:, None] + size * rng.standard_normal((count, 3, 3))).astype(np.float32)
    return Mesh(triangles.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)), triangles.astype(float)


def check_against_rays(view, triangles, two_sided, hits, depth):
    z, least = cast(view, triangles, two_sided)
    got = hits["triangle"][0]
    rows, columns = np.indices(got.shape)
    surely = np.where(least > EDGE, z, np.inf)
    nearest = surely.min(0)
    seen = got >= 0
    assert (seen | ~np.isfinite(nearest)).all(), "a pixel inside a triangle saw nothing"
    z_got, least_got = z[got[seen], rows[seen], columns[seen]], least[got[seen], rows[seen], columns[seen]]
    assert (least_got > -EDGE).all(), "a pixel outside a triangle was filled"
    np.testing.assert_allclose(depth[0][seen], z_got, rtol=2e-4)
    assert (depth[0][seen] <= nearest[seen] * (1 + 2e-4)).all(), "a farther triangle won"
    assert np.isinf(depth[0][~seen]).all()
    possible = np.where(least > -EDGE, z, np.inf).min(0)
    clear = np.isclose(possible, nearest, rtol=1e-6) & np.isfinite(nearest)
    first, second = np.sort(surely, 0)[:2]
    clear &= second > first * (1 + 1e-3)
    assert clear.mean() > 0.4
    np.testing.assert_array_equal(got[clear], surely.argmin(0)[clear])


@pytest.mark.parametrize("two_sided", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("tiled,few", [(False, 0), (True, raster.FEW), (True, 0)])
def test_soup_around_the_camera(seed, two_sided, tiled, few, monkeypatch):
    """Also as a GPU draws it: all blocks at once, and with their triangles listed first."""
    monkeypatch.setattr(raster, "FEW", few)
    mesh, triangles = soup(seed)
    view = camera(near=0.05)
    world = scene([(mesh, -1, 0)], materials=[Material("m", np.ones(3), two_sided=two_sided)], view=view)
    visibility = Visibility(world, view, tiled=tiled)
    visibility.update(poses(at(0, 0, 0)))
    depth = Renderer(world, view).render(poses(at(0, 0, 0)), None, GEOMETRIC)["depth"]
    crossing = (triangles[..., 2].min(1) < view.near) & (triangles[..., 2].max(1) > view.near)
    assert crossing.sum() > 20
    check_against_rays(view, triangles, two_sided, visibility.hits(), depth)


def test_pools_and_threads_change_no_bit(monkeypatch):
    mesh, _ = soup(3, count=400)
    view = camera(160, 120, 90.0)
    world = scene([(mesh, -1, 0)], view=view)
    images = []
    for arguments in ({}, {"tiled": True}, {"threads": 3}):
        visibility = Visibility(world, view, **arguments)
        visibility.update(poses(at(0, 0, 0)))
        images.append(visibility.packed.numpy())
    monkeypatch.setattr(raster, "FEW", 0)
    listed = Visibility(world, view, tiled=True)
    listed.update(poses(at(0, 0, 0)))
    for image in (*images[1:], listed.packed.numpy()):
        np.testing.assert_array_equal(images[0], image)


def drawn(mesh, width, height, two_sided, **arguments):
    view = camera(width, height, 0.8 * max(width, height), near=0.05)
    world = scene([(mesh, -1, 0)], materials=[Material("m", np.ones(3), two_sided=two_sided)], view=view)
    visibility = Visibility(world, view, **arguments)
    visibility.update(poses(at(0, 0, 0)))
    m = visibility.margin
    return visibility.packed.numpy()[:, m : m + height, m : m + width]


@pytest.mark.parametrize("width,height", [(1, 40), (5, 9), (8, 1), (9, 8), (31, 7), (70, 20)])
@pytest.mark.parametrize("size,count", [(0.1, 6000), (0.6, 300)])
@pytest.mark.parametrize("two_sided", [True, False])
def test_pixels_done_together_are_those_done_one_by_one(width, height, size, count, two_sided):
    """Triangles smaller than a pixel and as wide as the image, in images narrower than a run of pixels and wider."""
    mesh, _ = soup(5, count=count, size=size)
    one_by_one = drawn(mesh, width, height, two_sided, tiled=True)
    assert (one_by_one != np.iinfo(np.uint64).max).any()
    for arguments in ({}, {"margin": 2}, {"threads": 3}):
        np.testing.assert_array_equal(one_by_one, drawn(mesh, width, height, two_sided, **arguments))


def test_needles_done_together_are_those_done_one_by_one():
    """The edges of a triangle with a sharp point leave pixels beyond it, which its bounds do not hold."""
    mesh, triangles = soup(6, count=40000)
    rng = np.random.default_rng(6)
    along = rng.random((len(triangles), 1))
    points = triangles[:, 0] * along + triangles[:, 1] * (1 - along)
    mesh.vertices.reshape(-1, 3, 3)[:, 2] = points + 3e-4 * rng.standard_normal(points.shape)
    one_by_one = drawn(mesh, 320, 240, True, tiled=True)
    assert (one_by_one != np.iinfo(np.uint64).max).mean() > 0.2
    np.testing.assert_array_equal(one_by_one, drawn(mesh, 320, 240, True))


@pytest.mark.parametrize("width,height", [(3, 60000), (60000, 3)])
def test_tiles_of_an_image_as_long_as_an_image_may_be(width, height):
    mesh, _ = soup(7, count=40)
    one_by_one = drawn(mesh, width, height, True, tiled=True)
    assert (one_by_one != np.iinfo(np.uint64).max).any()
    np.testing.assert_array_equal(one_by_one, drawn(mesh, width, height, True))


def test_hit_point_lies_on_its_triangle_in_the_body_frame():
    mesh, triangles = soup(4, depth=(1.5, 3.0), size=0.4)
    world = scene([(mesh, 0, 0)], bodies=1)
    visibility = Visibility(world, world.cameras[0])
    pose = at(0.1, -0.2, 0.3, (0.1, 0.2, -0.1))
    visibility.update(poses(pose, at(0, 0, 0)))
    hits = visibility.hits()
    seen = hits["triangle"] >= 0
    assert seen.mean() > 0.5
    a, b, c = np.moveaxis(triangles[hits["triangle"][seen]], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Grazing triangles turn the rounding of the depth (4 m x 1e-7) into more along the normal's plane, never off it.
    assert np.abs(((hits["point"][seen] - a) * normal).sum(1)).max() < 5e-6


@pytest.mark.parametrize("rings", [5, 60])
def test_a_closed_surface_has_no_cracks(rings):
    """From inside a sphere of up to 14,000 triangles, every pixel of many views hits."""
    view = camera(120, 90, 40.0)
    world = scene([(sphere(1.0, rings), 0, 0)], bodies=1, view=view)
    visibility = Visibility(world, view)
    rng = np.random.default_rng(5)
    for _ in range(20):
        pose = at(*rng.uniform(-0.5, 0.5, 3), rng.standard_normal(3))
        visibility.update(poses(pose, at(0, 0, 0)))
        assert (visibility.packed.numpy() != np.iinfo(np.uint64).max).all()


def test_vertices_and_edges_on_pixel_centres_are_hit():
    """A grid whose vertices project on pixel centres to the last bit."""
    view = camera(33, 33, 16.0)
    view.k = np.array([[16.0, 0, 16], [0, 16.0, 16], [0, 0, 1]])
    x, y = np.meshgrid(np.arange(-16, 17), np.arange(-16, 17))
    vertices = np.stack([x / 16.0, y / 16.0, np.ones(x.shape)], -1).reshape(-1, 3).astype(np.float32)
    i, j = np.meshgrid(np.arange(32), np.arange(32))
    a = (i * 33 + j).reshape(-1)
    faces = np.concatenate([np.stack([a, a + 33, a + 1], -1), np.stack([a + 1, a + 33, a + 34], -1)])
    world = scene([(Mesh(vertices, faces.astype(np.int32)), -1, 0)], view=view)
    out = Renderer(world, view).render(poses(at(0, 0, 0)), None, GEOMETRIC)
    assert (out["ids"] == 1).all()
    np.testing.assert_array_equal(out["depth"], np.ones((1, 33, 33), np.float32))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_vertices_and_edges_within_rounding_of_pixel_centres_are_hit(seed):
    """A curved sheet whose vertices are every other pixel's ray, rounded; its edges pass through the pixels between."""
    view = camera(81, 61, 77.7)
    rng = np.random.default_rng(seed)
    d = rays(view)[::2, ::2]
    rows, columns = d.shape[:2]
    vertices = (d * rng.uniform(0.5, 3.0, (rows, columns, 1))).reshape(-1, 3).astype(np.float32)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a = (i * columns + j).reshape(-1)
    faces = np.concatenate([np.stack([a, a + columns, a + 1], -1), np.stack([a + 1, a + columns, a + columns + 1], -1)])
    world = scene([(Mesh(vertices, faces.astype(np.int32)), 0, 0)], bodies=1, view=view)
    # Turned by nothing that float64 would see, but the vertices are rounded anew.
    eye = at(0.3, -0.2, 0.1, (0.5, 0.4, 0.3))
    visibility = Visibility(world, view)
    visibility.update(poses(eye, eye))
    missed = visibility.packed.numpy()[0] == np.iinfo(np.uint64).max
    assert not missed[1:-1, 1:-1].any()


def test_nothing_is_seen_before_the_near_plane():
    view = camera(near=0.5)
    world = scene([(quad(3.0, 3.0), 0, 0)], bodies=1, view=view)
    renderer = Renderer(world, view)
    assert not renderer.render(poses(at(0, 0, 0.4), at(0, 0, 0)), None, GEOMETRIC)["ids"].any()
    slanted = renderer.render(poses(at(0, 0, 0.6, (0, 1.2, 0)), at(0, 0, 0)), None, GEOMETRIC)
    # The plane through (0, 0, 0.6), turned by 1.2 rad about y; its edges lie 3 sin 1.2 nearer and farther.
    d = rays(view)
    normal = np.array([np.sin(1.2), 0, np.cos(1.2)])
    z = 0.6 * normal[2] / (d @ normal)
    sure = np.abs(z - 0.5) > 1e-4
    expected = (z >= 0.5) & (np.abs(z * d[..., 1]) < 3) & (np.abs(z - 0.6) < 3 * np.sin(1.2))
    assert expected.mean() > 0.2 and (~expected & (z > 0)).mean() > 0.2
    np.testing.assert_array_equal(slanted["ids"][0][sure], expected[sure].astype(int))


def test_degenerate_triangles_are_never_seen_and_duplicates_go_to_the_first():
    plane = quad(1.0, 1.0)
    line = Mesh(np.array([(0, 0, -0.1), (0.1, 0, -0.1), (0.2, 0, -0.1), (0, 0, -0.1)], np.float32),
                np.array([(0, 1, 2), (0, 0, 1), (0, 3, 0)], np.int32))  # fmt: skip
    world = scene([(line, 0, 0), (plane, 0, 0), (plane, 0, 0)], bodies=1)
    out = Renderer(world, world.cameras[0]).render(poses(at(0, 0, 1.2), at(0, 0, 0)), None, GEOMETRIC)
    assert set(np.unique(out["ids"])) == {2}


def test_back_faces_are_seen_only_of_two_sided_materials():
    plane = quad(5.0, 5.0)
    for two_sided in (False, True):
        material = Material("m", np.ones(3), two_sided=two_sided)
        world = scene([(plane, 0, 0)], bodies=1, materials=[material])
        renderer = Renderer(world, world.cameras[0])
        # +z away from the camera: its back; turned about x by pi: its front.
        back = renderer.render(poses(at(0, 0, 2), at(0, 0, 0)), None, GEOMETRIC)
        assert (back["ids"] == int(two_sided)).all()
        front = renderer.render(poses(at(0, 0, 2, (np.pi, 0, 0)), at(0, 0, 0)), None, GEOMETRIC)
        assert (front["ids"] == 1).all()
        np.testing.assert_allclose(front["normal"], np.broadcast_to([0, 0, -1.0], front["normal"].shape), atol=1e-6)


def test_a_world_far_from_the_origin_looks_the_same():
    mesh, _ = soup(6, depth=(1.0, 3.0), size=0.3)
    world = scene([(mesh, 0, 0), (sphere(0.3, 12), 1, 0)], bodies=2)
    renderer = Renderer(world, world.cameras[0])
    moves = [at(0, 0, 0.2, (0.1, 0, 0.3)), at(0.2, 0.1, 1.0), at(0, 0, 0)]
    far = np.array([1e5, -2e5, 3e5, 0, 0, 0, 0])
    near = {k: v.copy() for k, v in renderer.render(poses(*moves), None, GEOMETRIC).items()}
    away = renderer.render(poses(*(m + far for m in moves)), None, GEOMETRIC)
    # Positions of 3e5 m are float64 multiples of 6e-11 m.
    same = near["ids"] == away["ids"]
    assert same.mean() > 0.999
    np.testing.assert_allclose(near["depth"][same], away["depth"][same], rtol=1e-5)


def test_margin_adds_around_the_same_image():
    mesh, _ = soup(7)
    view = camera()
    world = scene([(mesh, -1, 0)], view=view)
    inner = Renderer(world, view).render(poses(at(0, 0, 0)), None, GEOMETRIC)
    outer = Renderer(world, view, margin=9).render(poses(at(0, 0, 0)), None, GEOMETRIC)
    for name in GEOMETRIC:
        assert outer[name].shape[1:3] == (view.height + 18, view.width + 18)
        np.testing.assert_array_equal(outer[name][:, 9:-9, 9:-9], inner[name])


def test_environments_equal_single_renders():
    mesh, _ = soup(8, count=60, depth=(1.0, 3.0))
    world = scene([(mesh, 0, 0), (sphere(0.3, 12), 1, 0)], bodies=2)
    moves = [poses(at(0, 0, 0.1 * e, (0, 0, e)), at(0.3 * e, 0, 1), at(0, 0, -0.1 * e)) for e in range(3)]
    together = Renderer(world, world.cameras[0], envs=3).render(np.concatenate(moves), None, GEOMETRIC)
    for e, move in enumerate(moves):
        alone = Renderer(world, world.cameras[0]).render(move, None, GEOMETRIC)
        for name in GEOMETRIC:
            np.testing.assert_array_equal(together[name][e], alone[name][0])


def test_smallest_images_and_empty_scenes():
    world = scene([], view=camera(1, 1, 1.0), environment=(0.1, 0.2, 0.3))
    out = Renderer(world, world.cameras[0]).render(poses(at(0, 0, 0)), None, ("radiance", *GEOMETRIC))
    np.testing.assert_array_equal(out["radiance"], np.array([[[[0.1, 0.2, 0.3]]]], np.float32))
    assert np.isinf(out["depth"]).all() and not out["ids"].any() and not out["normal"].any()
    empty = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    world = scene([(empty, -1, 0), (quad(1, 1), 0, 0)], bodies=1, view=camera(1, 1, 1.0))
    out = Renderer(world, world.cameras[0]).render(poses(at(0, 0, 1), at(0, 0, 0)), None, GEOMETRIC)
    assert out["ids"].item() == 2


def test_bad_poses_name_the_body():
    world = scene([(quad(1, 1), 0, 0)], bodies=1)
    renderer = Renderer(world, world.cameras[0])
    bad = poses(at(0, 0, 1), at(0, 0, 0))
    bad[0, 0, 1] = np.nan
    with pytest.raises(ValueError, match=r"body 'body0' is not finite \(environment 0\)"):
        renderer.render(bad)
    bad[0, 0] = 0.0
    with pytest.raises(ValueError, match="body 'body0' has a quaternion of length 0"):
        renderer.render(bad)
    with pytest.raises(ValueError, match="need \\(1, 2, 7\\)"):
        renderer.render(np.zeros((1, 3, 7)))


def test_unusable_scenes_are_refused():
    mesh = quad(1, 1)
    with pytest.raises(ValueError, match="'thing0' has material 3; the scene has 1"):
        Visibility(world := scene([(mesh, -1, 3)]), world.cameras[0])
    with pytest.raises(ValueError, match="'thing0' is on body 5"):
        Visibility(world := scene([(mesh, 5, 0)]), world.cameras[0])
    with pytest.raises(ValueError, match="face that names vertex 9 of 4"):
        Visibility(world := scene([(Mesh(mesh.vertices, mesh.faces + 6), -1, 0)]), world.cameras[0])
    with pytest.raises(ValueError, match="not finite"):
        Visibility(world := scene([(Mesh(mesh.vertices * np.nan, mesh.faces), -1, 0)]), world.cameras[0])
    view = camera()
    view.k = view.k * np.array([[1, 1, 1], [1, -1, 1], [1, 1, 1]])
    with pytest.raises(ValueError, match="camera 'cam0': k must be"):
        Visibility(scene([], view=view), view)
    with pytest.raises(ValueError, match="there is no device 'gpu7'"):
        Visibility(scene([]), camera(), device="gpu7")
