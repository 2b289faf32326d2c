"""What may be in the way of light, by boxes: never missed."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.relight.boxes_kernels import Swept, crossed
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.swept_kernels import find_open, find_shaded
from nodes.renderer.lights.lights import KINDS
from nodes.renderer.shadows.ray_kernels import hits_box, inverse_of


@wp.kernel(enable_backward=False)
def meet(
    lower: wp.array(dtype=wp.vec3),
    upper: wp.array(dtype=wp.vec3),
    ray: wp.array(dtype=wp.vec3),
    met: wp.array(dtype=int),
):
    """Tells which rays of length 2 meet their boxes."""
    n = wp.tid()
    if hits_box(lower[n], upper[n], inverse_of(ray[n]), 2.0):
        met[n] = 1


def test_a_ray_meets_a_box_as_its_points_lie_in_it():
    """Points every 1/2000 of the ray: one inside means a hit; a hit without any passes within a step of the box."""
    rng = np.random.default_rng(5)
    count = 3000
    middle, half = rng.uniform(-1.5, 1.5, (count, 3)), rng.uniform(0.0, 0.8, (count, 3))
    ray = rng.normal(size=(count, 3))
    ray[: count // 4, rng.integers(0, 3)] = 0.0
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    met = wp.zeros(count, dtype=int, device="cpu")
    arrays = [wp.array(v.astype(np.float32), dtype=wp.vec3, device="cpu") for v in (middle - half, middle + half, ray)]
    wp.launch(meet, count, [*arrays, met], device="cpu")
    at = np.linspace(0, 2, 2001)[None, :, None] * ray[:, None]
    away = (np.abs(at - middle[:, None]) - half[:, None]).max(-1).min(1)
    found = met.numpy().astype(bool)
    assert not (~found & (away < -1e-5)).any(), "nothing that is in the way is missed"
    assert not (found & (away > 2e-3)).any()
    assert 0.05 < found.mean() < 0.95


def test_of_a_box_that_is_not_a_number_it_is_not_told_that_nothing_is_in_the_way():
    """Where a body has diverged shadows are asked of rays, not left out."""
    low = np.full((3, 3), -0.5, np.float32)
    high = -low
    low[0] = high[0] = np.nan
    low[1, 2] = high[1, 2] = np.nan
    low[2], high[2] = -np.inf, np.inf
    met = wp.zeros(3, dtype=int, device="cpu")
    given = (low, high, np.full((3, 3), 0.5, np.float32))
    arrays = [wp.array(v, dtype=wp.vec3, device="cpu") for v in given]
    wp.launch(meet, 3, [*arrays, met], device="cpu")
    assert (met.numpy() == 1).all()


@wp.kernel(enable_backward=False)
def cross(swept: Swept, position: wp.array2d(dtype=wp.vec3), found: wp.array2d(dtype=int)):
    """Tells of points of instances, in the world's axes, whether something may come before a light."""
    i, n = wp.tid()
    if crossed(swept, 0, wp.identity(n=3, dtype=float), 0, i, position[i, n]):
        found[i, n] = 1


@pytest.mark.parametrize("kind", ["point", pytest.param("directional", marks=pytest.mark.slow)])
def test_what_may_be_shaded_of_an_instance_covers_all_of_its_points(kind: str):
    """40 movers, more than a mask has bits; of each way from a point to the light 400 places are looked at."""
    rng = np.random.default_rng(3)
    movers, instances, points = 40, 60, 200
    middle, reach = rng.uniform(-6, 6, (movers, 3)), rng.uniform(0.05, 0.4, (movers, 3))
    boxes = [
        np.concatenate([f(sign * reach + middle, 0, keepdims=True), sign * reach + middle])[None]
        for f, sign in ((np.min, -1), (np.max, 1))
    ]
    lamp = np.array([[0.5, -0.3, 7.0]]) if kind == "point" else np.array([[0.6, 0.0, 0.8]])
    turn, _ = np.linalg.qr(rng.normal(size=(instances, 3, 3)))
    place, half = rng.uniform(-6, 6, (instances, 3)), rng.uniform(0.05, 0.5, (instances, 3))
    within = rng.uniform(-1, 1, (instances, points, 3)) * half[:, None]
    at = np.einsum("ixy,ipy->ipx", turn, within) + place[:, None]
    change = Change()
    change.casters.turn = wp.array([np.eye(3)], dtype=wp.mat33, device="cpu")
    change.casters.rotation = wp.array(turn[None], dtype=wp.mat33, device="cpu")
    change.casters.translation = wp.array(place[None], dtype=wp.vec3, device="cpu")
    change.half = wp.array(half, dtype=wp.vec3, device="cpu")
    swept = change.swept
    swept.lower, swept.upper = (wp.array(box, dtype=wp.vec3, device="cpu") for box in boxes)
    swept.place, swept.lamp = wp.zeros(1, dtype=wp.vec3, device="cpu"), wp.array(lamp, dtype=wp.vec3, device="cpu")
    swept.radius = wp.zeros(1, dtype=float, device="cpu")
    swept.kind = wp.array([KINDS[kind]], dtype=int, device="cpu")
    swept.masks = wp.zeros((1, instances, 1), dtype=wp.uint32, device="cpu")
    wp.launch(find_shaded, (1, instances), [change], [swept.masks], device="cpu")
    found = wp.zeros((instances, points), dtype=int, device="cpu")
    given = wp.array(at, dtype=wp.vec3, device="cpu")
    wp.launch(cross, found.shape, [swept, given], [found], device="cpu")
    share = np.linspace(0, 1, 400)[:, None, None, None] * (1.0 if kind == "point" else 20.0)
    way = at + share * ((lamp - at) if kind == "point" else lamp)
    met = np.zeros((instances, points), bool)
    for k in range(movers):
        met |= (np.abs(way - middle[k]) < reach[k]).all(-1).any(0)
    shaded = found.numpy().astype(bool)
    assert not (met & ~shaded).any(), "nothing that is in the way is missed"
    assert 0.02 < met.mean() < 0.6
    masks = swept.masks.numpy()
    assert (masks == 0).any(), "of some instances nothing can be shaded"
    assert (~shaded.any(1)).sum() >= (masks == 0).sum()


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("kind", ["point", "directional"])
def test_nothing_comes_between_a_light_and_what_moves_in_the_open(kind: str, device: str):
    """12 boxes in each of 30 environments, half of which move; of each way from a point to the light 200 places are
    looked at, for points of a box at any of its places and others at any of theirs."""
    rng = np.random.default_rng(8)
    envs, count, moving, points = 30, 12, 6, 60
    lamp = np.array([0.5, -0.3, 7.0]) if kind == "point" else np.array([0.6, 0.0, 0.8])
    half = rng.uniform(0.05, 0.5, (count, 3))
    # At both ends of the gap, and halfway.
    start, end = rng.uniform(-5, 5, (2, envs, count, 3))
    end[:, moving:] = start[:, moving:]
    end = start + 0.2 * (end - start)
    places = np.stack([start, 0.5 * (start + end), end])
    lower, upper = places.min(0) - half, places.max(0) + half
    bodies = np.where(np.arange(count) < moving, 1 + np.arange(count), 0)
    around = [f(box[:, :moving], axis=1, keepdims=True) for f, box in ((np.min, lower), (np.max, upper))]

    def put(values, dtype):
        return wp.array(np.asarray(values), dtype=dtype, device=device)

    change = Change()
    change.casters.turn = put(np.broadcast_to(np.eye(3), (envs, 3, 3)), wp.mat33)
    change.casters.rotation = put(np.broadcast_to(np.eye(3), (envs, count, 3, 3)), wp.mat33)
    change.casters.translation = put(start, wp.vec3)
    change.casters.order = put(rng.permutation(count).astype(np.int32), wp.int32)
    change.half = put(half, wp.vec3)
    swept = change.swept
    swept.lower = put(np.concatenate([around[0], lower[:, :moving]], 1), wp.vec3)
    swept.upper = put(np.concatenate([around[1], upper[:, :moving]], 1), wp.vec3)
    swept.place = put(np.zeros((envs, 3)), wp.vec3)
    swept.lamp, swept.radius = put([lamp], wp.vec3), put([0.0], float)
    swept.kind = put([KINDS[kind]], int)

    def in_the_open(camera, blur):
        """Finds them; camera: where it is at one keyframe, at the other it is at 0 [m]. blur [rad]."""
        change.place_then = put(np.concatenate([np.zeros((envs, 3)), np.tile(camera, (envs, 1))]), wp.vec3)
        change.blur = blur
        open_ = wp.full((envs, count), 7, dtype=int, device=device)
        wp.launch(find_open, open_.shape, [change, envs, put(bodies, int)], [open_], device=device)
        return open_.numpy().astype(bool)

    found = in_the_open((0.0, 0.0, 0.0), 0.0)
    near, far = in_the_open((0.0, 0.0, 0.0), 0.002), in_the_open((0.0, 0.0, 300.0), 0.002)
    assert near.any() and not (near & ~found).any(), "less is, where a look-up mixes what is beside a point"
    assert not (far & ~near).any() and far.sum() < 0.3 * near.sum(), "which is more from farther away"
    share = np.linspace(0, 1, 200)[:, None, None] * (1.0 if kind == "point" else 20.0)
    met = np.zeros((envs, count), bool)
    for env, i in np.ndindex(envs, moving):
        at = places[rng.integers(0, 3, points), env, i] + rng.uniform(-1, 1, (points, 3)) * half[i]
        way = at + share * ((lamp - at) if kind == "point" else lamp)
        for j in range(count):
            if j != i:
                met[env, i] |= any((np.abs(way - place) < half[j]).all(-1).any() for place in places[:, env, j])
    assert not (met & found).any(), "what may be shaded is not in the open"
    assert not found[:, moving:].any() and 0.1 < found[:, :moving].mean() < 0.9
    assert found[:, :moving].sum() > 0.5 * (~met[:, :moving]).sum(), "most that nothing shades is"
