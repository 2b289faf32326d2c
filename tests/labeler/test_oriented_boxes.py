"""Oriented boxes against vertices that are carried to the world and to the camera one by one."""

import numpy as np
from label_world import states, world

from evis.geometry import se3
from evis.scene.model import Instance, Mesh
from evis.scene.motion import Swing
from nodes.labeler.oriented_boxes import OrientedBoxes


def test_a_box_holds_its_vertices_and_touches_them():
    """In the box's own frame every vertex lies within half its size, and on every side one lies on it."""
    scene = world([Swing(np.array([0.0, 1.0, 0.0]), 0.4, 2.0)])
    rng = np.random.default_rng(0)
    cloud = Mesh(rng.normal(0, 1, (50, 3)).astype(np.float32), np.array([[0, 1, 2]], np.int32))
    turned = se3.make_pose(np.array([0.3, 0.2, 0.1]), se3.exp(np.array([0.4, -0.2, 1.0])))
    scene.instances.append(Instance("cloud", 0, cloud, 0, turned))
    scene.instances.append(Instance("nothing", 0, Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), 0))
    pose = states(scene, 2, envs=2)[1].end_pose
    boxes = OrientedBoxes(scene, "cam0")(pose)
    assert boxes.env.tolist() == [0] * 4 + [1] * 4 and boxes.id.tolist() == [1, 2, 3, 4] * 2
    for row, (env, number) in enumerate(zip(boxes.env, boxes.id)):
        instance = scene.instances[number - 1]
        body = pose[env, instance.body] if instance.body >= 0 else se3.IDENTITY
        points = se3.transform(se3.compose(body, instance.pose), instance.mesh.vertices.astype(float))
        seen = se3.transform(se3.inverse(pose[env, 2]), points)
        for frame, there in ((boxes.pose[row], points), (boxes.in_camera[row], seen)):
            own = se3.transform(se3.inverse(frame), there)
            assert np.abs(own.max(0) - boxes.size[row] / 2).max() < 1e-9
            assert np.abs(own.min(0) + boxes.size[row] / 2).max() < 1e-9
    # A box turns with its body: its axes are the body's.
    assert np.allclose(np.abs(boxes.pose[3, 3:]), np.abs(pose[0, 0, 3:]))
