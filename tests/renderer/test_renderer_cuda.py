"""The same images from a GPU as from the CPU."""

import numpy as np
import pytest
import warp as wp
from renderer_scenes import ALL, at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Camera, Light, Material
from nodes.renderer.raster import raster
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import LAST, Renderer

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here"),
]


def room():
    """Triangles from one pixel to larger than the image, textures, smooth normals, both kinds of light, shadows."""
    texture = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    materials = [Material("textured", np.ones(3), texture=texture, two_sided=True), Material("grey", np.full(3, 0.5))]
    lights = [
        Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, 1.0])),
        Light("bulb", "point", np.array([1.0, 2, 3]), np.array([-0.5, 0.2, 0.4])),
    ]
    wall = quad(20, 20)
    wall.vertices[:, 2] = 3.0
    meshes = [(wall, WORLD, 0), (sphere(0.3, 80), 0, 1), (quad(0.2, 0.3), 1, 0)]
    return scene(meshes, bodies=2, materials=materials, lights=lights, view=camera(320, 240, 250.0))


def crowd():
    """More movers than are tried one by one for shadows, and a camera that moves."""
    ball = sphere(0.12, 12)
    floor = quad(4, 4)
    floor.vertices[:, 2] = 2.5
    lights = [Light("bulb", "point", np.array([4.0, 4, 4]), np.array([-0.5, 0.2, 0.0]))]
    materials = [Material("grey", np.full(3, 0.5), two_sided=True)]
    meshes = [(floor, WORLD, 0), *((ball, body, 0) for body in range(20))]
    return scene(meshes, 20, materials, lights, camera(320, 240, 250.0), still_camera=False)


def crowded(k, env):
    """Poses of the crowd at an instant."""
    balls = [at(0.4 * (n % 5) - 0.8 + 0.02 * k, 0.35 * (n // 5) - 0.6, 1.5 + 0.05 * env) for n in range(20)]
    return poses(*balls, at(0.05 * k, 0, 0, (0, 0.01 * k, 0)))


def compare(world, run, envs):
    """All images of the instants on both devices; the later ones come from recorded graphs."""
    cpu, cuda = (Renderer(world, world.cameras[0], envs=envs, device=device) for device in ("cpu", "cuda"))
    out = {name: np.empty(*cuda.array_shape(name)) for name in ALL}
    for before, now in zip([None, *run], [*run, run[-1]]):
        expected = cpu.render(now, before, ALL)
        got = cuda.render(now, before, ALL, out)
        # Contracted multiply-adds move a pixel that lies on an edge within float32.
        same = got["ids"] == expected["ids"]
        assert same.mean() > 0.9999
        # A facet of 1e-2 m at a grazing angle has its plane from differences that lose two of float32's digits.
        np.testing.assert_allclose(got["depth"][same], expected["depth"][same], rtol=1e-4)
        hit = same & np.isfinite(expected["depth"])
        assert np.mean(np.abs(got["depth"][hit] / expected["depth"][hit] - 1) > 2e-6) < 1e-2
        assert np.abs(got["motion"] - expected["motion"])[same].max() < 1e-3
        for name, tolerance in (("normal", 1e-5), ("radiance", 1e-3)):
            apart = np.abs(got[name] - expected[name])[same].max(-1) > tolerance
            assert apart.mean() < 1e-3
    for name in ("rotation", "translation"):
        assert np.array_equal(*(getattr(r.visibility, name).numpy() for r in (cpu, cuda)))


@pytest.mark.parametrize("envs", [1, 3])
def test_cuda_equals_cpu(envs):
    run = [
        np.concatenate([
            poses(at(0.1 * k, 0.1 * e, 1.5), at(-0.3, 0.1 * k, 1.2, (0.4, 0, k)), at(0, 0, 0)) for e in range(envs)
        ])
        for k in range(5)
    ]  # fmt: skip
    compare(room(), run, envs)


@pytest.mark.parametrize("envs", [1, 3])
def test_cuda_equals_cpu_with_trees_and_a_moving_camera(envs):
    compare(crowd(), [np.concatenate([crowded(k, e) for e in range(envs)]) for k in range(5)], envs)


def far_away():
    """The crowd 1e5 m from the origin."""
    world, far = crowd(), np.array([1e5, -1e5, 1e5, 0, 0, 0, 0])
    world.instances[0].pose = world.instances[0].pose + far
    world.lights[0].vector = world.lights[0].vector + far[:3]
    return world, [crowded(k, 0) + far for k in range(3)]


def through_the_camera():
    """A ball that flies through the near plane, and round the camera another one seen from within."""
    lamp = Light("lamp", "point", np.full(3, 5.0), np.array([0.1, 0.1, 0.0]))
    grey = [Material("grey", np.full(3, 0.5), two_sided=True)]
    world = scene([(sphere(0.5, 24), 0, 0), (sphere(3.0, 40), 1, 0)], 2, grey, [lamp], camera(160, 120, 90.0, 0.2))
    return world, [poses(at(0.1, 0, z), at(0, 0, 0), at(0, 0, 0)) for z in (1.2, 0.69, 0.3, -0.4)]


def thin(width, height):
    """A plane behind a needle and a triangle without area, in an image of one row or column."""
    mesh = quad(3, 3)
    mesh.faces = np.concatenate([mesh.faces, np.array([(0, 0, 1), (2, 2, 2)], np.int32)])
    mesh.uv = None
    focal = 0.8 * max(width, height)
    k = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    world = scene([(mesh, 0, 0)], 1, view=Camera("cam0", width, height, k))
    return world, [poses(at(0.01 * n, 0, 2.0, (0.2, 0.1, 0)), at(0, 0, 0)) for n in range(3)]


@pytest.mark.parametrize(
    "made", [far_away, through_the_camera, lambda: thin(1, 1), lambda: thin(8192, 2), lambda: thin(2, 8192)]
)
def test_cuda_equals_cpu_at_the_ends_of_what_a_scene_may_hold(made):
    compare(*made(), 1)


def test_a_pose_that_is_not_a_number_is_named_on_cuda():
    world, run = far_away()
    renderer = Renderer(world, world.cameras[0], device="cuda")
    renderer.prepare(ALL)
    for now in run[:2]:
        renderer.render(now, LAST, ALL)
    bad = run[2].copy()
    bad[0, 7, 1] = np.nan
    with pytest.raises(ValueError, match=r"pose of body 'body7' is not finite \(environment 0\)"):
        renderer.render(bad, LAST, ALL)


def test_threads_that_share_the_pixels_of_a_tile_draw_what_each_would_alone(monkeypatch):
    """As they do where blocks and pixels are many. What is on an edge may differ where both kernels round otherwise."""
    world = room()
    now = poses(at(0.1, 0.2, 1.5, (0.3, 0.2, 0.1)), at(-0.2, 0.1, 1.0), at(0, 0, 0))
    monkeypatch.setattr(raster, "FEW", 0)
    drawn = []
    for large in (raster.LARGE_IMAGE, 1 << 30):
        monkeypatch.setattr(raster, "LARGE_IMAGE", large)
        visibility = Visibility(world, world.cameras[0], device="cuda")
        visibility.update(now)
        drawn.append(visibility.packed.numpy())
    assert (drawn[0] != drawn[1]).mean() < 1e-4
    assert len(np.unique(drawn[0] & np.uint64(0xFFFFFFFF))) > 1000
