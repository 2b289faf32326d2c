"""Decides which pixels are looked up at which sub-frames, and which are drawn between two of their own samples.

A sample is spared where the pixel shows the same piece of surface from the sample before it to the one after it, has
moved over it by no more than `step` pixels, and both samples are alike but for a small difference: the frames between
them are then on a straight line. How far it has moved is the length of its path, bounded from above by how far its body
has turned and gone, so that a body which shakes, bounces or turns several times between two samples is not missed.
"""

from functools import cache

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.line_kernels import LightState, make_light_state
from nodes.interpolator.rigid.body_motion_kernels import BodyMotion
from nodes.interpolator.rigid.look_up.look_up_kernels import SAME_SHEET
from nodes.interpolator.rigid.patch_kernels import patch_of
from nodes.renderer.raster.depth_kernels import MISS, depth_of, face_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

KEYFRAME = wp.constant(wp.uint8(0))
"""What a pixel is at a sub-frame: as it is in keyframe B."""
SAMPLE = wp.constant(wp.uint8(1))
BETWEEN = wp.constant(wp.uint8(2))
"""On the line between two samples."""
ANEW = wp.constant(wp.uint8(3))
"""A sample that is shaded at its own time, for something may come between it and a light."""
NONE = wp.constant(-2)
"""No triangle, and not the sky either."""
MOST_SKIPPED = wp.constant(7.0)
"""Samples that are taken of a pixel without looking at how fast it is."""
SHORT = wp.constant(4)
"""Length of a span up to which all of it is sampled if it is no line: fewer rounds, and hardly more samples."""
LENGTHS = wp.constant(8192)
"""A span is (pixel, start LENGTHS + length): sub-frames start and start + length are known, those between are not."""


@wp.struct
class PlannedRange:
    """Holds a portion's sub-frames start0 + 1 .. start0 + count, in slots slot0.. of `packed` [P E, H, W].

    before [E, H, W]: z-buffer of sub-frame start0; after: that of B, with which the portion ends where closed = 1.
    unchanged [E, H, W]: entries with which nothing has changed. row_b: first row of B among the keyframes. step: path
    [px] up to which samples are spared; 0 = none. gain: pixels per radian of a lens, at most. pieces: body and front's
    patch of each triangle.
    """

    count: int
    closed: int
    slot0: int
    start0: int
    envs: int
    upsampling: int
    row_b: int
    step: float
    gain: float
    before: wp.array3d(dtype=wp.uint64)
    packed: wp.array3d(dtype=wp.uint64)
    after: wp.array3d(dtype=wp.uint64)
    unchanged: wp.array3d(dtype=wp.uint64)
    pieces: wp.array(dtype=wp.vec2i)
    motion: BodyMotion


@wp.struct
class PlanPart:
    """Holds what a band does: entries first .. last - 1 of a list, with the samples that it plans from todo0 on and the
    spans from spans0 on."""

    first: int
    last: int
    band: int
    todo0: int
    spans0: int


@wp.struct
class PlanLists:
    """Holds what is planned: samples `todo` as indices into [count, E, h, w], spans, and how many each band has of
    them, from its PlanPart's places on."""

    todo: wp.array(dtype=int)
    todo_count: wp.array(dtype=int)
    spans: wp.array(dtype=wp.vec2i)
    span_count: wp.array(dtype=int)


@wp.func
def same_surface(a: wp.uint64, b: wp.uint64, pieces: wp.array(dtype=wp.vec2i)):
    """Tells whether two hits of a pixel are on one side of one piece of surface."""
    if face_of(a) == face_of(b):
        return True
    t = triangle_of(a)
    u = triangle_of(b)
    if t == MISS or u == MISS or patch_of(a, pieces[t]) != patch_of(b, pieces[u]):
        return False
    return wp.abs(depth_of(a) - depth_of(b)) <= SAME_SHEET * depth_of(b)


@wp.func
def body_at(t: int, env: int, pieces: wp.array(dtype=wp.vec2i), motion: BodyMotion):
    """Gives the index under which `motion` has the body of a triangle."""
    if t == MISS:
        return motion.as_world.shape[1] - 1
    return motion.as_world[env, pieces[t][0]]


@wp.func
def flow(view: CameraView, gain: float, row: int, body: int, d: wp.vec3, away: float, motion: BodyMotion):
    """Computes by how many pixels the point at d has moved since the position before."""
    m = wp.cross(motion.spin[row, body], away * d) + motion.shift[row, body]
    if view.distorted == 1:
        return gain * wp.length(m - wp.dot(m, d) * d) / away
    u = view.fx * (m[0] - d[0] * m[2])
    v = view.fy * (m[1] - d[1] * m[2])
    return wp.sqrt(u * u + v * v) / away


@wp.func
def add_span(lists: PlanLists, part: PlanPart, pixel: int, start: int, length: int):
    """Lists a span of sub-frames of a pixel, between two samples, if there is anything between them."""
    if length > 1:
        place = part.spans0 + take_place(lists.span_count, part.band)
        lists.spans[place] = wp.vec2i(pixel, start * LENGTHS + length)


@cache
def make_plan(channels: int, changes: LightChanges) -> wp.Kernel:
    """Makes the kernel that plans at which sub-frames pixels are sampled. channels: 1 (luminance) or 3 (RGB). changes:
    of light in the scene."""
    pixel = pixel_type(channels)
    light_state_at, light_state_at_end = make_light_state(changes) if changes.any else (None, None)

    @wp.kernel(module="unique", enable_backward=False)
    def plan(
        # in
        view: CameraView,
        part: PlanPart,
        span: int,
        column0: int,
        given: PlannedRange,
        change: Change,
        active: wp.array(dtype=int),
        image: wp.array3d(dtype=pixel),
        # out
        codes: wp.array2d(dtype=wp.uint8),
        lists: PlanLists,
        frames: wp.array3d(dtype=pixel),
    ):
        """Plans the samples of pixels active[first .. last - 1], as indices into [E, h, w], `span` of them a thread.

        codes: scratch, [count] of columns from column0 on, which threads use one after the other.
        """
        width = view.width - 2 * view.margin
        height = view.height - 2 * view.margin
        tid = wp.tid()
        begin = part.first + tid * span
        end = wp.min(begin + span, part.last)
        column = column0 - begin
        for j in range(begin, end):
            at = active[j]
            x = at % width + view.margin
            y = at // width % height + view.margin
            env = at // (width * height)
            still = given.unchanged[env, y, x]
            d = pixel_ray(view, x, y)
            hit = given.before[env, y, x]
            # The last sub-frame that is known or to be a sample, and the path since.
            start = wp.int32(0)
            path = wp.float32(0.0)
            # Sub-frames that are samples without looking at how fast it is, for it has just been far too fast.
            skip = wp.int32(0)
            t = triangle_of(hit)
            body = body_at(t, env, given.pieces, given.motion)
            lit = LightState()
            bend = wp.float32(0.0)
            for k in range(1, given.count + given.closed + 1):
                now = given.after[env, y, x]
                known = wp.bool(True)
                if k <= given.count:
                    now = given.packed[(given.slot0 + k - 1) * given.envs + env, y, x]
                    known = now == still
                reaches = wp.bool(False)
                if skip > 0:
                    skip -= 1
                    t = wp.int32(NONE)
                    lit.known = 0
                    lit.hidden = False
                elif given.step > 0.0:
                    u = triangle_of(now)
                    if u != t:
                        body = body_at(u, env, given.pieces, given.motion)
                    if wp.static(changes.any):
                        row = (given.slot0 + wp.min(k, given.count) - 1) * given.envs + env
                        if k <= given.count:
                            lit = light_state_at(change, given.pieces, env, row, now, d, lit)
                        else:
                            lit = light_state_at_end(change, given.pieces, env, row, given.row_b + env, now, d, lit)
                        bend += lit.kink
                    if u == t or same_surface(hit, now, given.pieces):
                        far = flow(
                            view,
                            given.gain,
                            k * given.envs + env,
                            body,
                            d,
                            wp.where(u == MISS, 1.0, depth_of(now)),
                            given.motion,
                        )
                        path += far
                        reaches = path <= given.step
                        alone = far <= given.step
                        if wp.static(changes.any):
                            # A line over n sub-frames is off by no more than n / 4 of all its kinks.
                            reaches = reaches and not lit.jump and 0.25 * float(k - start) * bend <= change.bend
                            alone = alone and not lit.jump
                        if not reaches and start < k - 1 and alone:
                            # From the sub-frame before it does reach.
                            codes[k - 2, column + j] = SAMPLE
                            add_span(lists, part, at, given.start0 + start, k - 1 - start)
                            start = k - 1
                            path = far
                            bend = 0.0
                            reaches = wp.bool(True)
                        if far > given.step:
                            skip = int(wp.min(2.0 * far / given.step, MOST_SKIPPED))
                    t = u
                if start < k - 1 and not reaches:
                    codes[k - 2, column + j] = SAMPLE
                    add_span(lists, part, at, given.start0 + start, k - 1 - start)
                code = BETWEEN
                if known or not reaches:
                    if reaches:
                        add_span(lists, part, at, given.start0 + start, k - start)
                    code = wp.where(known, KEYFRAME, SAMPLE)
                    if wp.static(changes.any):
                        if lit.hidden and not known:
                            code = ANEW
                    start = k
                    path = 0.0
                    bend = 0.0
                if k <= given.count:
                    codes[k - 1, column + j] = code
                hit = now
            if given.closed == 0 and start < given.count:
                codes[given.count - 1, column + j] = SAMPLE
                add_span(lists, part, at, given.start0 + start, given.count - start)
        # Frame by frame, for the pixels of a row are looked up side by side.
        inner = given.envs * height * width
        for k in range(given.count):
            for j in range(begin, end):
                code = codes[k, column + j]
                at = active[j]
                if code == ANEW:
                    lists.todo[part.todo0 + take_place(lists.todo_count, part.band)] = -1 - (k * inner + at)
                elif code == SAMPLE:
                    lists.todo[part.todo0 + take_place(lists.todo_count, part.band)] = k * inner + at
                elif code == KEYFRAME:
                    env = at // (width * height)
                    y = at // width % height
                    frames[env * given.upsampling + given.start0 + k, y, at % width] = image[
                        env, y + view.margin, at % width + view.margin
                    ]

    return plan


@wp.func
def alike(a: wp.float32, b: wp.float32, ratio: float):
    """Tells whether two radiances differ by no more than a ratio; in RGB in every channel."""
    # Never so where one of them is not a number or infinite.
    return a <= ratio * b and b <= ratio * a and wp.isfinite(a)


@wp.func
def alike(a: wp.vec3, b: wp.vec3, ratio: float):  # noqa: F811 - overloaded by its type
    return alike(a[0], b[0], ratio) and alike(a[1], b[1], ratio) and alike(a[2], b[2], ratio)


@cache
def make_refine_plan(channels: int) -> wp.Kernel:
    """Makes the kernel that refines the plan where samples differ. channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def refine_plan(
        # in
        size: wp.vec2i,
        margin: int,
        part: PlanPart,
        ratio: float,
        given: PlannedRange,
        spans: wp.array(dtype=wp.vec2i),
        image: wp.array3d(dtype=pixel),
        # in or out
        frames: wp.array3d(dtype=pixel),
        # out
        lists: PlanLists,
    ):
        """Refines spans first .. last - 1, in one thread: a line where the ends differ by no more than `ratio`, else a
        sample in the middle, listed as by the plan, and two spans; of short ones all.

        size: (h, w). image: keyframe A with its margin, sub-frame 0.
        """
        width = size[1]
        inner = size[0] * width
        for j in range(part.first, part.last):
            at = spans[j][0]
            start = spans[j][1] // LENGTHS
            length = spans[j][1] % LENGTHS
            x = at % width
            y = at // width % size[0]
            env = at // inner
            base = env * given.upsampling - 1
            a = image[env, y + margin, x + margin]
            if start > 0:
                a = frames[base + start, y, x]
            b = frames[base + start + length, y, x]
            if alike(a, b, ratio):
                for k in range(1, length):
                    frames[base + start + k, y, x] = a + float(k) / float(length) * (b - a)
            else:
                # From the sub-frame in the middle, or from the first one on.
                middle = length // 2
                until = middle + 1
                if length <= SHORT:
                    middle = 1
                    until = length
                else:
                    add_span(lists, part, at, start, middle)
                    add_span(lists, part, at, start + middle, length - middle)
                while middle < until:
                    lists.todo[part.todo0 + take_place(lists.todo_count, part.band)] = (
                        start + middle - given.start0 - 1
                    ) * given.envs * inner + at
                    middle += 1

    return refine_plan
