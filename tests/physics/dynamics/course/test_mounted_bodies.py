"""What is mounted on bodies of many environments: a kernel gives the bits of numpy."""

import numpy as np

from evis.geometry import se3
from nodes.physics.dynamics.course.mounted import Mounted
from nodes.physics.dynamics.course.paths import Paths


def test_the_bits_are_those_of_numpy() -> None:
    """Bodies that turn, and such as rest with both signs of zero; one is mounted on one that is mounted itself."""
    random = np.random.Generator(np.random.Philox(11))
    poses = np.concatenate((random.normal(size=(9, 4, 5, 3)), se3.normalize(random.normal(size=(9, 4, 5, 4)))), axis=-1)
    twists = random.normal(size=(9, 4, 5, 6)) * 10.0 ** random.integers(-9, 5, (9, 4, 5, 1))
    twists[3], twists[4] = 0.0, -0.0
    poses[5, ..., 3:] = [0.0, 0.0, 0.0, 1.0]
    offsets = poses[0, 0, :2].copy()
    offsets[1] = [0.0, -0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    mounted = [(1, 0, offsets[0]), (4, 1, offsets[1])]
    expected, expected_twists = poses.copy(), twists.copy()
    for m, parent, offset in mounted:
        above, above_twist = expected[:, :, parent], expected_twists[:, :, parent]
        expected[:, :, m] = se3.compose(above, offset)
        expected_twists[:, :, m] = se3.compose_twist(above, above_twist, offset, np.zeros(6))
    paths, put = Paths(poses.shape[:3]), Mounted(mounted).put
    for parts in ([None], [None], [slice(0, 5), slice(5, 10)]):  # a launch is made, is used again, takes parts
        paths.poses[:], paths.twists[:] = poses, twists
        for part in parts:
            put(paths, part)
        assert paths.poses.tobytes() == expected.tobytes()
        assert paths.twists.tobytes() == expected_twists.tobytes()
