"""The same images from a GPU as from the CPU."""

import numpy as np
import pytest
import warp as wp
from renderer_scenes import ALL, at, camera, poses, quad, scene, sphere

from evis.scene.model import WORLD, Light, Material
from nodes.renderer.renderer import Renderer

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


@pytest.mark.parametrize("envs", [1, 3])
def test_cuda_equals_cpu(envs):
    world = room()
    run = [
        np.concatenate([
            poses(at(0.1 * k, 0.1 * e, 1.5), at(-0.3, 0.1 * k, 1.2, (0.4, 0, k)), at(0, 0, 0)) for e in range(envs)
        ])
        for k in range(4)
    ]  # fmt: skip
    cpu, cuda = (Renderer(world, world.cameras[0], envs=envs, device=device) for device in ("cpu", "cuda"))
    out = {name: np.empty(*cuda.array_shape(name)) for name in ALL}
    for before, now in zip([None, *run], [*run, run[-1]]):
        expected = cpu.render(now, before, ALL)
        got = cuda.render(now, before, ALL, out)
        # Contracted multiply-adds move a pixel that lies on an edge within float32.
        same = got["ids"] == expected["ids"]
        assert same.mean() > 0.9999
        # A facet of 1e-2 m at a grazing angle has its plane from differences that lose two of float32's digits.
        np.testing.assert_allclose(got["depth"][same], expected["depth"][same], rtol=2e-5)
        assert np.abs(got["motion"] - expected["motion"])[same].max() < 1e-3
        for name, tolerance in (("normal", 1e-5), ("radiance", 1e-3)):
            apart = np.abs(got[name] - expected[name])[same].max(-1) > tolerance
            assert apart.mean() < 1e-3
