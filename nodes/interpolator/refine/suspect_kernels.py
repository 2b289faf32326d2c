"""What makes an interval of a pixel suspect: a third surface, light that flickers, a bend on the pixel's way."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.path_kernels import Way, make_preview
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.log_kernels import apart, radiance_of
from nodes.interpolator.rigid.look_up_kernels import make_keyframes
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@wp.struct
class Cut:
    """Says when an interval is cut. jump: difference of ln I of its ends; bend: distance of a sample in it from the
    straight line; slots: instants within a coarse interval, 2^n - 1; rows: of the coarse frames and probes; probes: per
    coarse interval, plus 1; blind: length of an interval from which on one whose ends show different surfaces is cut
    also where these are alike, for there may be a third one."""

    jump: float
    bend: float
    slots: int
    rows: int
    probes: int
    blind: int
    envs: int
    height: int
    width: int
    margin: int


@wp.func
def probed(
    cut: Cut,
    coarse: int,
    k: int,
    env: int,
    x: int,
    y: int,
    low: int,
    high: int,
    before: wp.uint64,
    after: wp.uint64,
    pieces: wp.array(dtype=wp.vec2i),
    packed: wp.array3d(dtype=wp.uint64),
):
    """Finds an instant between low and high of coarse interval k at which a probe shows what neither end does; 0
    for none."""
    for n in range(1, cut.probes):
        place = n * (cut.slots + 1) // cut.probes
        if place > low and place < high:
            row = (coarse + k * (cut.probes - 1) + n - 1) * cut.envs + env
            between = packed[row, y + cut.margin, x + cut.margin]
            if between != before and between != after:
                if not (joined(before, between, pieces) or joined(between, after, pieces)):
                    return place
    return 0


@cache
def make_suspicions(lens: str, channels: int, flicker: bool) -> tuple[wp.Function, wp.Function]:
    """Makes the functions `flickers` and `bend_of`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    preview = make_preview(lens, channels, flicker)
    Keyframes: Any = make_keyframes(channels, flicker)

    @wp.func
    def flickers(
        cut: Cut,
        keys: Keyframes,
        k: int,
        coarse: int,
        env: int,
        at: int,
        log_a: pixel,
        log_b: pixel,
        strength: wp.array(dtype=float),
    ):
        """Finds the probe in coarse interval k at which light that flickers has a pixel furthest off a straight line,
        and the instant; 0 where it is not off by more than cut.bend. at: of the pixel in keyframe B."""
        worst = cut.bend
        place = wp.int32(0)
        logs = keys.logs[keys.first[1] + at]
        end = log_of(radiance_of(logs, strength[wp.where(k + 1 == coarse, 0, k + 1) * cut.envs + env]))
        for n in range(1, cut.probes):
            row = (coarse + k * (cut.probes - 1) + n - 1) * cut.envs + env
            value = log_b + log_of(radiance_of(logs, strength[row])) - end
            off = apart(value, log_a + float(n) / float(cut.probes) * (log_b - log_a))
            if off > worst:
                worst = off
                place = n * (cut.slots + 1) // cut.probes
        return place

    @wp.func
    def bend_of(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        k: int,
        coarse: int,
        env: int,
        x: int,
        y: int,
        rise: pixel,
        before: wp.uint64,
        after: wp.uint64,
        pieces: wp.array(dtype=wp.vec2i),
    ):
        """Previews coarse interval k of a pixel that sees one surface, in the nearer one of the keyframes: by how much
        it is off a straight line, where, and whether the keyframe shows all of the change `rise` of ln I."""
        patch = wp.int32(0)
        body = keys.turn.shape[1] - 1
        nearest = wp.vec2(1.0, 1.0)
        t = triangle_of(after)
        if t != MISS:
            patch = pieces[t][1]
            body = pieces[t][0]
            nearest = wp.vec2(depth_of(before), depth_of(after))
        which = wp.int32(0)
        if 2 * k >= coarse and k > 0:
            which = 1
        rows = which * cut.rows
        way = Way()
        way.start = wp.where(k > 0, rows + k * cut.envs + env, -1)
        way.end = rows + wp.where(k + 1 == coarse, 0, k + 1) * cut.envs + env
        way.row = rows + (coarse + k * (cut.probes - 1)) * cut.envs + env
        way.stride = cut.envs
        way.parts = cut.probes
        base = keys.first[which] + env * view.width * view.height
        worst, where, change, whole = preview(view, keys, base, way, patch, body, x, y, nearest)
        known = wp.bool(False)
        if wp.static(not flicker):
            known = whole and apart(change, rise) <= cut.bend
        return worst, where, known

    return flickers, bend_of
