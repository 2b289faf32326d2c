"""Still instances joined into one mesh for shadow rays and paths: the same light as with one structure for each."""

import numpy as np
import pytest
import warp as wp
from light_scenes import lamp
from reference_scenes import cube
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.geometry import se3
from evis.scene.model import WORLD, Light, Material
from nodes.renderer.lighting import Shading
from nodes.renderer.paths.paths import PathOptions
from nodes.renderer.renderer import Renderer
from nodes.renderer.shading.options import ShadingOptions
from nodes.renderer.shadows.occlusion import TREE_FROM


def crowd(still: int = 2 * TREE_FROM):
    """Boxes and balls on a floor, one of each that moves, a sun, a lamp and a glowing sky."""
    rng = np.random.default_rng(3)
    lights = [
        Light("sun", "directional", np.array([3.0, 2, 1]), np.array([0.3, 0.4, -1.0])),
        lamp((0, 0, 4), (0.5, 0, 0), (0, -0.5, 0)),
    ]
    materials = [Material("grey", np.full(3, 0.6), two_sided=True)]
    meshes = [(quad(8, 8), WORLD, 0)] + [((cube(0.3), sphere(0.3, 8))[k % 2], WORLD, 0) for k in range(still)]
    meshes += [(cube(0.4), 0, 0), (sphere(0.4, 8), 1, 0)]
    made = scene(meshes, 2, materials, lights, camera(64, 48, 50.0), (0.2, 0.3, 0.4), still_camera=False)
    for instance in made.instances[1 : 1 + still]:
        turn = se3.exp(rng.uniform(-1, 1, 3))
        instance.pose = se3.make_pose(np.array([*rng.uniform(-3, 3, 2), rng.uniform(0, 0.8)]), turn)
    where = poses(at(0.5, -0.4, 1.0, (0.3, 0.2, 0)), at(-1, 1, 1.2), at(0, -5, 3.5, (-2.1, 0, 0)))
    return made, where


@pytest.mark.parametrize("options", [None, pytest.param(PathOptions(1, 4), marks=pytest.mark.slow)])
@pytest.mark.parametrize("far", [0.0, 3e4])
def test_joined_triangles_give_the_same_light(options, far):
    """Rounding moves an edge of a shadow by some 1e-7 of the scene, wherever in the world it lies."""
    made, where = crowd()
    for instance in made.instances:
        if instance.body == WORLD:
            instance.pose = instance.pose + np.array([far, 0, 0, 0, 0, 0, 0])
    where = where + np.array([far, 0, 0, 0, 0, 0, 0])
    for light in made.lights:
        if light.kind == "area":
            light.vector = light.vector + np.array([far, 0, 0])
    images = []
    for merged in (False, True):
        renderer = Renderer(made, made.cameras[0], paths=options)
        renderer.shading = Shading(renderer.visibility, ShadingOptions(paths=options, merged=merged))
        images.append(renderer.render(where)["radiance"][0].copy())
        assert (renderer.shading.occluders.casters.merged != wp.uint64(0)) == merged
    assert (images[0].max(-1) > 0).mean() > 0.3
    apart = np.abs(images[1] - images[0]).max(-1) / np.maximum(images[0].max(-1), 1e-6)
    assert (apart > 1e-4).mean() < 0.005
