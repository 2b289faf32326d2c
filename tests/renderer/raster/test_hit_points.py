"""Where on a body it is hit: against the intersection of the pixel's ray with the plane of the shape, in float64."""

import numpy as np
from renderer_scenes import at, camera, poses, quad, rays, scene

from evis.geometry import se3
from nodes.renderer.raster.visibility import Visibility


def test_points_are_in_the_frame_of_the_body_that_carries_the_shape():
    """Two plates beside each other, each turned and shifted on a body that is itself turned and away."""
    view = camera(48, 36, 50.0)
    made = scene([(quad(0.35, 0.5), 0, 0), (quad(0.4, 0.3), 0, 0)], bodies=1, view=view)
    rest = [at(-0.4, 0.1, 0.2, (0.3, -0.4, 0.5)), at(0.45, -0.1, -0.15, (-0.5, 0.2, 1.1))]
    for instance, pose in zip(made.instances, rest):
        instance.pose = pose
    body, eye = at(0.1, -0.05, 2.0, (0.2, 0.3, -0.4)), at(0.02, 0.03, -0.1, (0.0, 0.05, 0.0))
    visibility = Visibility(made, view)
    visibility.update(poses(body, eye))
    hits = visibility.hits()
    directions = se3.rotate(eye[3:], rays(view))
    for number, pose in enumerate(rest):
        here = hits["instance"][0] == number
        assert here.sum() > 40
        plate = se3.compose(body, pose)
        normal = se3.rotate(plate[3:], np.array([0.0, 0.0, 1.0]))
        along = ((plate[:3] - eye[:3]) @ normal) / (directions[here] @ normal)
        world = eye[:3] + along[:, None] * directions[here]
        expected = se3.transform(se3.inverse(body), world)
        np.testing.assert_allclose(hits["point"][0][here], expected, atol=2e-6)
