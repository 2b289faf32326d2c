"""Finds which lamps do not light what a pixel sees, as a sum of keys that differs between two instants if the lamps do,
and when the irradiance from them passes a peak."""

from functools import cache

import warp as wp

from evis.random_number_kernels import GOLDEN, mix
from nodes.interpolator.relight.change_kernels import MOVED, Change, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.renderer.lights.light_kernels import AREA, SPOT, make_light_directions
from nodes.renderer.raster.depth_kernels import depth_of
from nodes.renderer.shadows.ray_kernels import LIFT, make_occlusion

wp.set_module_options({"enable_backward": False})

NOTHING = wp.constant(wp.uint64(0))


@wp.struct
class LogIrradiance:
    """Holds how ln of the irradiance on a surface goes: since part `at` of an interval it goes up (way 1) or down (-1),
    or has not yet gone as far as to tell (0)."""

    low: float
    """The least since its last turn."""
    high: float
    """The most since then."""
    at: int
    way: int


@wp.func
def log_irradiance_at(e: float, part: int):
    """Makes the LogIrradiance of an interval that has been followed up to one part alone; e: ln of the irradiance."""
    begun = LogIrradiance()
    begun.low = e
    begun.high = e
    begun.at = part
    begun.way = 0
    return begun


@wp.func
def log_irradiance_after(before: LogIrradiance, e: float, part: int, jump: float):
    """Updates a LogIrradiance by ln of the irradiance `e` at a later part; gives also at which part it turned, or 0.

    jump: how far it goes the other way for a turn to count.
    """
    now = log_irradiance_at(e, part)
    now.way = before.way
    further = (e > before.high and before.way >= 0) or (e < before.low and before.way <= 0)
    peak = wp.where(further, part, before.at)
    low = wp.min(before.low, e)
    high = wp.max(before.high, e)
    if before.way != 0 and wp.where(before.way > 0, high - e, e - low) > jump:
        now.way = -before.way
        return now, peak
    now.low = low
    now.high = high
    now.at = peak
    if before.way == 0 and high - low > jump:
        now.way = wp.where(e == high, 1, -1)
    return now, 0


@wp.func
def key_of(lamp: int):
    """Gives a number to a lamp, by SplitMix64.

    Sets of lamps whose keys' sums are equal are the same set, but for one pair in 2^64.
    """
    return mix(wp.uint64(lamp + 1) * GOLDEN)


@cache
def make_hidden_lamps(changes: LightChanges, trees: bool) -> wp.Function:
    """Makes `hidden_lamps`; changes: of light in the scene; trees: as of `make_occlusion`."""
    light_direction, _ = make_light_directions(changes.directional, changes.point or changes.area, changes.spot)
    occluded, _ = make_occlusion(trees, False)

    @wp.func
    def hidden_lamps(change: Change, flag: int, row: int, hit: wp.uint64, d: wp.vec3):
        """Gives the sum of the keys of lamps that something may move before and that are hidden from what a ray sees,
        and of spots whose beam passes by it. Of area lights the corners have keys of their own, since a shadow that is
        narrower than the light comes and goes between them. flag: of `narrow_flags`."""
        keys = NOTHING
        s = point_of(change, change.casters, row, hit, depth_of(hit) * d)
        casters = change.casters
        origin = s.position + (LIFT * (wp.length(s.position) + casters.radius[s.instance])) * s.normal
        first = wp.where((flag & MOVED) != 0, 0, casters.still)
        for l in range(change.now.kind.shape[0]):
            if change.now.shadow[l] == 1 or change.now.kind[l] == SPOT:
                ray, length, strength = light_direction(change.now, row, l, s.position)
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

    return hidden_lamps


@cache
def make_turned_lamps(changes: LightChanges) -> wp.Function:
    """Makes `turned_lamps`; changes: of light in the scene."""
    light_direction, _ = make_light_directions(changes.directional, changes.point or changes.area, changes.spot)

    @wp.func
    def turned_lamps(change: Change, row: int, hit: wp.uint64, d: wp.vec3):
        """Gives the sum of the keys of lamps that the triangle that a ray sees is turned away from."""
        keys = NOTHING
        s = point_of(change, change.casters, row, hit, depth_of(hit) * d)
        for l in range(change.now.kind.shape[0]):
            ray, _length, _strength = light_direction(change.now, row, l, s.position)
            if wp.dot(s.normal, ray) <= 0.0:
                keys += key_of(l)
        return keys

    return turned_lamps
