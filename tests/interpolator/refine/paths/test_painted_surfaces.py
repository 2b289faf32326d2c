"""Surfaces that neither keyframe shows: what is painted on them passes pixels between two frames."""

import numpy as np
import pytest
from refine_rig import refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, camera, closed_form, keyframe, painted, plain, pose, quad, world

from evis.geometry import se3
from evis.scene.mesh.shapes import cylinder
from evis.scene.model import Material, Mesh
from evis.scene.motion import Linear, Prescribed, Sinusoid, Spin
from nodes.interpolator.refine.paths.albedo_scale import BENT, ONE_COLOUR, albedo_scale_of
from nodes.renderer.geometry.triangles import geometry_of
from nodes.renderer.renderer import Renderer

K = 4
TOLERANCE = 20_000
RADIUS, AWAY = 0.5, 2.0
DARK, BRIGHT = 0.2, 0.8


def stripes(count, size=2048):
    """Material with so many pairs of stripes along u."""
    on = (np.arange(size) * 2 * count // size) % 2
    picture = np.broadcast_to(np.where(on, BRIGHT, DARK)[:, None], (size, 3))[None].repeat(8, 0)
    return Material("stripes", np.ones(3), picture.astype(np.float32), two_sided=True)


def joints(count, width, size=2048):
    """Material with so many dark lines along v, each of a width of `width` texels, one darker than the next."""
    dark = np.linspace(0.9, 1.0, count)[np.arange(size) * count // size] * DARK
    on = np.arange(size) * count % size < width * count
    picture = np.broadcast_to(np.where(on, dark, BRIGHT)[:, None], (size, 3))[None].repeat(8, 0)
    return Material("joints", np.ones(3), picture.astype(np.float32), two_sided=True)


@pytest.mark.parametrize("size", [1024, 2048, 16384])
@pytest.mark.parametrize("wide", [2, 4])
def test_stripes_of_a_large_texture_are_as_wide_as_they_are(size, wide):
    """Of 16,384 texels every 16th is of one colour where stripes are 2 or 4 texels wide."""
    scene = world([(quad(1.0), stripes(size // wide // 2, size), Prescribed(pose(z=3.0)))])
    scale = albedo_scale_of(scene, geometry_of(scene), 0.02)
    assert scale == pytest.approx(2.0 * wide / size, rel=0.5)


def drum(count, rate):
    """A drum with upright stripes that turns about its axis before a wall; the sky lights both."""
    upright = pose(z=AWAY, turn=(np.pi / 2, 0, 0))
    body = Prescribed(upright, [Spin(np.array([0.0, 0.0, 1.0]), rate)])
    wall = (quad(6.0), plain(0.5), Prescribed(pose(z=4.0)))
    return world([wall, (cylinder(RADIUS, 4.0), stripes(count), body)], sky=1.0)


def edge_times(count, rate, columns):
    """When the edges of stripes pass pixels of the middle row, a list of sorted ns since START for each column: by the
    quadratic of a ray and a cylinder."""
    k = camera().k
    x = (columns - k[0, 2]) / k[0, 0]
    a, b, c = x**2 + 1, -2 * AWAY, AWAY**2 - RADIUS**2
    z = (-b - np.sqrt(b**2 - 4 * a * c)) / (2 * a)
    turn = se3.to_matrix(pose(turn=(np.pi / 2, 0, 0))[3:])
    found = []
    for point in np.stack([x * z, 0 * z, z - AWAY], -1) @ turn:
        edges = np.arctan2(point[1], point[0]) - np.pi * np.arange(2 * count) / count
        first = edges / rate * 1e9 - START
        period = 2 * np.pi / rate * 1e9
        found.append(np.sort(first % period))
        assert GAP < period
    return [times[times < GAP] for times in found]


@pytest.mark.parametrize("count", [10, 16])
def test_the_stripes_of_a_drum_that_turns(count):
    """The drum makes 0.95 turns in the gap: most of what pixels see meanwhile was on its back at both keyframes."""
    rate = 0.95 * 2 * np.pi / GAP * 1e9
    frames, (pixels, ns, values) = refined(drum(count, rate), K, TOLERANCE)
    row, columns = HEIGHT // 2, np.arange(WIDTH // 2 - 10, WIDTH // 2 + 11)
    missed = total = 0
    for column, expected in zip(columns, edge_times(count, rate, columns)):
        mine = pixels == row * WIDTH + column
        at = np.concatenate([ns[mine], np.arange(1, K + 1) * GAP / K])
        level = np.log(np.concatenate([values[mine], frames[:, row, column]])) - 0.5 * np.log(DARK * BRIGHT)
        at, level = at[np.argsort(at)], level[np.argsort(at)]
        n = np.flatnonzero(level[1:] * level[:-1] < 0)
        crossed = at[n] - level[n] * (at[n + 1] - at[n]) / (level[n + 1] - level[n])
        expected = expected[expected > at[0]]
        total += len(expected)
        apart = np.abs(crossed[None] - expected[:, None]).min(axis=1) if len(crossed) else np.full(len(expected), GAP)
        missed += int((apart > 3 * TOLERANCE).sum())
    assert total > 100
    assert missed <= 0.02 * total


def albedo_scale(mesh, material):
    scene = world([(mesh, material, "world")])
    return albedo_scale_of(scene, geometry_of(scene), 0.1)


def test_grain_is_half_a_period():
    side = 3.0
    # What swings by more than 1 in ln has so much of the way to go.
    assert np.allclose(albedo_scale(quad(side / 2), stripes(8)), side / 16 / np.log(BRIGHT / DARK), rtol=0.01)
    # Of `wave` ln goes up and down twice along u; where it is steepest it is pi / 2 times as steep as on the average.
    waves = albedo_scale(quad(side / 2), painted())
    assert (waves > 0.5 * side / 4).all() and (waves < 1.2 * side / 4).all()


@pytest.mark.parametrize(("count", "width"), [(16, 5), (4, 30), (32, 1)])
def test_grain_of_what_is_sparse_is_as_wide_as_things_are(count, width):
    """Between two of the lines there is nothing for 4 to 64 times their width."""
    side, swing = 3.0, np.log(BRIGHT / (0.9 * DARK))
    assert np.allclose(albedo_scale(quad(side / 2), joints(count, width, 1024)), side * width / 1024 / swing, rtol=0.01)


def test_what_is_even_has_no_grain():
    assert (albedo_scale(quad(1.0), plain(0.5)) == ONE_COLOUR).all()
    faint = painted()
    faint.texture = np.float32(0.5) + np.float32(0.01) * faint.texture
    assert (albedo_scale(quad(1.0), faint) == ONE_COLOUR).all()
    # No uv, no texture.
    assert (albedo_scale(Mesh(quad(1.0).vertices, quad(1.0).faces), painted()) == ONE_COLOUR).all()


def coloured(points, faces, values):
    """A mesh whose triangles have grey values at their corners [F, 3]."""
    mesh = Mesh(np.array(points, np.float32), np.array(faces, np.int32))
    mesh.colours = np.repeat(np.array(values, np.float32)[..., None], 3, axis=-1)
    return mesh


@pytest.mark.parametrize("height", [1.0, 0.02])
def test_colours_at_vertices_go_up_as_steeply_as_their_slope_says(height):
    """From the base of a triangle, of one colour, to its tip: a sliver's slope is steep, however long its sides are."""
    points, values = [(0, 0, 0), (3, 0, 0), (1, height, 0)], [(0.5, 0.5, 0.9)]
    assert albedo_scale(coloured(points, [(0, 1, 2)], values), plain(0.5)).tolist() == pytest.approx([BENT * height])
    # By more than 1 in ln there is so much less of the way.
    steeper = coloured(points, [(0, 1, 2)], [(0.1, 0.1, 0.9)])
    assert albedo_scale(steeper, plain(0.5)).tolist() == pytest.approx([BENT * height / np.log(9.0)])
    # Along the base it has all of its length.
    along = coloured(points, [(0, 1, 2)], [(0.5, 0.9, 0.5 ** (2 / 3) * 0.9 ** (1 / 3))])
    assert albedo_scale(along, plain(0.5)).tolist() == pytest.approx([BENT * 3.0], rel=1e-3)


def test_triangles_of_one_colour_each_are_as_fine_as_they_are_wide_where_another_begins():
    """Strips 0.2 wide and 2 long, of two triangles each: two grey ones, then a white one."""
    points = [(0.2 * x, 2 * y, 0) for x in range(4) for y in range(2)]
    faces = [f for x in range(3) for f in ((2 * x, 2 * x + 2, 2 * x + 3), (2 * x, 2 * x + 3, 2 * x + 1))]
    values = np.repeat([0.3, 0.3, 0.3, 0.3, 0.9, 0.9], 3).reshape(6, 3)
    wide = 0.4 / np.hypot(0.2, 2.0)
    # Of the second strip the triangle beside the third one alone.
    expected = [ONE_COLOUR, ONE_COLOUR, wide, ONE_COLOUR, ONE_COLOUR, wide]
    assert albedo_scale(coloured(points, faces, values), plain(0.5)).tolist() == pytest.approx(expected)


def test_a_triangle_without_area_has_no_grain():
    points, values = [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0.1, 0.5, 0.9)]
    assert albedo_scale(coloured(points, [(0, 1, 2)], values), plain(0.5)).tolist() == pytest.approx([ONE_COLOUR])


@pytest.mark.parametrize(("width", "tolerance", "most"), [(2 / 3, 200_000, 0.8), (1 / 3, TOLERANCE, 0.4)])
def test_stripes_finer_than_a_pixel_are_followed_all_the_way(width, tolerance, most):
    """Keyframes alias them, so that ln I seems to go straight there; every stripe needs a sample nevertheless, those
    that are on a pixel for a shorter time where times are asked for more closely."""
    depth = 3.0
    count = round(6.0 / (2 * width * depth / FOCAL))
    speed = 12.0 * depth / FOCAL / GAP * 1e9
    way = Prescribed(pose(x=-speed * (START + GAP / 2) * 1e-9, z=depth), [Linear(np.array([speed, 0.0, 0.0]))])
    _frames, (pixels, ns, _values) = refined(world([(quad(3.0), stripes(count, 4096), way)], sky=1.0), K, tolerance)
    inner = (pixels % WIDTH > 12) & (pixels % WIDTH < WIDTH - 12)
    at = np.sort(np.concatenate([pixels[inner] * GAP + ns[inner]]))
    gone = np.diff(at)[np.diff(at // GAP) == 0] * speed * 1e-9 * FOCAL / depth
    # Frames, which are not in this list, are samples too, and from the last one before to the first one after may be
    # twice as far as the spacing, 0.6 and 0.15 px, less the rounding of instants.
    assert np.percentile(gone, 99) < most


def test_what_shakes_before_pixels_is_sampled_where_it_turns_back():
    """A wall painted as a sine of 1.5 pixels goes to and fro by 0.15 pixels, less than what lies between two samples of
    one that goes on: lines between samples are near to rendering at 40 kHz, by three tolerances at most."""
    depth, side, tolerance = 3.0, 6.0, 0.0125
    count = round(side / (1.5 * depth / FOCAL))
    wave = 0.5 + 0.3 * np.sin(2 * np.pi * count * (np.arange(4096) + 0.5) / 4096)
    picture = np.broadcast_to(wave[:, None], (4096, 3))[None].repeat(8, 0).astype(np.float32)
    sine = Material("sine", np.ones(3), picture, two_sided=True)
    shake = Sinusoid(np.array([0.15 * depth / FOCAL, 0.0, 0.0]), 800.0)
    scene = world([(quad(side / 2), sine, Prescribed(pose(z=depth), [shake]))], sky=1.0)
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE, tolerance=tolerance)
    row, columns, renderer = HEIGHT // 2, np.arange(6, WIDTH - 6), Renderer(scene, scene.cameras[0])
    times = np.linspace(0, GAP, 401).round().astype(np.int64)
    dense = []
    for t in times + START:
        states = closed_form(scene, np.array([t]))
        dense.append(np.log(keyframe(renderer, states, states.pose[:, 0], int(t)).image.numpy()[0, row, columns]))
    truth = np.array(dense)
    off = []
    for n, x in enumerate(columns):
        mine = pixels == row * WIDTH + x
        at = np.concatenate([[0], ns[mine], np.arange(1, K + 1) * GAP / K])
        level = np.concatenate([truth[:1, n], np.log(values[mine]), np.log(frames[:, row, x])])
        order = np.argsort(at)
        off.append(np.abs(np.interp(times, at[order], level[order]) - truth[:, n]).max())
    assert np.ptp(truth, axis=0).mean() > 0.15
    assert np.mean(off) < 3 * tolerance


def test_joints_thinner_than_pixels_before_a_camera_that_turns():
    """Joints of a third of a pixel in the middle, before a lens of 100 degrees, at whose sides a pixel is less than
    half as wide in angle: lines between samples are near to rendering at 20 kHz, by two tolerances."""
    depth, side, tolerance, rate, focal, width = 2.0, 12.0, 0.0125, 30.0, 20.0, 48
    turned = pose(turn=(0.0, -rate * (START + GAP / 2) * 1e-9, 0.0))
    path = Prescribed(turned, [Spin(np.array([0.0, 1.0, 0.0]), rate)])
    view = camera(width, 4, focal)
    lines = (quad(side / 2), joints(12, 5), Prescribed(pose(z=depth)))
    scene = world([lines], view, path, sky=1.0)
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE, tolerance=tolerance)
    times = np.linspace(0, GAP, 201).round().astype(np.int64)
    renderer, dense = Renderer(scene, view), []
    for t in times + START:
        states = closed_form(scene, np.array([t]))
        dense.append(np.log(keyframe(renderer, states, states.pose[:, 0], int(t)).image.numpy()[0, 2]))
    truth, row = np.array(dense), pixels // width == 2
    off = []
    for x in range(width):
        mine = row & (pixels % width == x)
        at = np.concatenate([[0], ns[mine], np.arange(1, K + 1) * GAP / K])
        level = np.concatenate([truth[:1, x], np.log(values[mine]), np.log(frames[:, 2, x])])
        order = np.argsort(at)
        off.append(np.abs(np.interp(times, at[order], level[order]) - truth[:, x]))
    assert np.ptp(truth, axis=0).mean() > 0.2
    assert np.max(off, axis=1).mean() < 2 * tolerance
    assert np.percentile(off, 99) < 2 * tolerance
