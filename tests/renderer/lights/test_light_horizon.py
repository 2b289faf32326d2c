"""Light below the true surface does not reach it, whatever its shading normal says."""

import numpy as np
import pytest
from renderer_scenes import at, camera, poses, quad, scene

from evis.scene.model import Light, Material, Mesh
from nodes.renderer.renderer import Renderer


@pytest.mark.parametrize("below", [True, False])
def test_lamp_behind_a_surface_with_bent_normals(below):
    """A plane towards the camera with normals (0.8, 0, -0.6): no light of a lamp towards (0.8, 0, 0.6), whose cosine to
    them is 0.28; all of one towards (0.8, 0, -0.6)."""
    view, flat = camera(16, 12, 20.0), quad(0.5, 0.5)
    normals = np.tile(np.array([0.8, 0.0, 0.6], np.float32), (2, 3, 1))
    mesh = Mesh(flat.vertices, flat.faces, None, normals)
    sun = Light("sun", "directional", np.full(3, np.pi), np.array([-0.8, 0.0, -0.6 if below else 0.6]), shadows=False)
    world = scene([(mesh, 0, 0)], 1, [Material("paint", np.full(3, 0.5), two_sided=True)], [sun], view)
    image = Renderer(world, view).render(poses(at(0, 0, 1, (np.pi, 0, 0)), at(0, 0, 0)))["radiance"]
    if below:
        assert not image.any()
    else:
        np.testing.assert_allclose(image, 0.5, rtol=1e-5)
