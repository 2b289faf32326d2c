"""Paths on a GPU against the CPU: the same numbers, so the same image up to rounding."""

import numpy as np
import pytest
import warp as wp
from reference_scenes import cube
from renderer_scenes import at, camera, poses, scene, sphere

from evis.scene.model import WORLD, Light, Material
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device here"),
]


def test_cuda_traces_the_same_paths():
    """A ray that runs along an edge may go either way; nearly all pixels agree to float32."""
    materials = [
        Material("wall", np.array([0.7, 0.6, 0.5]), two_sided=True),
        Material("metal", np.array([0.9, 0.8, 0.7]), roughness=0.4, metallic=1.0),
        Material("glow", np.zeros(3), emission=np.full(3, 4.0), two_sided=True),
    ]
    bulb = Light("bulb", "point", np.full(3, 5.0), np.array([0.5, -1.0, 0.2]))
    meshes = [(cube(2.0), WORLD, 0), (sphere(0.5, 12), 0, 1), (sphere(0.2, 6), 1, 2)]
    scene_ = scene(meshes, 2, materials, [bulb], camera(64, 48, 50.0), still_camera=False)
    where = poses(at(0.5, 0.5, 1.0), at(-1, 1, 1), at(-1, 0, -1))
    images = []
    for device in ("cpu", "cuda"):
        renderer = Renderer(scene_, scene_.cameras[0], device=device, paths=PathOptions(2, 8))
        images.append(renderer.render(where)["radiance"][0].copy())
    apart = np.abs(images[1] - images[0]).max(-1) / images[0].max(-1)
    assert (apart < 1e-3).mean() > 0.97
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=1e-3)
