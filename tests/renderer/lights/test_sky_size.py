"""The smallest environment maps: refused with their size and the remedy, or uniform as the closed form says."""

import numpy as np
import pytest
from renderer_scenes import at, poses, quad, scene

from evis.scene.model import Material
from nodes.renderer.renderer import Renderer


def glow(shape):
    """Radiance that the sky shows beside a white plate and the plate sends back, [H, W, 3] and where the plate is."""
    white = Material("white", np.full(3, 0.5), two_sided=True)
    made = scene([(quad(0.3, 0.3), 0, 0)], bodies=1, materials=[white])
    made.environment_map = np.full(shape, 2.0, np.float32)
    image = Renderer(made, made.cameras[0]).render(poses(at(0, 0, 2, (0, np.pi, 0)), at(0, 0, 0)), None)
    return image["radiance"][0]


@pytest.mark.parametrize("h, w", [(1, 1), (1, 8), (4, 1)])
def test_a_map_too_small_to_have_directions_is_refused_with_its_size(h, w):
    words = rf"environment_map is {w} x {h} texels, it must be at least 2 x 2; .* use environment: \[r, g, b\]"
    with pytest.raises(ValueError, match=words) as error:
        glow((h, w, 3))
    assert "must be [h, w, 3]" not in str(error.value) and "\n" not in str(error.value)


def test_the_smallest_map_allowed_is_a_uniform_sky():
    """2 x 2 texels of radiance 2: it is seen as 2, and a plate of albedo 0.5 sends back 0.5 * 2."""
    image = glow((2, 2, 3))
    np.testing.assert_allclose(image[0, 0], 2.0, rtol=1e-6)
    np.testing.assert_allclose(image[24, 32], 1.0, rtol=0.02)
