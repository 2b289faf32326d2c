"""Which z-buffers between two frames a walk over a surface may pass over, against float64 and brute force."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion
from nodes.interpolator.refine.paths.motion_kernels import find_bends, stride_of
from nodes.interpolator.refine.window_kernels import PixelInterval, WindowParameters, WindowScene, shows_one

K, SLOTS, PROBES = 2, 15, 8
"""Coarse intervals, instants inside each, and parts that z-buffers make of each: instants 2, 4 .. 14."""
GAIN = 200.0
EVEN = 0.1
WORLD = 1


@wp.kernel(module="unique", enable_backward=False)
def strides(
    params: WindowParameters,
    scene: WindowScene,
    which: int,
    k: int,
    d: wp.array(dtype=wp.vec3),
    away: wp.array(dtype=float),
    found: wp.array(dtype=int),
):
    px = PixelInterval()
    px.k = k
    px.d = d[wp.tid()]
    found[wp.tid()] = stride_of(params, scene, px, which, WORLD, away[wp.tid()])


@wp.kernel(module="unique", enable_backward=False)
def alike(
    params: WindowParameters,
    scene: WindowScene,
    before: wp.array(dtype=wp.uint64),
    after: wp.array(dtype=wp.uint64),
    one: wp.array(dtype=int),
):
    px = PixelInterval()
    px.k = 1
    px.x = wp.tid()
    one[wp.tid()] = int(shows_one(params, scene, px, before[wp.tid()], after[wp.tid()]))


def sizes(probes=PROBES):
    params = WindowParameters()
    params.coarse, params.slots, params.depth, params.probes = K, SLOTS, (SLOTS + 1).bit_length() - 1, probes
    params.rows = params.envs = 1
    params.rows, params.gain, params.even = K, GAIN, EVEN
    return params


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def moved(kind, t):
    """Turn less one and shift of the world's points since t = 0; t in gaps."""
    turning, going = {
        "even": ([0.0, 0.0, 0.0], [0.3, 0.05, -0.1]),
        "vibrating": (np.array([0.02, 0.03, 0.01]) * np.sin(2 * np.pi * 20 * t), [0.0, 0.0, 0.0]),
        "turning": (np.array([0.05, -0.1, 0.02]) * np.sin(3 * t), [0.0, 0.0, 0.0]),
        "drifting": ([0.0, 0.0, 0.0], 0.1 * np.sin(np.array([4.0, 9.0, 2.0]) * t)),
        "swinging": (np.array([0.05, -0.1, 0.02]) * np.sin(3 * t), 0.1 * np.sin(np.array([4.0, 9.0, 2.0]) * t)),
    }[kind]
    shift = np.array(going) * (t if kind == "even" else 1.0)
    w = np.asarray(turning)
    angle = np.linalg.norm(w)
    axis = skew(w / angle) if angle else np.zeros((3, 3))
    return np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis, shift


def motions_of(every, rows):
    """What `moved` gave at some instants, of the two bodies and the world alike."""
    motions = np.zeros((len(rows), 3), BodyMotion.numpy_dtype())
    for row, n in enumerate(rows):
        motions["turn"][row], motions["shift"][row] = every[n]
    return wp.array(motions, dtype=BodyMotion, device="cpu")


def made_scene(kind, params):
    """The motion since A of the world at all instants of both coarse intervals, in a Stage, and as `moved` gives it."""
    each = SLOTS + 1
    every = [moved(kind, n / (K * each)) for n in range(K * each + 1)]
    inside = [k * each + i for k in range(K) for i in range(1, each)]
    # Since B it is the same here; at coarse frames B has the first row.
    rows = [*inside, *inside]
    scene = WindowScene()
    scene.motions = motions_of(every, rows)
    scene.probes = wp.array([params.probes], dtype=wp.int32)
    scene.bends = wp.zeros((2 * K, 3, params.depth + 1), dtype=wp.vec2)
    frames = [K * each, *range(each, K * each, each)] * 2
    wp.launch(find_bends, (2 * K, 3), [params, scene, motions_of(every, frames)], [scene.bends], device="cpu")
    return scene, every


def off_line(every, k, stride, d, away):
    """The greatest distance [px] of a point from the straight way between instants `stride` apart, at the probes."""
    each, step = SLOTS + 1, (SLOTS + 1) // PROBES
    most = 0.0
    for start in range(k * each, (k + 1) * each, stride):
        at = [turn @ (away * d) + shift for turn, shift in every[start : start + stride + 1]]
        for n in range(step, stride, step):
            m = at[n] - at[0] - n / stride * (at[stride] - at[0])
            most = max(most, GAIN * np.linalg.norm(m[:2] - d[:2] * m[2]) / away)
    return most


@pytest.mark.parametrize("kind", ["even", "vibrating", "turning", "drifting", "swinging"])
@pytest.mark.parametrize("k", range(K))
def test_what_is_passed_over_is_on_the_straight_way(kind, k):
    params = sizes()
    scene, every = made_scene(kind, params)
    rng = np.random.default_rng(3)
    d = np.concatenate([rng.uniform(-0.7, 0.7, (60, 2)), np.ones((60, 1))], axis=1)
    away = rng.uniform(0.3, 20.0, 60)
    found = wp.zeros(60, dtype=wp.int32)
    given = [params, scene, 0, k, wp.array(d, dtype=wp.vec3), wp.array(away, dtype=float), found]
    wp.launch(strides, 60, given, device="cpu")
    each = (SLOTS + 1) // PROBES
    for ray, far, stride in zip(d, away, found.numpy().tolist()):
        assert off_line(every, k, stride, ray, far) <= EVEN * 1.001
        # The bound is no more than a few times what is there.
        if stride < SLOTS + 1:
            assert off_line(every, k, 2 * stride, ray, far) > EVEN / 5
    if kind == "even":
        assert (found.numpy() == SLOTS + 1).all()
    if kind == "vibrating":
        assert (found.numpy() == each).all()


def test_of_intervals_beyond_the_end_of_a_gap_nothing_is_found():
    """A window has room for as many intervals as others have, also where the gap ends before."""
    params = sizes()
    scene, _every = made_scene("swinging", params)
    params.first = 1
    marked = wp.full((2 * K, 3, params.depth + 1), wp.vec2(-1.0, -1.0), dtype=wp.vec2, device="cpu")
    # Where what moves is one interval further on, the first of the window is the last of the gap.
    later = WindowScene()
    later.probes = scene.probes
    half = SLOTS
    motions = scene.motions.numpy()
    later.motions = wp.array(np.concatenate([motions[half : 2 * half]] * 4), dtype=BodyMotion, device="cpu")
    frames = wp.zeros((2 * K, 3), dtype=BodyMotion, device="cpu")
    wp.launch(find_bends, (2 * K, 3), [params, later, frames], [marked], device="cpu")
    found = marked.numpy()
    assert (found[1] == -1).all() and (found[3] == -1).all()
    # As many times as probes can be halved.
    assert (found[[0, 2], :, : PROBES.bit_length() - 1] >= 0).all()


def entry(triangle, depth):
    return (int(np.float32(depth).view(np.uint32)) << 32) | (triangle & 0xFFFFFFFF)


@pytest.mark.parametrize("probes", [1, 2, 8])
def test_a_pixel_shows_one_surface_where_each_look_goes_on_from_the_one_before(probes):
    """Triangles 0 and 1 are one patch, which goes on where the depth does; 2 is another; -1 is the sky."""
    patches, rng, n = [7, 7, 8], np.random.default_rng(probes), 4000
    few = rng.random((n, 1)) < 0.7
    triangles = np.where(few, rng.integers(0, 2, (n, probes + 1)), rng.integers(-1, 3, (n, probes + 1)))
    triangles = np.where(rng.random((n, 1)) < 0.3, triangles[:, :1], triangles)
    depths = np.where(rng.random((n, probes + 1)) < 0.1, 2.0, 1.0)
    entries = np.array([[entry(t, z) for t, z in zip(*row)] for row in zip(triangles.tolist(), depths)], np.uint64)
    params, scene = sizes(probes), WindowScene()
    packed = np.zeros((K * max(probes - 1, 1), 1, n), np.uint64)
    # At the middle of each coarse interval, then at its quarters, and so on; here of the second interval.
    half, row = 1, 0
    while half < probes:
        for k in range(K):
            for j in range(half):
                if k == 1:
                    packed[row, 0] = entries[:, (2 * j + 1) * probes // (2 * half)]
                row += 1
        half *= 2
    scene.probed, scene.probes = wp.array(packed, dtype=wp.uint64), wp.array([probes], dtype=wp.int32)
    scene.targets.pieces = wp.array([(0, p) for p in patches], dtype=wp.vec2i)
    one = wp.zeros(n, dtype=wp.int32)
    ends = [wp.array(np.ascontiguousarray(entries[:, i]), dtype=wp.uint64) for i in (0, -1)]
    wp.launch(alike, n, [params, scene, *ends, one], device="cpu")

    def goes_on(a, b, far_a, far_b):
        if a == b:
            return True
        return min(a, b) >= 0 and patches[a] == patches[b] and far_a == far_b

    wanted = [
        all(goes_on(t[i], t[i + 1], z[i], z[i + 1]) for i in range(probes)) for t, z in zip(triangles.tolist(), depths)
    ]
    assert one.numpy().astype(bool).tolist() == wanted
    assert 0.1 < np.mean(wanted) < 0.9
