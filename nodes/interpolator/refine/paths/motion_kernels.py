"""Finds how far bodies are off straight paths between instants, so that what lies between need not be evaluated."""

import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion, shift_at, turn_at
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    WindowParameters,
    WindowScene,
    probe_spacing,
    slot_row,
)
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})

STILL = wp.constant(0.4)
"""Way of a point, of the distance from a straight one that counts as none, up to which it counts as still."""


@wp.func
def motion_since(
    params: WindowParameters,
    scene: WindowScene,
    motions: wp.array2d(dtype=BodyMotion),
    env: int,
    k: int,
    which: int,
    i: int,
    body: int,
):
    """Gives the motion of a body since keyframe `which` at instant i of coarse interval k; motions: of Keyframes,
    at the coarse frames."""
    motion = BodyMotion()
    if which + i + k > 0:
        if i == 0 or i > params.slots:
            frame = k + wp.where(i == 0, 0, 1)
            row = which * params.rows + wp.where(frame == params.coarse, 0, frame) * params.envs + env
            at = row * motions.shape[1] + body
            motion.turn = turn_at(motions, at)
            motion.shift = shift_at(motions, at)
        else:
            row = which * (scene.motions.shape[0] // 2) + slot_row(params, env, k, i)
            at = row * scene.motions.shape[1] + body
            motion.turn = turn_at(scene.motions, at)
            motion.shift = shift_at(scene.motions, at)
    return motion


@wp.func
def norm_of(m: wp.mat33):
    """Bounds by how much a matrix lengthens a vector; tight where it turns by a small angle, less one."""
    skew = 0.5 * (m - wp.transpose(m))
    rest = m - skew
    # A skew matrix has two equal singular values, and none other.
    return wp.sqrt(0.5 * wp.ddot(skew, skew)) + wp.sqrt(wp.ddot(rest, rest))


@wp.kernel
def find_bends(
    # in
    params: WindowParameters,
    scene: WindowScene,
    motions: wp.array2d(dtype=BodyMotion),
    # out
    bends: wp.array3d(dtype=wp.vec2),
):
    """Computes how far the motion of bodies since a keyframe is off a straight line at the probes, at most, where it is
    known at both ends of a coarse interval, then at its half too, then at its quarters, and so on.

    motions: as of motion_since. bends [2 intervals E, N + 2, depth + 1]: since A, then since B: turn and shift [m];
    last, how far the ends of a coarse interval are apart. Motion since B is not known at A, and not asked for; zero may
    stand there, as it matters only how the rest goes on.
    """
    row, body = wp.tid()
    env = row % params.envs
    intervals = bends.shape[0] // (2 * params.envs)
    which = row // params.envs // intervals
    k = params.first + row // params.envs % intervals
    if k >= params.coarse:
        # The last window of a gap may have fewer intervals than the others.
        return
    each = probe_spacing(params, scene, env)
    stride = params.slots + 1
    level = wp.int32(0)
    while stride > each:
        most = wp.vec2(0.0, 0.0)
        for part in range((params.slots + 1) // stride):
            start = part * stride
            a = motion_since(params, scene, motions, env, k, which, start, body)
            b = motion_since(params, scene, motions, env, k, which, start + stride, body)
            for n in range(1, stride // each):
                g = float(n * each) / float(stride)
                m = motion_since(params, scene, motions, env, k, which, start + n * each, body)
                off = m.turn - a.turn - g * (b.turn - a.turn)
                aside = m.shift - a.shift - g * (b.shift - a.shift)
                most = wp.vec2(wp.max(most[0], norm_of(off)), wp.max(most[1], wp.length(aside)))
        bends[row, body, level] = most
        stride = stride // 2
        level += 1
    a = motion_since(params, scene, motions, env, k, which, 0, body)
    b = motion_since(params, scene, motions, env, k, which, params.slots + 1, body)
    bends[row, body, bends.shape[2] - 1] = wp.vec2(norm_of(b.turn - a.turn), wp.length(b.shift - a.shift))


@wp.func
def stride_of(params: WindowParameters, scene: WindowScene, px: PixelInterval, which: int, body: int, away: float):
    """Gives the instants from one to the next of which a point on a body goes a straight way, in both directions of the
    image.

    body, away: as of place_then.
    """
    intervals = scene.bends.shape[0] // (2 * params.envs)
    row = (which * intervals + px.k - params.first) * params.envs + px.env
    each = probe_spacing(params, scene, px.env)
    size = wp.length(px.d)
    # Of a point p off by e the image is off by gain |d| |e| / |p| times |d| at most.
    off_turn = params.gain * size * size
    off_shift = params.gain * size / away
    stride = params.slots + 1
    level = wp.int32(0)
    straight = wp.bool(False)
    while stride > each and not straight:
        bend = scene.bends[row, body, level]
        straight = off_turn * bend[0] + off_shift * bend[1] <= params.even
        if not straight:
            stride = stride // 2
            level += 1
    return stride


@wp.func
def path_length_of(params: WindowParameters, scene: WindowScene, px: PixelInterval, hit: wp.uint64):
    """Bounds the way [px] that what a z-buffer entry shows at the start of a coarse interval goes in it, there and back
    as often as its first half tells."""
    body = scene.bends.shape[1] - 1
    away = wp.float32(1.0)
    t = triangle_of(hit)
    if t != MISS:
        body = scene.targets.pieces[t][0]
        away = depth_of(hit)
    row = (px.k - params.first) * params.envs + px.env
    gone = scene.bends[row, body, 0] + scene.bends[row, body, scene.bends.shape[2] - 1]
    size = wp.length(px.d)
    return params.gain * size * (size * gone[0] + gone[1] / away)


@wp.func
def moves(params: WindowParameters, scene: WindowScene, px: PixelInterval, hit: wp.uint64):
    """Tells whether what a pixel sees at the start of a coarse interval moves in the image, although it may look alike
    at its end."""
    return path_length_of(params, scene, px, hit) > STILL * params.even
