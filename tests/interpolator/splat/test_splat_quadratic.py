"""The parabola through three keyframes against closed-form motion, and where it must be a straight line."""

import numpy as np
import pytest
import warp as wp

from nodes.interpolator.interpolator import Interpolator
from nodes.interpolator.splat import bend_kernels

HEIGHT, WIDTH = 48, 64
ROWS, COLUMNS = (a.astype(np.float64) for a in np.mgrid[0:HEIGHT, 0:WIDTH])
PLACES = np.stack([COLUMNS, ROWS], -1)
NONE = np.zeros(1, np.int32)


def turned(places, angle, centre=(31.0, 23.0)):
    """Rotated about the centre."""
    c, s = np.cos(angle), np.sin(angle)
    return (places - centre) @ np.array([[c, s], [-s, c]]) + centre


def bends_of(motion, earlier, ratio=1.0, depth=1.0, before=1.0, straight=0):
    def image(value, *tail):
        full = np.broadcast_to(np.asarray(value, np.float32), (1, HEIGHT, WIDTH, *tail))
        return wp.array(np.ascontiguousarray(full), dtype=wp.float32, device="cpu")

    out = wp.zeros((1, HEIGHT * WIDTH), dtype=wp.vec2, device="cpu")
    flags = wp.array(np.array([straight], np.int32), device="cpu")
    ratios = wp.array(np.array([ratio], np.float32), device="cpu")
    given = [ratios, flags, image(depth), image(before), image(motion, 2), image(earlier, 2)]
    wp.launch(bend_kernels.find_bends, (1, HEIGHT, WIDTH), given, [out], device="cpu")
    return out.numpy().reshape(HEIGHT, WIDTH, 2)


def path_errors(angle, fraction):
    """Largest error [px] of the straight and of the bent path of a rotation, `angle` per gap, at a fraction of it."""
    motion = turned(PLACES, -angle) - PLACES
    bend = bends_of(motion, motion)
    back = 1 - fraction
    truth = turned(PLACES, -angle * back)
    inner = np.hypot(COLUMNS - 31, ROWS - 23) < 20
    line = PLACES + back * motion
    curve = line + back * fraction * bend
    return [np.linalg.norm(p - truth, axis=-1)[inner].max() for p in (line, curve)]


def test_a_rotation_is_met_to_third_order():
    """Half the angle per gap: a quarter of the straight line's error, an eighth of the parabola's."""
    wide, narrow = path_errors(0.4, 0.5), path_errors(0.2, 0.5)
    assert wide[0] == pytest.approx(20 * (1 - np.cos(0.2)), rel=0.05)  # the sagitta of the chord
    assert wide[0] / narrow[0] == pytest.approx(4, rel=0.05)
    assert wide[1] / narrow[1] == pytest.approx(8, rel=0.1)
    assert wide[1] < 0.35 * wide[0]


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.8])
def test_constant_acceleration_is_met_exactly_whatever_the_gap_before(ratio):
    """x(t) = 3 t + 2 t^2, the gap before `ratio` times as long: the bend is minus half the acceleration."""
    motion = np.array([-(3 + 2), 0.5])
    earlier = np.array([3 * -ratio + 2 * ratio**2, 0.5 * ratio])
    bend = bends_of(motion, earlier, ratio)
    inner = bend[1:-1, 6:-6]  # what came from inside the image
    np.testing.assert_allclose(inner, np.broadcast_to([-2.0, 0.0], inner.shape), atol=1e-5)


def test_what_was_hidden_or_outside_and_first_gaps_go_straight():
    motion, earlier = np.array([-5.0, 0.0]), np.array([-1.0, 0.0])
    assert np.abs(bends_of(motion, earlier)[:, 5:, 0] - -2).max() < 1e-6
    assert not bends_of(motion, earlier)[:, :5].any()  # came from beyond the left edge
    assert not bends_of(motion, earlier, straight=1).any()
    assert not bends_of(motion, earlier, before=0.5).any()  # another surface was there
    assert not bends_of(motion, -motion).any()  # a velocity that is quite another one
    edge = np.where(COLUMNS < 30, 1.0, 1.2)  # and at the border of two, none is known
    bend = bends_of(motion, earlier, before=edge)
    assert not bend[:, 34][5:-1].any() or not bend[:, 35][5:-1].any()
    assert bend[5, 10].any() and bend[5, 50].any()


def stream(method, path, upsampling=4, keyframes=4, start=0):
    """Frames [k, K, H, W] of a ramp along x that is at path(k) at keyframe k; its value tells where it is."""
    interpolator = Interpolator(method, upsampling)
    frames = []
    for k in range(keyframes):
        ramp = 10 + 0.1 * (COLUMNS - path(k))
        radiance = np.repeat(ramp[None, ..., None], 3, -1).astype(np.float32)
        step = path(k - 1) - path(k) if k else 0.0
        motion = np.broadcast_to(np.array([step, 0], np.float32), (1, HEIGHT, WIDTH, 2)).copy()
        depth = np.ones((1, HEIGHT, WIDTH), np.float32)
        _, made = interpolator.push(k * 1000, NONE + start, radiance, depth, motion)
        frames.append(made[0])
    return frames


def accelerated(k):
    return 1.5 * k**2


def test_frames_of_an_accelerated_ramp_are_where_it_is():
    """Linear interpolation of a ramp is exact, so its value measures the position; the straight line is g/8 off."""
    for method, error in (("splat-quadratic", 0.0), ("splat", 1.5 * 0.25)):
        last = stream(method, accelerated)[-1][1]  # half way between keyframes 2 and 3
        place = COLUMNS - (last - 10) / 0.1
        inner = place[:, 16:-16]
        # Positions lie on a grid of 1/4096 px, values have 24 bits.
        np.testing.assert_allclose(np.abs(inner - accelerated(2.5)), error, atol=2e-3)


def test_the_first_gap_is_the_straight_line_of_splat():
    curved, straight = (stream(m, accelerated, keyframes=2)[1] for m in ("splat-quadratic", "splat"))
    assert np.array_equal(curved, straight)


def test_a_new_episode_forgets_the_motion_before_it():
    interpolator = Interpolator("splat-quadratic", 4)
    flat = np.ones((1, HEIGHT, WIDTH), np.float32)
    ramp = np.repeat((10 + 0.1 * COLUMNS)[None, ..., None], 3, -1).astype(np.float32)
    made = []
    for k, (episode, step) in enumerate([(0, 0.0), (0, 3.0), (0, 6.0), (1, 0.0), (1, 3.0)]):
        motion = np.broadcast_to(np.array([step, 0], np.float32), (1, HEIGHT, WIDTH, 2)).copy()
        made.append(interpolator.push(k * 1000, NONE + episode, ramp, flat, motion)[1])
    assert np.array_equal(made[1], made[4])
