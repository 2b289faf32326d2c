"""Distorting lenses: the formulas, and what is seen through them, against float64."""

import numpy as np
import pytest
from renderer_scenes import ALL, GEOMETRIC, Still, at, poses, quad, scene, sphere

from evis.geometry import pinhole, se3
from evis.geometry.distortion import Lens, curvature_bounds, project, unproject
from evis.scene.model import Camera, Material, Mesh
from nodes.renderer.raster.lens.cameras import make_view
from nodes.renderer.raster.lens.view_kernels import BUNDLE
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import BEHIND, Renderer

K = np.array([[150.0, 0, 80.2], [0, 155.0, 59.4], [0, 0, 1]])
LENSES = {
    "barrel": ("plumb_bob", (-0.28, 0.09, 0.0012, -0.0008, 0.0)),
    "rational": ("plumb_bob", (0.9, 0.3, 0.001, -0.002, 0.05, 1.2, 0.5, 0.02)),
    "pincushion": ("plumb_bob", (0.15, 0.02, -0.001, 0.001)),
    "fisheye": ("equidistant", (-0.02, 0.006, -0.003, 0.0005)),
}


def lens_camera(name, width=160, height=120, k=K, near=1e-3):
    return Camera("cam0", width, height, k, near, *LENSES[name])


def lens(name):
    return Lens.of(*LENSES[name])


# -- the formulas ----------------------------------------------------------------------------------------------------


def test_known_values():
    """Worked by hand: x = 0.5, y = -0.25 gives s = 0.3125."""
    k1, k2, p1, p2, k3 = -0.3, 0.1, 0.001, -0.002, 0.05
    s = 0.3125
    g = 1 + k1 * s + k2 * s * s + k3 * s**3
    u = 0.5 * g + 2 * p1 * 0.5 * -0.25 + p2 * (s + 2 * 0.25)
    v = -0.25 * g + p1 * (s + 2 * 0.0625) + 2 * p2 * 0.5 * -0.25
    got = Lens.of("plumb_bob", (k1, k2, p1, p2, k3)).distort(np.array([1.0, -0.5, 2.0]))
    np.testing.assert_allclose(got, [u, v], rtol=1e-14)
    # 45 degrees: theta = pi / 4, and without coefficients the image is at theta itself.
    got = Lens.of("equidistant", (0, 0, 0, 0)).distort(np.array([1.0, 0.0, 1.0]))
    np.testing.assert_allclose(got, [np.pi / 4, 0], rtol=1e-14)
    t = np.pi / 4
    got = Lens.of("equidistant", (0.1, 0.02, 0.003, 0.0004)).distort(np.array([0.0, 3.0, 3.0]))
    np.testing.assert_allclose(got, [0, t + 0.1 * t**3 + 0.02 * t**5 + 0.003 * t**7 + 0.0004 * t**9], rtol=1e-14)


def test_the_axis_is_the_principal_point():
    for name in LENSES:
        np.testing.assert_allclose(project(K, lens(name), np.array([0, 0, 3.0])), K[:2, 2], atol=1e-12)
        np.testing.assert_allclose(unproject(K, lens(name), K[:2, 2]), [0, 0, 1], atol=1e-12)


@pytest.mark.parametrize("name", LENSES)
def test_unproject_inverts_project(name):
    pixels = pinhole.pixel_grid(160, 120)
    rays = unproject(K, lens(name), pixels)
    assert np.isfinite(rays).all()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, rtol=1e-14)
    np.testing.assert_allclose(project(K, lens(name), 7.3 * rays), pixels, atol=1e-9)


@pytest.mark.parametrize("name", ["barrel", "rational", "pincushion"])
def test_jacobian_against_finite_differences(name):
    xy = np.random.default_rng(0).uniform(-0.6, 0.6, (50, 2))
    h = 1e-6
    bend = lambda p: lens(name).distort(np.concatenate([p, np.ones((len(p), 1))], 1))
    columns = [(bend(xy + h * e) - bend(xy - h * e)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(lens(name).jacobian(xy), np.stack(columns, -1), atol=1e-8)


def test_nothing_is_seen_beyond_the_fold():
    """x (1 - 0.5 x^2) has its maximum 0.5443 at x = 0.8165: no ray goes through a pixel beyond it."""
    folding = Lens.of("plumb_bob", (-0.5, 0, 0, 0))
    np.testing.assert_allclose(np.tan(folding.domain), np.sqrt(2 / 3), atol=2e-3)
    inside, outside = folding.undistort(np.array([[0.54, 0], [0.55, 0]]))
    np.testing.assert_allclose(folding.distort(inside), [0.54, 0], atol=1e-12)
    assert inside[0] / inside[2] < 0.8165 and np.isnan(outside).all()
    assert np.isnan(folding.distort(np.array([0.9, 0, 1.0]))).all()
    wide = Lens.of("equidistant", (0, 0, 0, 0))
    behind = wide.undistort(np.array([2.0, 0]))
    np.testing.assert_allclose(behind, [np.sin(2.0), 0, np.cos(2.0)], atol=1e-12)


def test_wrong_models_and_coefficients_are_refused():
    for model, coefficients, text in (
        ("fisheye", (), "no distortion model 'fisheye'"),
        ("plumb_bob", (1, 2, 3), "takes 4 or 5 or 8 coefficients, there are 3"),
        ("equidistant", (0, 0, np.nan, 0), "must be finite"),
        # x (1 + k1 x^2) grows up to x = (-3 k1)^(-1/2), here 2e-5: no pixel has a direction.
        ("plumb_bob", (-1e9, 0, 0, 0), "leave no image"),
        ("equidistant", (-1e9, 0, 0, 0), "leave no image"),
    ):
        with pytest.raises(ValueError, match=f"camera 'cam0'.*{text}"):
            view = Camera("cam0", 8, 8, K, 1e-3, model, coefficients)
            Visibility(scene([], view=view), view)


# -- what is seen ----------------------------------------------------------------------------------------------------


def cast(rays, triangles, near):
    """Distances [T, ...] of unit rays (inf = none) and the least barycentric coordinate, both sides, float64."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p = np.cross(rays[None], v[:, None, None])
    det = (u[:, None, None] * p).sum(-1)
    with np.errstate(all="ignore"):
        s = (-a[:, None, None] * p).sum(-1) / det
        q = np.cross(-a, u)[:, None, None]
        t = (rays[None] * q).sum(-1) / det
        distance = (v[:, None, None] * q).sum(-1) / det
    least = np.minimum(np.minimum(s, t), 1 - s - t)
    return np.where(distance >= near, distance, np.inf), least


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("name", LENSES)
def test_visibility_against_every_ray_at_every_triangle(name, tiled):
    rng = np.random.default_rng(3)
    centre = np.stack([*rng.uniform(-2, 2, (2, 150)), rng.uniform(-1, 3, 150)], -1)
    triangles = (centre[:, None] + 0.7 * rng.standard_normal((150, 3, 3))).astype(np.float32)
    mesh = Mesh(triangles.reshape(-1, 3), np.arange(450, dtype=np.int32).reshape(-1, 3))
    k = np.diag([0.4, 0.4, 1.0]) @ K
    view = lens_camera(name, 64, 48, k, near=0.05)
    visibility = Visibility(scene([(mesh, -1, 0)], view=view), view, tiled=tiled)
    visibility.update(poses(at(0, 0, 0)))
    got = visibility.hits()["triangle"][0]
    rays = unproject(k, lens(name), pinhole.pixel_grid(64, 48))
    distance, least = cast(rays, triangles.astype(float), view.near)
    surely = np.where(least > 1e-3, distance, np.inf)
    possible = np.where(least > -1e-3, distance, np.inf).min(0)
    first, second = np.sort(surely, 0)[:2]
    clear = np.isclose(possible, first, rtol=1e-6) & ((second > first * (1 + 1e-3)) | np.isinf(second))
    assert clear.mean() > 0.6 and np.isfinite(first).mean() > 0.5
    expected = np.where(np.isfinite(first), surely.argmin(0), -1)
    np.testing.assert_array_equal(got[clear], expected[clear])


@pytest.mark.parametrize(("tiled", "threads"), [(False, 1), (False, 3), (True, 1)])
@pytest.mark.parametrize("name", LENSES)
def test_triangles_larger_than_the_image(name, tiled, threads):
    """They reach behind the camera and far beyond the field of view, and each image has many bundles of rays."""
    view = lens_camera(name, 150, 110, near=0.05)
    rays, shown = unproject(K, lens(name), pinhole.pixel_grid(150, 110)), 0
    for seed in range(8):
        rng = np.random.default_rng(seed)
        triangles = (5.0 * rng.standard_normal((12, 3, 3)) + 3.0 * rng.standard_normal((12, 1, 3))).astype(np.float32)
        mesh = Mesh(triangles.reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3))
        visibility = Visibility(scene([(mesh, -1, 0)], view=view), view, tiled=tiled, threads=threads)
        visibility.update(poses(at(0, 0, 0)))
        got = visibility.hits()["triangle"][0]
        distance, least = cast(rays, triangles.astype(float), view.near)
        surely = np.where(least > 1e-3, distance, np.inf)
        possible = np.where(least > -1e-3, distance, np.inf).min(0)
        first, second = np.sort(surely, 0)[:2]
        clear = np.isclose(possible, first, rtol=1e-6) & ((second > first * (1 + 1e-3)) | np.isinf(second))
        expected = np.where(np.isfinite(first), surely.argmin(0), -1)
        assert clear.mean() > 0.9
        np.testing.assert_array_equal(got[clear], expected[clear])
        shown += len(np.unique(got[clear]))
    assert shown > 20


@pytest.mark.parametrize("name", LENSES)
def test_every_ray_is_in_the_cone_of_its_bundle(name):
    """And all are between the planes that hold them, those of a row and all to one side of it by the row's."""
    view = make_view(lens_camera(name, 150, 110), 3, "cpu")
    rays, size = view.rays.numpy().astype(np.float64), int(BUNDLE)
    cones = np.repeat(np.repeat(view.cones.numpy().astype(np.float64), size, 0), size, 1)[
        : rays.shape[0], : rays.shape[1]
    ]
    there = rays.any(-1)
    cosine = np.clip((rays * cones[..., :3]).sum(-1), -1, 1)
    assert (np.sqrt(1 - cosine**2) + 1 - cosine <= cones[..., 3])[there].all()
    # It is no wider than some pixels are.
    assert np.median(cones[..., 3]) < 2.0 * size * np.sqrt(2) / 150.0
    assert view.ahead == 1
    x, y = (rays[..., axis] / np.where(there, rays[..., 2], 1.0) for axis in (0, 1))
    assert view.left < x[there].min() and view.right > x[there].max()
    above, below = view.above.numpy(), view.below.numpy()
    for row in range(len(rays)):
        assert above[row] < y[row:][there[row:]].min() and below[row] > y[: row + 1][there[: row + 1]].max()


def test_a_lens_that_sees_behind_has_no_planes():
    k = np.array([[30.0, 0, 75], [0, 30.0, 55], [0, 0, 1]])
    view = make_view(lens_camera("fisheye", 150, 110, k), 0, "cpu")
    assert view.rays.numpy()[..., 2].min() < 0 and view.ahead == 0


@pytest.mark.parametrize("name", LENSES)
def test_edges_are_bent_by_no_more_than_their_bound(name):
    """Points of a great circle are off the chord of its image by the bound of its outer end's angle, at most."""
    rng = np.random.default_rng(2)
    widest, count = min(lens(name).domain, 0.8), 32
    bounds = curvature_bounds(K, lens(name), widest, count)
    assert (np.diff(bounds) >= 0).all() and len(bounds) == count + 1
    theta = rng.uniform(0, widest, (20_000, 2))
    phi = rng.uniform(0, 2 * np.pi, (20_000, 1)) + rng.normal(0, 0.4, (20_000, 2))
    ends = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    angle = np.arccos(np.clip((ends[:, 0] * ends[:, 1]).sum(-1), -1, 1))
    bound = 0.125 * bounds[np.minimum((theta.max(1) / widest * count).astype(int) + 1, count)] * angle**2
    first, last = (project(K, lens(name), ends[:, n]) for n in (0, 1))
    for share in (0.2, 0.5, 0.8):
        between = np.sin((1 - share) * angle)[:, None] * ends[:, 0] + np.sin(share * angle)[:, None] * ends[:, 1]
        off = np.abs(project(K, lens(name), between) - ((1 - share) * first + share * last)).max(1)
        assert (off <= bound + 1e-6).all()


@pytest.mark.parametrize("name", LENSES)
def test_a_closed_surface_has_no_cracks_through_a_lens(name):
    """Small triangles, whose bounds must allow for the bending of their edges, and a wide margin."""
    for rings in (3, 40):
        view = lens_camera(name, 120, 90, np.array([[90.0, 0, 60], [0, 90, 45], [0, 0, 1]]))
        visibility = Visibility(scene([(sphere(1.0, rings), 0, 0)], bodies=1, view=view), view, margin=8)
        rng = np.random.default_rng(5)
        seen = np.isfinite(unproject(view.k, lens(name), pinhole.pixel_grid(136, 106) - 8)).all(-1)
        for _ in range(5):
            visibility.update(poses(at(*rng.uniform(-0.5, 0.5, 3), rng.standard_normal(3)), at(0, 0, 0)))
            hit = visibility.packed.numpy()[0] != np.iinfo(np.uint64).max
            np.testing.assert_array_equal(hit, seen)


@pytest.mark.parametrize("name", LENSES)
def test_depth_normals_and_motion_against_float64(name):
    view = lens_camera(name)
    world = scene([(quad(3.0, 3.0), 0, 0)], bodies=1, view=view, still_camera=False)
    renderer = Renderer(world, view)
    rng = np.random.default_rng(2)
    pixels = pinhole.pixel_grid(160, 120)
    rays = unproject(view.k, lens(name), pixels)
    for size in (0.1, 0.01, 1e-5):
        now = at(0, 0, 1.5, (0.3, -0.2, 0.1)), at(0.01, 0.02, -0.01, (0.02, 0.01, 0.03))
        step = [size * rng.standard_normal(6) for _ in now]
        before = [se3.compose(p, at(*s[:3], s[3:])) for p, s in zip(now, step)]
        out = renderer.render(poses(*now), poses(*before), GEOMETRIC)
        d = se3.rotate(now[1][3:], rays)
        normal = se3.rotate(now[0][3:], np.array([0, 0, 1.0]))
        distance = ((now[0][:3] - now[1][:3]) @ normal) / (d @ normal)
        seen = out["ids"][0] == 1
        assert seen.mean() > 0.9
        np.testing.assert_allclose(out["depth"][0][seen], (distance * rays[..., 2])[seen], rtol=3e-6)
        np.testing.assert_allclose(np.abs(out["normal"][0][seen] @ normal), 1, atol=1e-6)
        point = now[1][:3] + distance[..., None] * d
        then = se3.transform(before[0], se3.transform(se3.inverse(now[0]), point))
        motion = project(view.k, lens(name), se3.transform(se3.inverse(before[1]), then)) - pixels
        seen &= np.isfinite(motion).all(-1)
        assert np.abs(out["motion"][0][seen] - motion[seen]).max() < max(1e-3 * size, 2e-7)


def test_motion_is_the_derivative_of_the_projection():
    """A point that moves by v for dt has moved dt times the finite difference of its image in float64."""
    for name in LENSES:
        view = lens_camera(name)
        world = scene([(quad(3.0, 3.0), 0, 0)], bodies=1, view=view)
        renderer = Renderer(world, view)
        v, dt, h = np.array([0.4, -0.3, 0.5]), 1e-3, 1e-6
        out = renderer.render(poses(at(*(v * dt), (0, 0, 0)) + at(0, 0, 1.5) - at(0, 0, 0), at(0, 0, 0)),
                              poses(at(0, 0, 1.5), at(0, 0, 0)), GEOMETRIC)  # fmt: skip
        rays = unproject(view.k, lens(name), pinhole.pixel_grid(160, 120))
        point = rays * ((1.5 + v[2] * dt) / rays[..., 2:])
        middle = point - v * dt / 2
        slope = (project(view.k, lens(name), middle + h * v) - project(view.k, lens(name), middle - h * v)) / (2 * h)
        # The central difference over dt is exact to dt^2.
        assert np.abs(out["motion"][0] + slope * dt).max() < 1e-3


def test_still_things_have_no_motion_and_what_was_behind_is_outside():
    view = lens_camera("fisheye")
    renderer = Renderer(world := scene([(quad(3.0, 3.0), 0, 0)], bodies=1, view=view), world.cameras[0])
    place = at(0.1, 0, 1.5, (0.3, 0.1, 0))
    assert not renderer.render(poses(place, at(0, 0, 0)), poses(place, at(0, 0, 0)), GEOMETRIC)["motion"].any()
    view = lens_camera("barrel")
    renderer = Renderer(world := scene([(quad(3.0, 3.0), 0, 0)], bodies=1, view=view), world.cameras[0])
    out = renderer.render(poses(at(0, 0, 1), at(0, 0, 0)), poses(at(0, 0, -1), at(0, 0, 0)), GEOMETRIC)
    assert (out["motion"] == BEHIND).all()


def test_a_fisheye_sees_to_its_sides_and_behind():
    """220 degrees from the middle of a box: its six walls by their closed-form depth."""
    k = np.array([[30.0, 0, 60], [0, 30, 60], [0, 0, 1]])
    view = Camera("cam0", 121, 121, k, 1e-3, "equidistant", (0.0, 0, 0, 0))
    corner = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
             (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip
    box = Mesh(corner, np.array(faces, np.int32))
    world = scene([(box, -1, 0)], materials=[Material("m", np.ones(3), two_sided=True)], view=view)
    out = Renderer(world, view).render(poses(at(0, 0, 0)), None, ALL)
    rays = unproject(k, Lens.of("equidistant", (0, 0, 0, 0)), pinhole.pixel_grid(121, 121))
    angle = np.arccos(rays[..., 2])
    assert np.nanmax(angle) > np.radians(140)
    seen = angle < np.radians(110)
    expected = rays[..., 2] / np.abs(rays).max(-1)
    np.testing.assert_allclose(out["depth"][0][seen], expected[seen], atol=1e-5)
    assert (out["depth"][0][seen] < -0.2).any() and np.isfinite(out["radiance"]).all()


def test_without_distortion_it_is_the_pinhole():
    """Zero coefficients give the pinhole's path; tiny ones the lens's: the same ids but on edges, the same depth."""
    mesh, body = sphere(0.5, 12), at(0.1, 0, 1.5, (0.3, 0.2, 0.1))
    images = []
    for coefficients in ((0, 0, 0, 0), (1e-12, 0, 0, 0)):
        view = Camera("cam0", 160, 120, K, 1e-3, "plumb_bob", coefficients)
        world = scene([(mesh, 0, 0), (quad(4, 4), -1, 0)], bodies=1, view=view)
        world.instances[1].pose = at(0, 0, 3)
        out = Renderer(world, view).render(poses(body, at(0, 0, 0)), poses(at(0, 0, 1.5), at(0, 0, 0)), ALL)
        images.append({name: image.copy() for name, image in out.items()})
    same = images[0]["ids"] == images[1]["ids"]
    assert same.mean() > 0.9995
    # Triangles at the silhouette are seen almost edge-on, which turns a rounding into more along the ray.
    np.testing.assert_allclose(images[0]["depth"][same], images[1]["depth"][same], rtol=2e-5)
    np.testing.assert_allclose(images[0]["motion"][same], images[1]["motion"][same], atol=1e-3)


def test_layers_threads_and_environments_change_no_bit_through_a_lens():
    view = lens_camera("barrel")
    world = scene([(sphere(0.3, 16), 0, 0), (quad(2, 2), -1, 0)], bodies=1, view=view)
    world.instances[1].pose = at(0, 0, 3)
    assert isinstance(world.bodies[-1].trajectory, Still)
    moves = [poses(at(0.1 * k, 0, 1.5), at(0, 0, 0)) for k in range(3)]
    plain = Visibility(world, view, layered=False)
    layered, banded = Visibility(world, view), Visibility(world, view, threads=3)
    for move in moves:
        for each in (plain, layered, banded):
            each.update(move)
        np.testing.assert_array_equal(plain.packed.numpy(), layered.packed.numpy())
        np.testing.assert_array_equal(plain.packed.numpy(), banded.packed.numpy())
