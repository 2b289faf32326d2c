"""Follows the point that a pixel sees over a surface by how fine that is painted: one that no keyframe shows, or whose
picture is finer than keyframes' pixels."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.paths.albedo_scale import ONE_COLOUR
from nodes.interpolator.refine.paths.motion_kernels import motion_since, stride_of
from nodes.interpolator.refine.samples.list_kernels import ListPart
from nodes.interpolator.refine.samples.request_kernels import PAINTED, UNKNOWN, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    Run,
    WindowParameters,
    WindowScene,
    entry_at,
    probe_spacing,
)
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_width, ray_steps

wp.set_module_options({"enable_backward": False})

PER_SWING = wp.constant(3.0)
"""Samples for each length over which a texture goes up or down: with 2 a wall whose texels are a pixel wide loses 10 %
of its events at 2 px a gap and 0.3 ms, with 3 7 %, and scenes take the same time."""
TURNED = wp.constant(0.25)
"""Way since the last sample, of that between two, after which there is one where a point turns back: what shakes shows
there how far it goes."""


@wp.func
def finer_than_pixels(view: CameraView, scene: WindowScene, px: PixelInterval, hit: wp.uint64):
    """Tells whether the triangle of a z-buffer entry is painted more finely than the pixels of an image show."""
    t = triangle_of(hit)
    if t == MISS:
        return False
    return scene.targets.albedo_scale[t] < pixel_width(view, px.x, px.y, depth_of(hit))


@wp.func
def pixels_along(view: CameraView, px: PixelInterval, away: float, step: wp.vec3):
    """Computes how many pixels wide a step [m] in the camera's frame appears, from where a pixel sees something.

    away: of that, in multiples of `px.d`. What is along the ray does not count, so that a surface which is seen
    obliquely has long pixels.
    """
    across, down = ray_steps(view, px.x, px.y)
    normal = wp.cross(across, down)
    u = wp.dot(step, wp.cross(down, px.d))
    v = wp.dot(step, wp.cross(px.d, across))
    return wp.sqrt(u * u + v * v) / wp.max(away * wp.abs(wp.dot(normal, px.d)), 1.0e-30)


@cache
def make_request_albedo_path(channels: int, waveform_count: int) -> Any:
    """Makes the function `request_albedo_path`; arguments as of make_look_up."""
    pixel = pixel_type(channels)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    request = make_request(channels)

    @wp.func
    def request_albedo_path(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        requests: Requests,
        px: PixelInterval,
        run: Run,
        out: ListPart,
    ):
        """Lists the instants of a run between which a pixel goes over part of a swing of what is painted on the
        surface, and by `params.spacing` at least, and those at which it turns back.

        Gives the index of the last entry listed, and PAINTED, or UNKNOWN where it goes nowhere.
        """
        last = run.last
        body = scene.targets.pieces[triangle_of(run.before)][0]
        each = probe_spacing(params, scene, px.env)
        if triangle_of(run.before) == triangle_of(run.after):
            # One triangle is painted alike: what goes straight is not looked at on the way.
            each = stride_of(params, scene, px, 0, body, depth_of(run.before))
        listed = run.start
        moved = wp.bool(False)
        gone = wp.float32(0.0)
        i = run.start
        hit = run.before
        # Points of one body keep their distances in the frame of keyframe A's camera.
        motion = motion_since(params, scene, keys.motions, px.env, px.k, 0, i, body)
        point = depth_of(hit) * px.d
        here = point + motion.turn * point + motion.shift
        heading = wp.vec3(0.0)
        while i < run.end:
            following = wp.min(run.end, (i | (each - 1)) + 1)
            seen = run.after
            if following < run.end:
                seen = entry_at(params, scene, px, following)
            motion = motion_since(params, scene, keys.motions, px.env, px.k, 0, following, body)
            point = depth_of(seen) * px.d
            there = point + motion.turn * point + motion.shift
            step = there - here
            way = wp.length(step)
            wide = pixels_along(view, px, depth_of(seen), step + wp.transpose(motion.turn) * step)
            albedo_scale = wp.min(
                scene.targets.albedo_scale[triangle_of(hit)], scene.targets.albedo_scale[triangle_of(seen)]
            )
            # Pixels are long on what is seen obliquely: by that alone tunnel_exit has 0.048 in place of 0.034.
            narrow = wp.min(way / wp.max(wide, 1.0e-30), pixel_width(view, px.x, px.y, depth_of(seen)))
            spacing = wp.max(albedo_scale / PER_SWING, params.spacing * narrow)
            moved = moved or (albedo_scale < ONE_COLOUR and gone + way > TURNED * spacing)
            if albedo_scale < ONE_COLOUR and i > listed and gone > TURNED * spacing and wp.dot(step, heading) < 0.0:
                last = request(params, requests, px, i, hit, hit, pixel(PAINTED), last, out)
                listed = i
                gone = 0.0
            if albedo_scale < ONE_COLOUR and gone + way >= spacing:
                to_next = wp.max(spacing - gone, 0.0)
                pace = float(following - i) / way
                while to_next < way:
                    place = i + int(to_next * pace)
                    if place > listed and place < run.end:
                        last = request(params, requests, px, place, hit, seen, pixel(PAINTED), last, out)
                        listed = place
                    gone = way - to_next
                    to_next += wp.max(spacing, way / float(following - i))
            else:
                gone += way
            heading = step
            here = there
            hit = seen
            i = following
        rise = pixel(UNKNOWN)
        if moved:
            rise = pixel(PAINTED)
        return last, rise

    return request_albedo_path
