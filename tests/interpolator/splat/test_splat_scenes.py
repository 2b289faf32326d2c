"""The warp in scenes whose answer is known: no motion, whole pixels, occlusion, sky, uncovered background."""

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from nodes.interpolator.keyframe import KeyframeView
from nodes.interpolator.splat.splat import make_splat

K = 8


def view(image, depth, motion, envs=1):
    """Broadcast to [E, H, W]; a scalar depth and one motion vector stand for all pixels."""
    image = np.broadcast_to(image, (envs, *np.shape(image)[-2:])).astype(np.float32)
    depth = np.broadcast_to(depth, image.shape).astype(np.float32)
    motion = np.broadcast_to(motion, (*image.shape, 2)).astype(np.float32)
    return KeyframeView(
        *(wp.array(np.ascontiguousarray(v), dtype=wp.float32, device="cpu") for v in (image, depth, motion))
    )


def between(a, b, upsampling=K, margin=0, held=None, threads=1):
    envs, height, width = a.image.shape
    out = np.full((envs, upsampling, height - 2 * margin, width - 2 * margin), np.nan, np.float32)
    method = make_splat(height, width, envs, upsampling, margin, threads=threads)
    report = method.between(a, b, [False] * envs if held is None else held, out)
    return out, report


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def noise(rng, height=20, width=30):
    return np.exp(rng.uniform(-11, 11, (height, width))).astype(np.float32)


def test_without_motion_every_frame_is_the_keyframe_bit_for_bit(rng):
    a, b = noise(rng), noise(rng)
    out, report = between(view(a, 2.0, (0, 0)), view(b, 2.0, (0, 0)))
    assert (out == b).all()
    assert report.filled == 0


def test_without_motion_but_nearing_every_frame_is_the_keyframe_bit_for_bit(rng):
    """Depth that changes goes the long way through the scatter."""
    b = noise(rng)
    out, _ = between(view(noise(rng), 2.0, (0, 0)), view(b, 1.9, (0, 0)))
    assert (out == b).all()


@pytest.mark.parametrize("upsampling", [8, 5])
@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (2, -1)])
def test_translation_by_whole_pixels_per_frame_is_exact(rng, direction, upsampling):
    """Also for K = 5, where (1 - i/5) * 5 px is not a whole number in float32."""
    world = noise(rng, 60, 70)
    dx, dy = direction
    here = lambda i: world[20 - i * dy : 40 - i * dy, 20 - i * dx : 50 - i * dx]
    motion = (-upsampling * dx, -upsampling * dy)
    out, report = between(view(here(0), 3.0, motion), view(here(upsampling), 3.0, motion), upsampling)
    for i in range(1, upsampling):
        left, right = max(0, -(upsampling - i) * dx), min(30, 30 - (upsampling - i) * dx)
        top, bottom = max(0, -(upsampling - i) * dy), min(20, 20 - (upsampling - i) * dy)
        inside = (slice(max(top, 0), bottom), slice(left, right))
        assert (out[0, i - 1][inside] == here(i)[inside]).all(), f"frame {i}"
    # What B moved away from is seen by A, which the same motion brings in.
    assert report.filled == 0 or direction == (2, -1)


def squares(shift, near=1.0, far=5.0, background=0.01, value=100.0):
    """A near square, 8 px wide, `shift` px to the right of its place; motion 8 px to the right per gap."""
    image = np.full((20, 40), background, np.float32)
    depth = np.full((20, 40), far, np.float32)
    motion = np.zeros((20, 40, 2), np.float32)
    at = (slice(6, 14), slice(8 + shift, 16 + shift))
    image[at], depth[at], motion[at] = value, near, (-8, 0)
    return image, depth, motion


@pytest.mark.parametrize("far", [1.5, 5.0, np.inf])
def test_the_near_surface_wins_wholly(far):
    """A softmax would let 27 % of the background through at 2 m against 3 m; here it is 0 %."""
    out, report = between(view(*squares(0, far=far)), view(*squares(8, far=far)))
    for i in range(1, K + 1):
        expected = squares(i, far=far)[0]
        assert (out[0, i - 1] == expected).all(), f"frame {i}"
    assert report.filled == 0


def test_moving_behind_something_near_stays_behind():
    image, depth, motion = squares(0, near=3.0)
    image_b, depth_b, motion_b = squares(8, near=3.0)
    for im, z, m in ((image, depth, motion), (image_b, depth_b, motion_b)):
        im[:, 14:20], z[:, 14:20], m[:, 14:20] = 7.0, 1.0, 0.0
    out, _ = between(view(image, depth, motion), view(image_b, depth_b, motion_b))
    assert (out[..., 14:20] == 7.0).all()


def test_a_sky_that_turns_is_finite(rng):
    sky = noise(rng)
    out, _ = between(view(sky, np.inf, (-3.3, 1.7)), view(sky, np.inf, (-3.3, 1.7)))
    assert np.isfinite(out).all()
    assert out.min() >= sky.min() * (1 - 1e-6) and out.max() <= sky.max() * (1 + 1e-6)


def test_something_in_front_of_the_sky_keeps_its_depth():
    """Where the other keyframe has sky at the correspondence the own depth counts; inf - inf is never made."""
    image, _, motion = squares(0, far=np.inf)
    image_b, depth_b, motion_b = squares(8, far=np.inf)
    out, _ = between(view(image, np.inf, motion), view(image_b, depth_b, motion_b))
    assert (out[0, :, 8, 15] == 100.0).any()
    assert np.isfinite(out).all()


def test_unknown_pixels_take_the_background_and_are_counted():
    """At half time both squares are a square's height away, up and down, from the wall that they hid: nobody saw it."""
    image, depth, motion = squares(0)
    motion[depth == 1.0] = (0, -16)
    out, report = between(view(image, depth, motion), view(image, depth, motion), 2)
    assert (out[0, 0, 6:14] == np.float32(0.01)).all()
    assert (out[0, 0, 0:6, 8:16] == 100.0).all()
    assert report.filled == 64


def test_of_two_neighbours_the_farther_one_fills():
    """As above, with something else near right beside the hole: the wall on the left is taken all the same."""
    image, depth, motion = squares(0)
    motion[depth == 1.0] = (0, -16)
    image[:, 16:20], depth[:, 16:20] = 9.0, 2.0
    out, _ = between(view(image, depth, motion), view(image, depth, motion), 2)
    assert (out[0, 0, 6:14, 8:16] == np.float32(0.01)).all()


def test_nothing_known_at_all_gives_the_keyframe(rng):
    b = noise(rng)
    out, report = between(view(noise(rng), 1.0, (500, 500)), view(b, 1.0, (-500, 300)))
    assert report.filled == (K - 1) * b.size
    assert (out == b).all()


def test_motion_that_is_not_finite_is_dropped_and_counted(rng):
    motion = np.zeros((20, 30, 2), np.float32)
    motion[5, 5], motion[6, 6], motion[7, 7] = np.nan, np.inf, 1e30
    out, report = between(view(noise(rng), 2.0, motion), view(noise(rng), 2.0, motion))
    assert np.isfinite(out).all() and (out > 0).all()
    assert report.nonfinite == 4


def test_depth_that_is_nonsense_counts_as_sky(rng):
    depth = np.full((20, 30), 2.0, np.float32)
    depth[3, 3], depth[4, 4], depth[5, 5] = np.nan, -1.0, 0.0
    out, _ = between(view(noise(rng), depth, (1.5, 0)), view(noise(rng), depth, (1.5, 0)))
    assert np.isfinite(out).all() and (out > 0).all()


def test_the_margin_is_cropped_and_used(rng):
    """With a margin the frame is the inner part of the frame without; what enters comes from the margin."""
    a, b = (view(noise(rng), 2.0, (-4.25, 2.5)) for _ in range(2))
    whole, _ = between(a, b)
    inner, report = between(a, b, margin=5)
    assert (inner == whole[:, :, 5:-5, 5:-5]).all()
    assert report.filled == 0


def test_many_frames_per_gap(rng):
    a, b = (view(noise(rng, 4, 5), 2.0, (-1.0, 0)) for _ in range(2))
    out, _ = between(a, b, 1000)
    few, _ = between(a, b, 4)
    assert (out[0, 249::250] == few[0]).all()


@pytest.fixture
def pairs(rng):
    """Three environments with different motion everywhere."""
    shape = (3, 20, 30)
    parts = [
        [np.exp(rng.uniform(-5, 5, shape)), rng.choice([1.0, 2.0, np.inf], shape), rng.uniform(-6, 6, (*shape, 2))]
        for _ in "AB"
    ]
    return [[np.asarray(p, np.float32) for p in part] for part in parts]


def test_environments_are_those_of_single_runs_bit_for_bit(pairs):
    together, report = between(view(*pairs[0], envs=3), view(*pairs[1], envs=3))
    filled = 0
    for e in range(3):
        alone, one = between(*(view(*(part[e] for part in pair)) for pair in pairs))
        assert (together[e] == alone[0]).all()
        filled += one.filled
    assert report.filled == filled > 0


def test_an_environment_that_begins_an_episode_holds_its_keyframe(pairs):
    a, b = (view(*pair, envs=3) for pair in pairs)
    free, _ = between(a, b)
    out, _ = between(a, b, held=[False, True, False])
    assert (out[1] == pairs[1][0][1]).all()
    assert (out[[0, 2]] == free[[0, 2]]).all()


@pytest.mark.parametrize("threads", [2, 3, 16])
def test_the_bytes_do_not_depend_on_runs_or_threads(pairs, threads):
    a, b = (view(*pair, envs=3) for pair in pairs)
    first, _ = between(a, b)
    again, _ = between(a, b)
    shared, _ = between(a, b, threads=threads)
    assert first.tobytes() == again.tobytes() == shared.tobytes()


def test_colour_is_three_luminances(rng):
    shape = (1, 12, 13)
    depth = rng.choice([1.0, 2.0], shape).astype(np.float32)
    motion = rng.uniform(-3, 3, (*shape, 2)).astype(np.float32)
    rgb = [np.exp(rng.uniform(-5, 5, (*shape, 3))).astype(np.float32) for _ in "AB"]
    wrap = lambda v: wp.array(np.ascontiguousarray(v), dtype=wp.float32, device="cpu")
    out = np.empty((1, K, 12, 13, 3), np.float32)
    views = [KeyframeView(wrap(v), wrap(depth), wrap(motion)) for v in rgb]
    make_splat(12, 13, 1, K, 0, 3).between(*views, [False], out)
    for c in range(3):
        single, _ = between(*(KeyframeView(wrap(v[..., c]), wrap(depth), wrap(motion)) for v in rgb))
        assert (out[..., c] == single).all()


def pixels(most):
    return st.floats(-most, most, width=32, allow_subnormal=False)


@settings(max_examples=40, deadline=None)
@given(
    hnp.arrays(np.float32, (5, 6, 2), elements=pixels(8) | pixels(2.0**100)),
    hnp.arrays(np.float32, (2, 5, 6), elements=st.sampled_from([0.1, 1.0, 1.005, 7.0, np.inf])),
)
def test_any_motion_stays_within_the_values_seen(motion, depth):
    image = np.linspace(0.5, 2.0, 30, dtype=np.float32).reshape(5, 6)
    out, _ = between(view(image, depth[0], motion), view(image[::-1].copy(), depth[1], motion[::-1].copy()), 3)
    assert out.min() >= 0.5 * (1 - 1e-6) and out.max() <= 2.0 * (1 + 1e-6)
