"""Labels against difference quotients of exact motion, and brute force."""

import numpy as np
import pytest
import warp as wp

from evis.geometry import distortion, pinhole, se3
from evis.geometry.distortion import Lens
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin, Swing
from nodes.labeler.images.flow_field import FlowField
from nodes.labeler.images.image_labels import boxes, crop
from nodes.labeler.projection import Projection

WIDTH, HEIGHT = 48, 36
K = np.array([[45.0, 0.7, 23.0], [0.0, 47.0, 18.5], [0.0, 0.0, 1.0]])
Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def world():
    """A turning, moving camera and two bodies that spin and fly; depth and ids that a renderer could have given."""
    camera = Prescribed(
        se3.look_at(np.array([0.0, -3.0, 0.5]), np.zeros(3)),
        [Swing(Z, 0.5, 2.0), Sinusoid(np.array([0.1, 0, 0.1]), 3.0)],
    )
    spinner = Prescribed(se3.make_pose(np.array([0.3, 0, 0]), se3.exp(np.array([1.0, 0.3, 0]))), [Spin(Z, 50.0)])
    flyer = Prescribed(
        se3.IDENTITY, [Linear(np.array([1.0, -2.0, 0.5])), Spin(Z, -9.0)], Prescribed(se3.IDENTITY, [Spin(Z, 3)])
    )
    random = np.random.default_rng(0)
    depth = random.uniform(1.0, 5.0, (HEIGHT, WIDTH)).astype(np.float32)
    ids = random.integers(1, 4, (HEIGHT, WIDTH)).astype(np.int32)
    depth[:4], ids[:4] = np.inf, 0
    return [spinner, flyer, camera], depth, ids, np.array([-1, 0, 1, -1])  # id 3 is a piece of the static world


def states(trajectories, t):
    t = np.array([t])
    return np.stack([b.pose(t)[0] for b in trajectories]), np.stack([b.twist(t)[0] for b in trajectories])


def image_of(field, pose, twist, depth, ids):
    """The flow of one environment."""
    out = np.empty((1, HEIGHT, WIDTH, 2), np.float32)
    found = field(pose[None], twist[None], depth[None], ids[None], out)
    assert found is out
    return found[0]


def test_flow_is_the_derivative_of_the_exact_image_motion(world):
    """Central difference of backward motion over 2 us of the closed-form trajectories."""
    trajectories, depth, ids, bodies = world
    now, h = 123_456_789, 1000
    pose, twist = states(trajectories, now)
    flow = image_of(FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2), pose, twist, depth, ids)
    later, before = (states(trajectories, now + d)[0] for d in (h, -h))
    pixels = pinhole.pixel_grid(WIDTH, HEIGHT)
    for number in (1, 2, 3):
        seen = ids == number
        body = [se3.IDENTITY] * 3 if bodies[number] < 0 else [p[bodies[number]] for p in (pose, later, before)]
        ends = [
            pinhole.backward_motion(K, pixels[seen], depth[seen], pose[2], body[0], p[2], b)
            for p, b in ((later, body[1]), (before, body[2]))
        ]
        expected = (ends[0] - ends[1]) / (2e-9 * h)
        scale = np.abs(expected).max()
        assert scale > 10
        assert np.abs(flow[seen] - expected).max() < 1e-6 * scale  # float32 results, 6e-8, and h^2 of the difference


@pytest.mark.parametrize(
    ("model", "coefficients"),
    [
        ("plumb_bob", [-0.28, 0.09, 0.001, -0.002, 0.01]),
        ("plumb_bob", [0.2, -0.1, 0.0, 0.0, 0.05, 0.3, 0.01, 0.0]),
        ("equidistant", [-0.03, 0.01, -0.004, 0.0005]),
        ("equidistant", [0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_flow_through_a_lens_is_the_derivative_of_the_exact_image_motion(world, model, coefficients):
    """Points carried along with their bodies for 1 us either way and projected through the lens, in float64."""
    trajectories, depth, ids, bodies = world
    lens, k = Lens.of(model, coefficients), np.diag([35.0, 37.0, 1.0]) + np.array([[0, 0, 23.0], [0, 0, 18.0], [0] * 3])
    now, h = 123_456_789, 1000
    pose, twist = states(trajectories, now)
    flow = image_of(FlowField(Projection(k, lens), (WIDTH, HEIGHT), bodies, 2), pose, twist, depth, ids)
    rays = distortion.unproject(k, lens, pinhole.pixel_grid(WIDTH, HEIGHT))
    points = se3.transform(pose[2], rays / rays[..., 2:] * np.where(np.isfinite(depth), depth, 1)[..., None])
    later, before = (states(trajectories, now + d)[0] for d in (h, -h))
    for number in (1, 2, 3):
        seen = ids == number
        ends = []
        for then in (later, before):
            there = points[seen]
            if bodies[number] >= 0:
                there = se3.transform(then[bodies[number]], se3.transform(se3.inverse(pose[bodies[number]]), there))
            ends.append(distortion.project(k, lens, se3.transform(se3.inverse(then[2]), there)))
        expected = (ends[0] - ends[1]) / (2e-9 * h)
        scale = np.abs(expected).max()
        assert scale > 10
        assert np.abs(flow[seen] - expected).max() < 1e-6 * scale  # float32 results, 6e-8, and h^2 of the difference


def test_a_lens_without_distortion_is_a_pinhole():
    """And a fisheye without coefficients is not."""
    for model, count in (("none", 0), ("plumb_bob", 5)):
        assert Projection.of(K, model, np.zeros(count)).lens is None
    for model, coefficients in (("equidistant", [0.0] * 4), ("plumb_bob", [0.1, 0, 0, 0])):
        assert Projection.of(K, model, coefficients).lens == Lens.of(model, coefficients)


def test_flow_is_unknown_in_the_sky(world):
    """NaN there and only there."""
    trajectories, depth, ids, bodies = world
    pose, twist = states(trajectories, 0)
    flow = image_of(FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2), pose, twist, depth, ids)
    assert np.array_equal(np.isnan(flow), np.repeat(~np.isfinite(depth)[..., None], 2, axis=-1))


def test_flow_of_a_pure_camera_turn_does_not_depend_on_depth(world):
    """Rotation about the optical centre: the same flow at 1 m and at 100 m, to float32."""
    _, _, ids, bodies = world
    pose = np.tile(se3.IDENTITY, (3, 1))
    twist = np.zeros((3, 6))
    twist[2, 3:] = [0.3, -0.2, 1.0]
    field = FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2)
    near, far = (image_of(field, pose, twist, np.full((HEIGHT, WIDTH), z, np.float32), ids) for z in (1.0, 100.0))
    assert np.array_equal(near, far) and np.abs(near).max() > 10


def test_flow_refuses_ids_without_a_body(world):
    """A CameraInfo of another scene must not give silent nonsense."""
    trajectories, depth, ids, bodies = world
    with pytest.raises(ValueError, match="ids run from 0 to 3, CameraInfo names 3"):
        image_of(FlowField(Projection(K), (WIDTH, HEIGHT), bodies[:3], 2), *states(trajectories, 0), depth, ids)


def test_flow_of_several_environments_is_that_of_each(world):
    """To the bit: environments share lens and camera, and nothing else."""
    trajectories, depth, ids, bodies = world
    field = FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2)
    moments = [states(trajectories, t) for t in (0, 123_456_789, 400_000_000)]
    depths, seen = np.stack([depth, 2 * depth, depth + 1]), np.stack([ids, ids[:, ::-1], ids])
    pose, twist = (np.stack(of_all) for of_all in zip(*moments))
    together = field(pose, twist, depths, seen, np.empty((3, HEIGHT, WIDTH, 2), np.float32))
    for k, (p, t) in enumerate(moments):
        assert np.array_equal(together[k], image_of(field, p, t, depths[k], seen[k]), equal_nan=True)


@pytest.mark.gpu
def test_flow_on_a_gpu_is_that_of_a_cpu(world):
    """Both compute in float64 and round once; a GPU contracts products and sums. Images with a margin are cut there."""
    trajectories, depth, ids, bodies = world
    pose, twist = (a[None] for a in states(trajectories, 123_456_789))
    on_cpu = image_of(FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2), pose[0], twist[0], depth, ids)
    there = [wp.array(np.pad(a, 2)[None], device="cuda") for a in (depth, ids)]
    out = wp.empty((1, HEIGHT, WIDTH, 2), dtype=wp.float32, device="cuda")
    field = FlowField(Projection(K), (WIDTH, HEIGHT), bodies, 2, device="cuda")
    field(pose, twist, *(crop(a, 2) for a in there), out)
    np.testing.assert_allclose(out.numpy()[0], on_cpu, rtol=2e-7, atol=1e-9)
    few = FlowField(Projection(K), (WIDTH, HEIGHT), bodies[:3], 2, device="cuda")
    few(pose, twist, *(crop(a, 2) for a in there), out)
    with pytest.raises(ValueError, match="ids run from 0 to 3, CameraInfo names 3"):
        few(pose, twist, *(crop(a, 2) for a in there), out)


def test_boxes_are_the_extent_of_the_visible_pixels():
    """Against a search over all pixels, with instances of one pixel, at the borders, and absent ones."""
    ids = np.zeros((2, 20, 30), np.int32)
    ids[0, 3:7, 5:9], ids[0, 0, 29], ids[1, 10:, :4], ids[1, 12, 25] = 2, 7, 5, 5
    box, env, number = boxes(ids)
    expected = []
    for e in range(2):
        for i in sorted(set(ids[e].reshape(-1)) - {0}):
            y, x = np.nonzero(ids[e] == i)
            expected.append((e, i, x.min(), y.min(), x.max(), y.max()))
    assert np.array_equal(np.column_stack((env, number, box)), expected)
    assert box.dtype == np.float32 and env.dtype == number.dtype == np.int32


def test_boxes_of_an_empty_view():
    """No instance, no box, but arrays of the right shape."""
    box, env, number = boxes(np.zeros((1, 4, 4), np.int32))
    assert box.shape == (0, 4) and env.shape == number.shape == (0,)


def test_crop():
    """The margin goes on every side; none leaves the array."""
    image = np.arange(2 * 6 * 8).reshape(2, 6, 8)
    assert np.array_equal(crop(image, 2), image[:, 2:4, 2:6]) and crop(image, 0) is image
