"""Lists samples along one run of a surface: from one mark to the next; and tells whether frames determine all between
them."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.light.flicker_kernels import Marks, entry_near, marks_of
from nodes.interpolator.refine.light.light_visibility_kernels import part_at
from nodes.interpolator.refine.paths.albedo_path_kernels import finer_than_pixels, make_follow
from nodes.interpolator.refine.paths.keyframe_path_kernels import make_walk
from nodes.interpolator.refine.samples.request_kernels import UNKNOWN, make_instances, make_note
from nodes.interpolator.refine.window_kernels import Cut, Ends, Spot, Stage, parts_of, slot_row
from nodes.interpolator.relight.change_kernels import Change, make_asked
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_through(lens: str, channels: int, ways: int, relit: bool, painted: bool, changes: LightChanges) -> Any:
    """Makes the function `through`, which lists the samples of a run; arguments as of make_find_plain."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    walk, note = make_walk(lens, channels, ways), make_note(channels)
    follow = make_follow(channels, ways) if painted else None

    @wp.func
    def go(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        stage: Stage,
        instances: Instances,
        spot: Spot,
        start: int,
        end: int,
        before: wp.uint64,
        after: wp.uint64,
        last: int,
        room: int,
        most: int,
        band: int,
        count: wp.array(dtype=int),
    ):
        """Does as `walk` does, in the nearer keyframe, or in the other one where that does not show the way, and goes
        by what is painted on the surface where none does, or that is finer than their pixels."""
        nearer = wp.where(2 * spot.k >= cut.coarse and spot.k > 0, 1, 0)
        new = last
        rise = pixel(UNKNOWN)
        whole = wp.bool(False)
        tries = wp.int32(0)
        if wp.static(follow is not None):
            if finer_than_pixels(view, stage, spot, before):
                tries = wp.int32(2)
        while tries < 2 and not whole and new == last and (tries == 0 or spot.k + start > 0):
            which = wp.where(tries == 0, nearer, 1 - nearer)
            new, rise, whole = walk(
                view, cut, keys, stage, instances, spot, which, start, end, before, after, last, room, most, band, count
            )
            tries += 1
        if wp.static(follow is not None):
            if not whole and triangle_of(before) != MISS:
                begun = start
                seen = before
                if new != last:
                    begun = instances.at[new] // (cut.envs * cut.height * cut.width) % cut.slots + 1
                    seen = entry_near(cut, stage, spot, begun, start, before)
                new, rise = follow(
                    view, cut, keys, stage, instances, spot, begun, end, seen, after, new, room, most, band, count
                )
        return new, rise, whole

    @wp.func
    def through(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        stage: Stage,
        instances: Instances,
        marks: Marks,
        spot: Spot,
        start: int,
        end: int,
        before: wp.uint64,
        after: wp.uint64,
        last: int,
        room: int,
        most: int,
        band: int,
        count: wp.array(dtype=int),
    ):
        """Does as `go` does, from one mark to the next where lights flicker, and from one shadow's edge to the next."""
        begun = start
        seen = before
        marked = wp.int32(0)
        first = wp.int32(0)
        if wp.static(ways > 0 or relit):
            first, past = marks_of(marks, spot)
            marked = past - first
        edges = wp.int32(0)
        parts = wp.int32(1)
        bits = wp.uint64(0)
        if wp.static(changes.changes_lamps):
            if cut.parts > 0:
                bits = stage.passing[
                    (spot.k - cut.first) * cut.envs + spot.env, spot.y - cut.margin, spot.x - cut.margin
                ]
                if bits != wp.uint64(0):
                    parts = parts_of(stage, spot.env)
                    edges = 2 * parts
        rise = pixel(UNKNOWN)
        whole = wp.bool(False)
        # All by the same code: a GPU's cache of instructions would not hold copies of it.
        for n in range(marked + edges + 1):
            i = end
            later = wp.int32(0)
            inside = wp.bool(False)
            if n < marked:
                i = marks.at[first + n]
                later = marks.later[first + n]
                inside = i > start and i < end
            elif n < marked + edges:
                # Lamps are hidden or seen again between the two ends of a part.
                m = n - marked
                i = part_at(cut, parts, (m + 1) // 2)
                inside = ((bits >> wp.uint64(m // 2)) & wp.uint64(1)) != wp.uint64(0) and i > begun and i < end
            if inside or n == marked + edges:
                hit = after
                if inside:
                    hit = entry_near(cut, stage, spot, i, begun, seen)
                last, rise, whole = go(
                    view, cut, keys, stage, instances, spot, begun, i, seen, hit, last, room, most, band, count
                )
                if inside:
                    last = note(cut, instances, spot, i, hit, hit, rise, last, room, most, band, count)
                    instances.later[last] = later
                    begun = i
                    seen = hit
        return last, rise, whole

    return through


@cache
def make_relit_between(changes: LightChanges) -> Any:
    """Makes the function `relit_between`; changes: of light in the scene."""
    asked = make_asked(changes) if changes.any else None

    @wp.func
    def relit_between(cut: Cut, stage: Stage, change: Change, spot: Spot, i: int, hit: wp.uint64):
        """Tells whether light on what a pixel shows at instant i may change in the gap, beside lamps that flicker."""
        if wp.static(asked is not None):
            t = triangle_of(hit)
            if t != MISS:
                body = stage.targets.pieces[t][0]
                row = slot_row(cut, spot.env, spot.k, i)
                to_a = stage.shift[row, body]
                to_b = stage.shift[row + stage.shift.shape[0] // 2, body]
                return asked(change, body, spot.env, row, hit, depth_of(hit) * spot.d, to_a, to_b) != 0
        return False

    return relit_between


@cache
def make_untold(channels: int, changes: LightChanges) -> Any:
    """Makes the function `untold`, which tells of light that frames do not show; arguments as of make_find_plain."""
    # What light does otherwise goes on evenly, as far as frames tell.
    passing = changes.shadows or changes.spot or changes.view
    relit_between = make_relit_between(changes)
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    @wp.func
    def untold(
        cut: Cut,
        stage: Stage,
        change: Change,
        spot: Spot,
        ends: Ends,
        rise: pixel,
        grown: pixel,
        whole: bool,
    ):
        """Tells whether a pixel that shows one surface and has no sample has to be looked at halfway.

        So it is where ln I has grown otherwise than it rises in the keyframes, or light may have come and gone. whole:
        they show all of it.
        """
        if apart(grown, pixel(0.0)) > cut.jump and (not whole or apart(rise, grown) > cut.bend):
            return True
        if wp.static(passing):
            # A shadow or a highlight may have come and gone: frames alone do not tell.
            return relit_between(cut, stage, change, spot, (cut.slots + 1) // 2, ends.before)
        return False

    return untold
