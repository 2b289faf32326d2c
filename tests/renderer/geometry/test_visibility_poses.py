"""Poses on the device against float64 matrices made by scipy's rotations, near and far from the origin."""

import numpy as np
import pytest
import warp as wp
from renderer_scenes import at, poses, quad, scene
from scipy.spatial.transform import Rotation

from nodes.renderer.raster.visibility import Visibility


def world(count=6):
    """Things on moving bodies, each somewhere in its body's frame, and one on the world."""
    meshes = [(quad(0.1, 0.2), body, 0) for body in range(count)] + [(quad(1, 1), -1, 0)]
    made = scene(meshes, bodies=count, still_camera=False)
    rng = np.random.default_rng(3)
    for instance in made.instances:
        instance.pose = at(*rng.uniform(-1, 1, 3), rng.uniform(-2, 2, 3))
    return made


def instants(envs, far, seed, count=6):
    """Poses float64 [E, N, 7] with quaternions of any length."""
    rng = np.random.default_rng(seed)
    place = np.array([far, -far, 0.3 * far])
    each = [poses(*(at(*(place + rng.uniform(-2, 2, 3)), rng.uniform(-3, 3, 3)) for _ in range(count + 1)))]
    each += [poses(*(at(*(place + rng.uniform(-2, 2, 3)), rng.uniform(-3, 3, 3)) for _ in range(count + 1)))]
    together = np.concatenate(each)[:envs]
    together[..., 3:] *= rng.uniform(0.5, 2.0, (*together.shape[:2], 1))
    return together


def seen(made, bodies):
    """Rotation and translation of every instance to the camera, float64 [E, I, ...]."""
    turn = Rotation.from_quat(bodies[..., 3:].reshape(-1, 4)).as_matrix().reshape(*bodies.shape[:2], 3, 3)
    back = np.swapaxes(turn[:, -1], -1, -2)
    rotations, translations = [], []
    for instance in made.instances:
        own = Rotation.from_quat(instance.pose[3:]).as_matrix()
        above = turn[:, instance.body] if instance.body >= 0 else np.broadcast_to(np.eye(3), (len(bodies), 3, 3))
        base = bodies[:, instance.body, :3] if instance.body >= 0 else np.zeros((len(bodies), 3))
        rotations.append(back @ above @ own)
        middle = instance.pose[:3]
        translations.append((back @ (base - bodies[:, -1, :3] + above @ middle)[..., None])[..., 0])
    return np.stack(rotations, 1), np.stack(translations, 1)


@pytest.mark.parametrize("far", [0.0, 1e5, 1e7])
def test_matrices_are_float64_ones_rounded(far):
    made, bodies = world(), instants(2, far, 1)
    visibility = Visibility(made, made.cameras[0], envs=2)
    visibility.update(bodies)
    rotation, translation = seen(made, bodies)
    # Half a unit in the last place of float32, and of float64 at this distance what a difference of positions keeps.
    np.testing.assert_allclose(visibility.rotation.numpy(), rotation, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(visibility.translation.numpy(), translation, rtol=1e-7, atol=1e-7 + 1e-15 * far)


@pytest.mark.parametrize("far", [0.0, 1e5])
def test_displacement_takes_points_to_where_they_were(far):
    made, before, now = world(), instants(2, far, 1), instants(2, far, 2)
    visibility = Visibility(made, made.cameras[0], envs=2)
    count = len(made.instances)
    turn = wp.zeros((2, count + 1), dtype=wp.mat33)
    shift = wp.zeros((2, count + 1), dtype=wp.vec3)
    visibility.place(visibility.instance_poses(now), before)
    assert visibility.moved
    visibility.displace(True, turn, shift)
    (r0, t0), (r1, t1) = seen(made, before), seen(made, now)
    point = np.array([0.3, -0.2, 0.5])
    was, there = r0 @ point + t0, r1 @ point + t1
    moved = (turn.numpy()[:, :count].astype(np.float64) @ there[..., None])[..., 0] + shift.numpy()[:, :count]
    # Entries of the matrices are rounded to 6e-8 of at most 2, and distances are below 6 m.
    np.testing.assert_allclose(there + moved, was, atol=3e-6)
    sky = turn.numpy()[:, count].astype(np.float64) + np.eye(3)
    for env in range(2):
        a, b = (Rotation.from_quat(bodies[env, -1, 3:]).as_matrix() for bodies in (before, now))
        np.testing.assert_allclose(sky[env], a.T @ b, atol=3e-7)
    assert not shift.numpy()[:, count].any()


def test_what_is_where_it_was_has_no_displacement_at_all():
    """Exact zeros, or a still picture would flicker; also where a quaternion has only changed its sign."""
    made, now = world(), instants(1, 1e5, 4)
    before = now.copy()
    before[0, 0, :3] += 0.01
    before[0, 1, 3:] *= -1
    visibility = Visibility(made, made.cameras[0])
    turn = wp.full((1, len(made.instances) + 1), wp.mat33(7.0), dtype=wp.mat33)
    shift = wp.full((1, len(made.instances) + 1), wp.vec3(7.0), dtype=wp.vec3)
    visibility.place(visibility.instance_poses(now), before)
    visibility.displace(True, turn, shift)
    assert shift.numpy()[0, 0].any()
    assert not turn.numpy()[0, 1:].any() and not shift.numpy()[0, 1:].any()


def test_poses_are_copied():
    """Who gives poses may write over them: the next image is compared with what they were."""
    made, bodies = world(), instants(1, 0.0, 5)
    visibility = Visibility(made, made.cameras[0])
    frames = visibility.update(bodies)
    assert visibility.same(frames)
    bodies[0, 2, 0] += 1e-9
    assert not visibility.same(visibility.instance_poses(bodies))


@pytest.mark.parametrize("quaternion,length", [((0, 0, 0, 0), "0"), ((1e200, 0, 0, 1e200), "inf")])
def test_a_quaternion_that_is_no_rotation_is_named(quaternion, length):
    made, bodies = world(), instants(2, 0.0, 6)
    bodies[1, 3, 3:] = quaternion
    with pytest.raises(ValueError, match=rf"'body3' has a quaternion of length {length} \(environment 1\)"):
        Visibility(made, made.cameras[0], envs=2).update(bodies)


def test_half_turns_are_rotations():
    made, bodies = world(), instants(1, 0.0, 7)
    bodies[0, :, 3:] = [0.0, 1.0, 0.0, 0.0]
    visibility = Visibility(made, made.cameras[0])
    visibility.update(bodies)
    np.testing.assert_allclose(visibility.rotation.numpy(), seen(made, bodies)[0], atol=1e-7)
