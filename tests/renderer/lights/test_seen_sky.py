"""A sky that is seen but lights nothing, as a MuJoCo skybox."""

import numpy as np
from renderer_scenes import at, poses, quad, scene

from evis.scene.model import Material
from nodes.renderer.renderer import Renderer


def test_a_sky_that_is_only_seen_leaves_the_light_to_the_environment():
    """Behind a plate of albedo 0.5 the map's radiance of 2; the plate sends back 0.5 of the environment's 0.3."""
    white = Material("white", np.full(3, 0.5), two_sided=True)
    made = scene([(quad(0.3, 0.3), 0, 0)], bodies=1, materials=[white])
    made.environment_map, made.environment = np.full((8, 16, 3), 2.0, np.float32), np.full(3, 0.3, np.float32)
    made.sky_lights = False
    image = Renderer(made, made.cameras[0]).render(poses(at(0, 0, 2, (0, np.pi, 0)), at(0, 0, 0)))["radiance"][0]
    np.testing.assert_allclose(image[0, 0], 2.0, rtol=1e-6)
    np.testing.assert_allclose(image[24, 32], 0.15, rtol=1e-5)
