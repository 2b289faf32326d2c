"""Finds when, between two frames, lamps stop or begin to light what pixels see, because something comes between or the
next facet is turned otherwise; and when the irradiance from lamps that move passes a peak."""

from functools import cache

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import make_trace_between
from nodes.interpolator.refine.light.facet_kernels import make_facets_between, sections_of
from nodes.interpolator.refine.light.lamp_kernels import (
    NOTHING,
    LogIrradiance,
    log_irradiance_after,
    log_irradiance_at,
    make_hidden_lamps,
    make_turned_lamps,
)
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    PixelInterval,
    WindowParameters,
    WindowScene,
    end_entries_of,
    entry_at,
    parts_of,
    pixel_interval_at,
    probe_spacing,
    slot_row,
)
from nodes.interpolator.relight.change_kernels import MOVED, SHADED, Change, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.flag_kernels import make_narrow_flags
from nodes.interpolator.relight.light_kernels import make_irradiance
from nodes.interpolator.rigid.plan_kernels import same_surface
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

ONE = wp.constant(wp.uint64(1))


@wp.func
def part_at(params: WindowParameters, parts: int, n: int):
    """Gives the instant at which part n of `parts` of a coarse interval begins, of those that lie within it."""
    return wp.clamp(n * ((params.slots + 1) // parts), 1, params.slots)


@cache
def make_find_light_changes(changes: LightChanges, trees: bool) -> wp.Kernel:
    """Makes the kernel `find_light_changes`; changes: of light in the scene; trees: as of `make_occlusion`."""
    hidden_lamps, turned_lamps = make_hidden_lamps(changes, trees), make_turned_lamps(changes)
    facets_between = make_facets_between(changes)
    trace_between = make_trace_between(False)
    narrow_flags = make_narrow_flags(changes)
    log_irradiance, _ = make_irradiance(changes)

    @wp.func
    def probe_entry(params: WindowParameters, scene: WindowScene, px: PixelInterval, i: int, end: wp.uint64):
        """Gives the z-buffer entry of the probe at instant i, or `end`, of the coarse interval, beyond its last one."""
        if i > params.slots:
            return end
        return entry_at(params, scene, px, i)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_light_changes(
        # in
        view: CameraView,
        params: WindowParameters,
        row0: int,
        span: int,
        scene: WindowScene,
        change: Change,
        normal_deviation: wp.array(dtype=float),
        # out
        light_changes: wp.array3d(dtype=wp.uint64),
    ):
        """Sets bit n of a pixel [intervals E, h, w] where other lamps shine on its surface at the end of part n of a
        coarse interval than at its beginning, or where ln of the irradiance turns at its end, under lamps that move.

        Where an environment has no parts none is set. Of several parts that shadows are looked for at both ends of,
        those at these ends stand for all. span: pixels of a thread.
        normal_deviation: of Facets. start: z-buffer of keyframe A.
        """
        n, row, part = wp.tid()
        env = n % params.envs
        if scene.held[env] == 1:
            return
        y = row0 + row
        parts = parts_of(scene, env)
        casts = scene.parts[0, env]
        every = parts // wp.max(casts, 1)
        sections = sections_of(scene, env)
        each = probe_spacing(params, scene, env)
        wide = (params.slots + 1) // wp.max(casts, 1)
        for x in range(part * span, wp.min(part * span + span, params.width)):
            px = pixel_interval_at(view, params, env, params.first + n // params.envs, y, x)
            ends = end_entries_of(params, scene, px)
            facets = wp.int32(0)
            if wp.static(changes.facets):
                if scene.parts[1, env] > 0:
                    facets = facets_between(params, scene, change, normal_deviation, px, ends.before, ends.after)
            bits = wp.uint64(0)
            known = wp.bool(False)
            last = wp.uint64(0)
            hidden = NOTHING
            facing = wp.bool(False)
            seen = wp.uint64(0)
            turned = NOTHING
            asked = wp.int32(MISS)
            flag = wp.int32(0)
            shone = LogIrradiance()
            followed = wp.bool(False)
            step = wp.where(facets == 0, every, 1)
            k = wp.where(parts == 0 or (casts == 0 and facets == 0), parts + 1, 0)
            before = ends.before
            after = probe_entry(params, scene, px, each, ends.after)
            following = each
            while k <= parts:
                i = part_at(params, parts, k)
                while following <= i:
                    following += each
                    before = after
                    after = probe_entry(params, scene, px, following, ends.after)
                cast = casts > 0 and k % every == 0
                look = wp.bool(False)
                if facets != 0:
                    look = ((facets >> (i * sections // (params.slots + 1))) & 1) == 1
                if cast or look:
                    there = slot_row(params, env, px.k, i)
                    hit = before
                    # Where both entries are equal neither the camera nor the surface moves.
                    still = hit == after
                    if not still:
                        hit = trace_between(view, scene.targets, there, px.d, hit, after, False)
                    t = triangle_of(hit)
                    if t != MISS and t != asked:
                        flag = change.flags[env, scene.targets.pieces[t][0]] & (MOVED | SHADED)
                        if flag != 0:
                            flag = narrow_flags(change, flag, env, there, change.instance[t], depth_of(hit) * px.d)
                        asked = t
                    if wp.static(changes.facets):
                        if look:
                            away = NOTHING
                            if t != MISS:
                                if normal_deviation[t] > 0.0 and (flag & MOVED) != 0:
                                    away = turned_lamps(change, there, hit, px.d)
                            if facing and away != turned and same_surface(seen, hit, scene.targets.pieces):
                                bits = bits | (ONE << wp.uint64(k - 1))
                            turned = away
                            seen = hit
                        facing = look and t != MISS
                    if cast:
                        now = NOTHING
                        if t != MISS and flag != 0:
                            now = hidden_lamps(change, flag, there, hit, px.d)
                        if known and now != hidden and same_surface(last, hit, scene.targets.pieces):
                            bits = bits | (ONE << wp.uint64(k - every)) | (ONE << wp.uint64(k - 1))
                        if wp.static(changes.lamps):
                            if t != MISS and (flag & MOVED) != 0:
                                s = point_of(change, change.casters, there, hit, depth_of(hit) * px.d)
                                e = log_irradiance(change, there, s)
                                if followed and same_surface(last, hit, scene.targets.pieces):
                                    shone, turned_at = log_irradiance_after(shone, e, k, params.jump)
                                    if turned_at > 0:
                                        bits = bits | (ONE << wp.uint64(turned_at - 1))
                                else:
                                    shone = log_irradiance_at(e, k)
                            followed = t != MISS and (flag & MOVED) != 0
                        known = t != MISS
                        hidden = now
                        last = hit
                    if still and flag == 0 and facets == 0:
                        # Nothing can change up to the next probe.
                        k = wp.max(k, (following - 1) // wide * every)
                else:
                    facing = False
                k += step
            light_changes[n, y, x] = bits

    return find_light_changes
