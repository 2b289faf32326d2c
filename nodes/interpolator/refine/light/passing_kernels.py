"""Finds when lamps stop to shine on what pixels see, and begin to, between two frames: for something comes between, or
for the next facet is turned otherwise."""

from functools import cache

import warp as wp

from nodes.interpolator.refine.evaluation.sight_kernels import make_seen_between
from nodes.interpolator.refine.stage_kernels import (
    FEW_REGISTERS,
    Cut,
    Spot,
    Stage,
    ends_of,
    entry_at,
    parts_of,
    slot_row,
    spot_at,
)
from nodes.interpolator.relight.change_kernels import MOVED, SHADED, Change, make_narrowed, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.lights.light_kernels import AREA, SPOT, make_directions
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.shadows.ray_kernels import LIFT, make_occlusion

wp.set_module_options({"enable_backward": False})

NOTHING = wp.constant(wp.uint64(0))
ONE = wp.constant(wp.uint64(1))
SECTIONS = wp.constant(4)
"""Parts of a coarse interval at whose ends it is looked whether a pixel sees facets that may turn, at most: few do."""


@wp.func
def key_of(lamp: int):
    """Gives a number to a lamp, by SplitMix64 (Steele et al. 2014, fig. 16).

    Sets of lamps whose keys' sums are equal are the same set, but for one pair in 2^64.
    """
    z = wp.uint64(lamp + 1) * wp.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return z ^ (z >> wp.uint64(31))


@wp.func
def part_at(cut: Cut, parts: int, n: int):
    """Gives the instant at which part n of `parts` of a coarse interval begins, of those that lie within it."""
    return wp.clamp(n * ((cut.slots + 1) // parts), 1, cut.slots)


@cache
def make_find_passing(changes: LightChanges, trees: bool) -> wp.Kernel:
    """Makes the kernel `find_passing`; changes: of light in the scene; trees: as of `make_occlusion`."""
    towards, _ = make_directions(changes.directional, changes.point or changes.area, changes.spot)
    occluded, _ = make_occlusion(trees, False)
    seen_between = make_seen_between(False)
    narrowed = make_narrowed(changes)

    @wp.func
    def between_probes(cut: Cut, stage: Stage, spot: Spot, i: int, start: wp.uint64, end: wp.uint64):
        """Gives the z-buffer entries of the probes before and after instant i; start, end: of the coarse interval."""
        each = (cut.slots + 1) // stage.probes[spot.env]
        before = start
        after = end
        probe = i // each * each
        if probe > 0:
            before = entry_at(cut, stage, spot, probe)
        if probe + each <= cut.slots:
            after = entry_at(cut, stage, spot, probe + each)
        return before, after

    @wp.func
    def hidden_lamps(change: Change, flag: int, row: int, hit: wp.uint64, d: wp.vec3):
        """Gives the sum of the keys of lamps that something may move before and that are hidden from what a ray sees,
        and of spots whose beam passes by it. Of area lights the corners have keys of their own, since a shadow that is
        narrower than the light comes and goes between them. flag: of `narrowed`."""
        keys = NOTHING
        s = point_of(change, change.casters, row, hit, depth_of(hit) * d)
        casters = change.casters
        origin = s.position + (LIFT * (wp.length(s.position) + casters.radius[s.instance])) * s.normal
        first = wp.where((flag & MOVED) != 0, 0, casters.still)
        for l in range(change.now.kind.shape[0]):
            if change.now.shadow[l] == 1 or change.now.kind[l] == SPOT:
                ray, length, strength = towards(change.now, row, l, s.position)
                if wp.dot(s.normal, ray) > 0.0:
                    away = wp.bool(strength <= 0.0)
                    if not away and change.now.shadow[l] == 1:
                        away = occluded(casters, row, first, casters.order.shape[0], s.skip, origin, ray, length)
                    if away:
                        keys += key_of(l)
                    if wp.static(changes.area):
                        if change.now.kind[l] == AREA and change.now.shadow[l] == 1:
                            for corner in range(1, 5):
                                u = wp.where(corner < 3, -1.0, 1.0) * change.now.half_u[row, l]
                                v = wp.where(corner % 2 == 0, -1.0, 1.0) * change.now.half_v[row, l]
                                way = length * ray + u + v
                                far = wp.length(way)
                                if occluded(
                                    casters, row, first, casters.order.shape[0], s.skip, origin, way / far, far
                                ):
                                    keys += key_of(corner * change.now.kind.shape[0] + l)
        return keys

    @wp.func
    def turned_lamps(change: Change, row: int, hit: wp.uint64, d: wp.vec3):
        """Gives the sum of the keys of lamps that the triangle that a ray sees is turned away from."""
        keys = NOTHING
        s = point_of(change, change.casters, row, hit, depth_of(hit) * d)
        for l in range(change.now.kind.shape[0]):
            ray, _length, _strength = towards(change.now, row, l, s.position)
            if wp.dot(s.normal, ray) <= 0.0:
                keys += key_of(l)
        return keys

    @wp.func
    def may_turn(
        cut: Cut,
        stage: Stage,
        change: Change,
        lean: wp.array(dtype=float),
        spot: Spot,
        i: int,
        hit: wp.uint64,
    ):
        """Tells whether a pixel sees a facet at instant i that a lamp shines along so nearly that the next one may be
        turned to it otherwise."""
        near = wp.bool(False)
        t = triangle_of(hit)
        if t != MISS:
            if lean[t] > 0.0 and (change.flags[spot.env, stage.targets.pieces[t][0]] & MOVED) != 0:
                row = slot_row(cut, spot.env, spot.k, wp.clamp(i, 1, cut.slots))
                s = point_of(change, change.casters, row, hit, depth_of(hit) * spot.d)
                for l in range(change.now.kind.shape[0]):
                    ray, _length, strength = towards(change.now, row, l, s.position)
                    if strength > 0.0 and wp.abs(wp.dot(s.normal, ray)) < lean[t]:
                        near = True
        return near

    @wp.func
    def sections_of(stage: Stage, env: int):
        """Gives how many sections a coarse interval has, between some of its probes."""
        return wp.min(stage.probes[env], SECTIONS)

    @wp.func
    def facets_between(
        cut: Cut,
        stage: Stage,
        change: Change,
        lean: wp.array(dtype=float),
        spot: Spot,
        start: wp.uint64,
        end: wp.uint64,
    ):
        """Tells in which sections of a coarse interval a pixel may see facets turn, a bit for each; start, end: entries
        of z-buffers at its ends."""
        count = sections_of(stage, spot.env)
        each = (cut.slots + 1) // count
        bits = wp.int32(0)
        before = wp.bool(False)
        for n in range(count + 1):
            hit = start
            if n == count:
                hit = end
            elif n > 0:
                hit = entry_at(cut, stage, spot, n * each)
            after = may_turn(cut, stage, change, lean, spot, n * each, hit)
            if n > 0 and (before or after):
                bits = bits | (1 << (n - 1))
            before = after
        return bits

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_passing(
        # in
        view: CameraView,
        cut: Cut,
        row0: int,
        span: int,
        held: wp.array(dtype=int),
        stage: Stage,
        change: Change,
        lean: wp.array(dtype=float),
        start: wp.array3d(dtype=wp.uint64),
        # out
        passing: wp.array3d(dtype=wp.uint64),
    ):
        """Sets bit n of a pixel [intervals E, h, w] where other lamps shine on its surface at the end of part n of a
        coarse interval than at its beginning.

        Where an environment has no parts none is set. Of several parts that shadows are looked for at both ends of,
        those at these ends stand for all. span: pixels of a thread. held: 1 for environments that have no gap. lean: of
        Facets. start: z-buffer of keyframe A.
        """
        n, row, part = wp.tid()
        env = n % cut.envs
        if held[env] == 1:
            return
        y = row0 + row
        parts = parts_of(stage, env)
        casts = stage.parts[0, env]
        every = parts // wp.max(casts, 1)
        sections = sections_of(stage, env)
        for x in range(part * span, wp.min(part * span + span, cut.width)):
            spot = spot_at(view, cut, env, cut.first + n // cut.envs, y, x)
            ends = ends_of(cut, stage, start, spot)
            facets = wp.int32(0)
            if wp.static(changes.facets):
                if stage.parts[1, env] > 0:
                    facets = facets_between(cut, stage, change, lean, spot, ends.before, ends.after)
            bits = wp.uint64(0)
            known = wp.bool(False)
            last = wp.uint64(0)
            hidden = NOTHING
            facing = wp.bool(False)
            seen = wp.uint64(0)
            turned = NOTHING
            asked = wp.int32(MISS)
            flag = wp.int32(0)
            step = wp.where(facets == 0, every, 1)
            k = wp.where(parts == 0 or (casts == 0 and facets == 0), parts + 1, 0)
            while k <= parts:
                i = part_at(cut, parts, k)
                cast = casts > 0 and k % every == 0
                look = ((facets >> (i * sections // (cut.slots + 1))) & 1) == 1
                if cast or look:
                    there = slot_row(cut, env, spot.k, i)
                    hit, after = between_probes(cut, stage, spot, i, ends.before, ends.after)
                    # Where both entries are equal neither the camera nor the surface moves.
                    if hit != after:
                        hit = seen_between(view, stage.targets, there, spot.d, hit, after, False)
                    t = triangle_of(hit)
                    if t != MISS and t != asked:
                        flag = change.flags[env, stage.targets.pieces[t][0]] & (MOVED | SHADED)
                        if flag != 0:
                            flag = narrowed(change, flag, env, there, change.instance[t], depth_of(hit) * spot.d)
                        asked = t
                    if wp.static(changes.facets):
                        if look:
                            away = NOTHING
                            if t != MISS:
                                if lean[t] > 0.0 and (flag & MOVED) != 0:
                                    away = turned_lamps(change, there, hit, spot.d)
                            if facing and away != turned and joined(seen, hit, stage.targets.pieces):
                                bits = bits | (ONE << wp.uint64(k - 1))
                            turned = away
                            seen = hit
                        facing = look and t != MISS
                    if cast:
                        now = NOTHING
                        if t != MISS and flag != 0:
                            now = hidden_lamps(change, flag, there, hit, spot.d)
                        if known and now != hidden and joined(last, hit, stage.targets.pieces):
                            bits = bits | (ONE << wp.uint64(k - every)) | (ONE << wp.uint64(k - 1))
                        known = t != MISS
                        hidden = now
                        last = hit
                else:
                    facing = False
                k += step
            passing[n, y, x] = bits

    return find_passing
