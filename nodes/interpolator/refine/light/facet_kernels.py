"""Finds when a pixel may see facets of what is shaded round that turn away from a lamp one after the other."""

from functools import cache

import warp as wp

from nodes.interpolator.refine.window_kernels import PixelInterval, WindowParameters, WindowScene, entry_at, slot_row
from nodes.interpolator.relight.change_kernels import MOVED, Change, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.renderer.lights.light_kernels import make_light_directions
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})

SECTIONS = wp.constant(4)
"""Parts of a coarse interval at whose ends it is looked whether a pixel sees facets that may turn, at most: few do."""


@wp.func
def sections_of(scene: WindowScene, env: int):
    """Gives how many sections a coarse interval has, between some of its probes."""
    return wp.min(scene.probes[env], SECTIONS)


@cache
def make_facets_between(changes: LightChanges) -> wp.Function:
    """Makes `facets_between`; changes: of light in the scene."""
    light_direction, _ = make_light_directions(changes.directional, changes.point or changes.area, changes.spot)

    @wp.func
    def may_turn(
        params: WindowParameters,
        scene: WindowScene,
        change: Change,
        normal_deviation: wp.array(dtype=float),
        px: PixelInterval,
        i: int,
        hit: wp.uint64,
    ):
        """Tells whether a pixel sees a facet at instant i that a lamp shines along so nearly that the next one may be
        turned to it otherwise."""
        near = wp.bool(False)
        t = triangle_of(hit)
        if t != MISS:
            if normal_deviation[t] > 0.0 and (change.flags[px.env, scene.targets.pieces[t][0]] & MOVED) != 0:
                row = slot_row(params, px.env, px.k, wp.clamp(i, 1, params.slots))
                s = point_of(change, change.casters, row, hit, depth_of(hit) * px.d)
                for l in range(change.now.kind.shape[0]):
                    ray, _length, strength = light_direction(change.now, row, l, s.position)
                    if strength > 0.0 and wp.abs(wp.dot(s.normal, ray)) < normal_deviation[t]:
                        near = True
        return near

    @wp.func
    def facets_between(
        params: WindowParameters,
        scene: WindowScene,
        change: Change,
        normal_deviation: wp.array(dtype=float),
        px: PixelInterval,
        start: wp.uint64,
        end: wp.uint64,
    ):
        """Tells in which sections of a coarse interval a pixel may see facets turn, a bit for each; start, end: entries
        of z-buffers at its ends."""
        count = sections_of(scene, px.env)
        each = (params.slots + 1) // count
        bits = wp.int32(0)
        before = wp.bool(False)
        for n in range(count + 1):
            hit = start
            if n == count:
                hit = end
            elif n > 0:
                hit = entry_at(params, scene, px, n * each)
            after = may_turn(params, scene, change, normal_deviation, px, n * each, hit)
            if n > 0 and (before or after):
                bits = bits | (1 << (n - 1))
            before = after
        return bits

    return facets_between
