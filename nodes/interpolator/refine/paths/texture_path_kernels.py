"""Follows the point that a pixel sees over a texture that is finer than keyframes' pixels, and finds where ln I bends:
the texture is looked up itself, and a keyframe tells of the light on it."""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709
from nodes.interpolator.refine.evaluation.visibility_kernels import Targets
from nodes.interpolator.refine.paths.keyframe_path_kernels import STEEPEST, entries_about, outside
from nodes.interpolator.refine.paths.keyframe_point_kernels import make_point_look_up
from nodes.interpolator.refine.paths.motion_kernels import motion_since, stride_of
from nodes.interpolator.refine.samples.list_kernels import ListPart
from nodes.interpolator.refine.samples.request_kernels import UNKNOWN, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    Run,
    WindowParameters,
    WindowScene,
    entry_at,
    probe_spacing,
    slot_row,
)
from nodes.interpolator.rigid.look_up.look_up_kernels import is_demodulated, make_keyframes
from nodes.interpolator.rigid.patch_kernels import patch_of
from nodes.renderer.raster.depth_kernels import depth_of, triangle_of
from nodes.renderer.raster.lens.displacement_kernels import make_displacement
from nodes.renderer.raster.lens.view_kernels import CameraView, ray_steps
from nodes.renderer.raster.surface_kernels import Surfaces
from nodes.renderer.raster.triangle_kernels import corners_of
from nodes.renderer.textures.texture_kernels import Filter, filter_of, filtered_by

wp.set_module_options({"enable_backward": False})

WEIGHTS = wp.constant(wp.vec3(*REC709))
DARKEST = wp.constant(1.0e-3)
"""Albedo below which differences do not matter."""
LONGEST, SHORTEST = wp.constant(5.0 / 6.0), wp.constant(1.0 / 3.0)
"""Ways from one look at a texture to the next, of `params.spacing`: where ln I hardly changes, and where it does."""
STEEP = wp.constant(1.25)
"""Change of ln I from one look to the next, of `straight`, above which they are closer."""
BENT = wp.constant(0.25)
"""Distance of ln I from a straight line, of `straight`, up to which it counts as none."""
ALIKE = wp.constant(4)
"""Parts of a coarse interval in each of which the footprint of a pixel counts as the same."""


@wp.struct
class TexturedPlane:
    """Holds how a texture lies on the plane of a triangle, in the camera frame of a keyframe.

    texture: as of Textures.place. weights: of the texels' channels in the luminance of the albedo. origin: a point of
    the plane; uv: there. normal: of any length. along_u, along_v: gradients of u and v [1/m].
    """

    texture: wp.vec2i
    weights: wp.vec3
    origin: wp.vec3
    uv: wp.vec2
    normal: wp.vec3
    along_u: wp.vec3
    along_v: wp.vec3


@wp.struct
class TexturePlace:
    """Holds where on a textured plane a pixel looks at an instant.

    uv: on the texture. x, y [px]: where the keyframe has the point. in_view: whether it is in its image. away: distance
    of the plane along the pixel's ray now, in multiples of it. ray: that ray, in the camera frame of the keyframe.
    """

    uv: wp.vec2
    x: float
    y: float
    in_view: wp.bool
    away: float
    turn: wp.mat33
    ray: wp.vec3


@wp.func
def textured_plane_of(
    view: CameraView,
    targets: Targets,
    surfaces: Surfaces,
    row: int,
    t: int,
    turn: wp.mat33,
    shift: wp.vec3,
):
    """Finds how a texture lies on triangle t; turn, shift: motion of its body from a row of slots to the keyframe."""
    plane = TexturedPlane()
    i = targets.instance[t]
    rotation = targets.casters.rotation[row, i]
    a, b, c = corners_of(
        view, targets.vertices, targets.triangles, rotation, targets.casters.translation[row, i], row, t
    )
    first = b - a
    second = c - a
    first += turn * first
    second += turn * second
    normal = wp.cross(first, second)
    over = 1.0 / wp.dot(normal, normal)
    of_first = over * wp.cross(second, normal)
    of_second = over * wp.cross(normal, first)
    uv = surfaces.uv[3 * t]
    to_first = surfaces.uv[3 * t + 1] - uv
    to_second = surfaces.uv[3 * t + 2] - uv
    plane.texture = surfaces.textures.place[i]
    plane.weights = wp.cw_mul(WEIGHTS, surfaces.albedo[surfaces.material[i]])
    plane.origin = a + turn * a + shift
    plane.uv = uv
    plane.normal = normal
    plane.along_u = to_first[0] * of_first + to_second[0] * of_second
    plane.along_v = to_first[1] * of_first + to_second[1] * of_second
    return plane


@wp.func
def filter_at(view: CameraView, surfaces: Surfaces, px: PixelInterval, plane: TexturedPlane, place: TexturePlace):
    """Gives how the texture is filtered under a pixel."""
    across, down = ray_steps(view, px.x, px.y)
    across += place.turn * across
    down += place.turn * down
    # A pixel beside this one sees the plane further along its ray, or less far.
    over = 1.0 / wp.dot(plane.normal, place.ray)
    across = place.away * (across - over * wp.dot(plane.normal, across) * place.ray)
    down = place.away * (down - over * wp.dot(plane.normal, down) * place.ray)
    return filter_of(
        surfaces.textures,
        plane.texture,
        wp.vec2(wp.dot(plane.along_u, across), wp.dot(plane.along_v, across)),
        wp.vec2(wp.dot(plane.along_u, down), wp.dot(plane.along_v, down)),
    )


@wp.func
def log_albedo_at(surfaces: Surfaces, plane: TexturedPlane, how: Filter, uv: wp.vec2):
    """Gives ln of the luminance of the albedo at a place on a texture."""
    return wp.log(wp.max(wp.dot(plane.weights, filtered_by(surfaces.textures, how, uv)), DARKEST))


@wp.func
def stays_on_chart(params: WindowParameters, scene: WindowScene, px: PixelInterval, run: Run):
    """Tells whether all triangles that a run is known to show are of one chart."""
    chart = scene.targets.charts[triangle_of(run.before)]
    if chart < 0 or scene.targets.charts[triangle_of(run.after)] != chart:
        return False
    each = probe_spacing(params, scene, px.env)
    i = (run.start // each + 1) * each
    while i < run.end:
        if scene.targets.charts[triangle_of(entry_at(params, scene, px, i))] != chart:
            return False
        i += each
    return True


@cache
def make_request_texture_path(lens: str, channels: int, waveform_count: int) -> Any:
    """Makes the function `request_texture_path`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    _in_view, _look_up_at, light_at = make_point_look_up(channels, waveform_count)
    request, displacement = make_request(channels), make_displacement(lens)

    @wp.func
    def texture_place(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        px: PixelInterval,
        plane: TexturedPlane,
        which: int,
        body: int,
        i: int,
    ):
        """Finds where on a plane of a body a pixel looks at instant i; which: of the keyframe."""
        place = TexturePlace()
        motion = motion_since(params, scene, keys.motions, px.env, px.k, which, i, body)
        turned = motion.turn * px.d
        place.turn = motion.turn
        place.ray = px.d + turned
        place.away = wp.dot(plane.normal, plane.origin - motion.shift) / wp.dot(plane.normal, place.ray)
        p = motion.shift + place.away * place.ray - plane.origin
        place.uv = plane.uv + wp.vec2(wp.dot(plane.along_u, p), wp.dot(plane.along_v, p))
        moved = displacement(view, px.d, place.away * px.d, motion.shift + place.away * turned, view.near)
        place.x = float(px.x) + moved[0]
        place.y = float(px.y) + moved[1]
        place.in_view = (
            place.x >= 0.0 and place.y >= 0.0 and place.x < float(view.width - 1) and place.y < float(view.height - 1)
        )
        return place

    @wp.func
    def request_texture_path(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        requests: Requests,
        px: PixelInterval,
        which: int,
        run: Run,
        out: ListPart,
    ):
        """Follows a pixel over the texture of a run that `stays_on_chart`, and over the light on it in keyframe
        `which`, and lists the instants between which ln I is straight within BENT of params.straight.

        Gives what `request_keyframe_path` gives.
        """
        last = run.last
        nothing = pixel(UNKNOWN)
        t = triangle_of(run.before)
        body = scene.targets.pieces[t][0]
        patch = patch_of(run.before, scene.targets.pieces[t])
        base = keys.first[which] + px.env * view.width * view.height
        each = probe_spacing(params, scene, px.env)
        middle = (params.slots + 1) >> 1
        back = motion_since(params, scene, keys.motions, px.env, px.k, which, middle, body)
        row = slot_row(params, px.env, px.k, middle)
        plane = textured_plane_of(view, scene.targets, scene.surfaces, row, t, back.turn, back.shift)
        place = texture_place(view, params, keys, scene, px, plane, which, body, run.start)
        if not place.in_view:
            return last, nothing, False
        shown, light = light_at(view, keys, base, wp.vec2(place.x, place.y), patch)
        if not shown or not is_demodulated(light):
            return last, nothing, False
        how = filter_at(view, scene.surfaces, px, plane, place)
        anchor = light + log_albedo_at(scene.surfaces, plane, how, place.uv)
        anchored = run.start
        value = anchor
        then = run.start
        told = anchor
        listed = run.start
        bend = BENT * params.straight
        low = wp.float32(-STEEPEST)
        high = wp.float32(STEEPEST)
        x = place.x
        y = place.y
        longest = stride_of(params, scene, px, which, body, depth_of(run.before))
        renewed = run.start
        steps = wp.int32(1)
        while then < run.end:
            now = wp.min(then + steps, run.end)
            place = texture_place(view, params, keys, scene, px, plane, which, body, now)
            if not place.in_view:
                return last, nothing, False
            shown, light = light_at(view, keys, base, wp.vec2(place.x, place.y), patch)
            if not shown or not is_demodulated(light):
                return last, nothing, False
            if (now - renewed) * ALIKE > params.slots:
                how = filter_at(view, scene.surfaces, px, plane, place)
                renewed = now
            fresh = light + log_albedo_at(scene.surfaces, plane, how, place.uv)
            # Looks per pixel of the way, in instants.
            pace = float(now - then) / wp.max(wp.length(wp.vec2(place.x - x, place.y - y)), 1.0e-3)
            least = wp.max(int(SHORTEST * params.spacing * pace), 1)
            change = wp.abs(fresh - value)
            if change > STEEP * params.straight and now - then > least:
                steps = wp.max((now - then) >> 1, least)
            else:
                steps = wp.min(wp.min(wp.max(int(LONGEST * params.spacing * pace), 1), longest), 2 * (now - then))
                if change > STEEP * params.straight:
                    steps = now - then
                rise = fresh - anchor
                span = float(now - anchored)
                if outside(rise, span * low, span * high):
                    # The look before is the last one that a straight line reaches.
                    if then > listed:
                        ahead, behind = entries_about(
                            params, scene, px, then, each, run.start, run.before, run.end, run.after
                        )
                        last = request(params, requests, px, then, ahead, behind, value - told, last, out)
                        told = value
                        listed = then
                    anchor = value
                    anchored = then
                    span = float(now - anchored)
                    rise = fresh - anchor
                    low = wp.float32(-STEEPEST)
                    high = wp.float32(STEEPEST)
                over = 1.0 / span
                low = wp.max(low, over * (rise - bend))
                high = wp.min(high, over * (rise + bend))
                value = fresh
                then = now
                x = place.x
                y = place.y
        return last, value - told, True

    return request_texture_path
