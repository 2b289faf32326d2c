"""Shadows that are gone again long before the next look at a pixel: of what is thin and fast, or under a fast lamp."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from refine_rig import box, parts_of, refined
from rigid_rig import FOCAL, GAP, HEIGHT, START, WIDTH, closed_form, keyframe, lamp, plain, pose, quad, world

from evis.geometry import se3
from evis.scene.mesh.shapes import disk, sphere
from evis.scene.model import Mesh, Waveform
from evis.scene.motion import Linear, Path, Prescribed, Sinusoid, Spin
from evis.scene.spline import Spline
from nodes.interpolator.refine.light.lamp_kernels import key_of
from nodes.interpolator.refine.light.silhouettes import PLACES, finest_half
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.samples import Parting
from nodes.renderer.renderer import Renderer

K = 4
WALL, ROD = 3.0, 0.6
"""Distances of a wall and of what throws shadows on it, from the camera [m]."""
LIGHT = np.array([0.0, -2.0, 0.0])
TOLERANCE = 20_000


def rod(half, speed, camera_speed=0.0):
    """A rod 2 half [m] wide beside the view, before a lamp, that goes at a speed [m/s] and is between them at the
    middle of the gap. Its shadow is on nothing at any frame."""
    middle = (START + GAP / 2) * 1e-9
    flight = Prescribed(pose(-speed * middle, -1.4, ROD), [Linear(np.array([speed, 0.0, 0.0]))])
    things = [
        (quad(6.0), plain(0.5), Prescribed(pose(z=WALL))),
        (box((half, 0.5, half / 4)), plain(0.2), flight),
    ]
    drift = Prescribed(pose(-camera_speed * middle), [Linear(np.array([camera_speed, 0.0, 0.0]))])
    return world(things, lights=[replace(lamp(), vector=LIGHT)], camera_motion=drift)


def torch(half, speed):
    """The same rod, which stands still, under a lamp that goes."""
    middle = (START + GAP / 2) * 1e-9
    way = Prescribed(pose(-speed * middle), [Linear(np.array([speed, 0.0, 0.0]))])
    things = [
        (quad(6.0), plain(0.5), Prescribed(pose(z=WALL))),
        (box((half, 0.5, half / 4)), plain(0.2), Prescribed(pose(0, -1.4, ROD))),
    ]
    scene = world(things, spares=[("torch", way)])
    scene.lights.append(replace(lamp(), vector=LIGHT, body=[b.name for b in scene.bodies].index("torch")))
    return scene


def shadow_times(half, rod_speed, lamp_speed):
    """When a rod's shadow comes over pixels' points and goes, [2, h, w] ns since START, by the line from
    the lamp to the point; NaN where the rod is too short."""
    scene = rod(half, 0.0)
    k = scene.cameras[0].k
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    x, y = WALL * (u - k[0, 2]) / k[0, 0], WALL * (v - k[1, 2]) / k[1, 1]
    share = ROD / WALL
    # At ROD the line is at lamp + share (point - lamp): where that is within the rod's sides it is dark.
    height = LIGHT[1] + share * (y - LIGHT[1])
    speed = rod_speed - lamp_speed * (1 - share)
    times = [(share * x + side * half) / speed * 1e9 + GAP / 2 for side in (-1, 1)]
    low, high = np.minimum(*times), np.maximum(*times)
    return np.where(abs(height + 1.4) < 0.45, [low, high], np.nan)


def found_times(scene, bright=False, **how):
    """First and last sample of each pixel in the dark, or in the light, [2, h, w] ns; NaN without any."""
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE, **how)
    usual = np.median(frames, axis=0).ravel()[pixels]
    dark = values > 1.4 * usual if bright else values < 0.7 * usual
    low, high = np.full(frames[0].size, np.inf), np.full(frames[0].size, -np.inf)
    np.minimum.at(low, pixels[dark], ns[dark])
    np.maximum.at(high, pixels[dark], ns[dark])
    shape = frames[0].shape
    return np.where(np.isfinite(low), [low, high], np.nan).reshape(2, *shape)


def check(expected, found, thickness=0.0, least=0.85):
    """Of all pixels over which something passes between two frames, the times are those of the closed form.

    thickness: by how much a thing's shape adds to the time, of the time. least: the shortest time that counts, of the
    longest.
    """
    # A frame that it is on tells anyway.
    edge = GAP / K
    within = (expected[0] // edge == expected[1] // edge) & (expected[0] > 0.02 * edge) & (expected[1] < GAP)
    within &= (expected[0] % edge > 0.05 * edge) & (expected[1] % edge < 0.95 * edge)
    # What is round is on a point at its border for a shorter time than those that are looked for.
    within &= expected[1] - expected[0] > least * np.nanmax(expected[1] - expected[0])
    assert within.sum() > 200
    missing = np.isnan(found[0]) & within
    assert missing.sum() <= 0.005 * within.sum()
    error = np.abs(found - expected)[:, within & ~missing]
    assert np.percentile(error, 99) < 2 * TOLERANCE + thickness * (expected[1] - expected[0])[within].max()


@pytest.mark.parametrize("part", [pytest.param(0.5, marks=pytest.mark.slow), 0.2, 0.06])
def test_the_shadow_of_what_is_thin_and_fast(part):
    """part: of the time between two frames for which it is on a point."""
    speed = 60.0
    half = 0.5 * part * GAP / K * 1e-9 * speed
    check(shadow_times(half, speed, 0.0), found_times(rod(half, speed)), 0.3)


SUN = -np.array([0.0, np.sin(1.0), np.cos(1.0)])
ALONG = np.array([1.0, 0.0, 0.0])
ACROSS = np.cross(ALONG, SUN)


def before_the_sun(mesh, axes, motion, begins):
    """A thing whose axes are given flies along the image beside the view, before a sun, so that its shadow comes by."""
    place = np.array([-begins, 0.0, WALL]) + 2.4 * SUN
    flight = Prescribed(se3.make_pose(place, se3.from_matrix(np.stack(axes, -1))), [motion])
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), (mesh, plain(0.2), flight)]
    return world(things, lights=[replace(lamp(), kind="directional", vector=-SUN)])


def on_the_wall():
    """Where the points that pixels see are along the way of what flies before the sun, and across it, [2, h, w] m."""
    k = world([], lights=[lamp()]).cameras[0].k
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return WALL * (u - k[0, 2]) / k[0, 0], ACROSS[1] * WALL * (v - k[1, 2]) / k[1, 1]


def edge_on(half, narrow):
    """Axes of a plate with sides 2 half whose shadow is 2 narrow wide along its way: it lies along the sun nearly."""
    sine = np.sqrt(0.5) * narrow / half
    along, side = np.sqrt(1 - sine**2) * SUN + sine * np.sqrt(0.5) * (ALONG + ACROSS), np.sqrt(0.5) * (ALONG - ACROSS)
    return along, side, np.cross(along, side)


def test_the_shadow_of_a_plate_that_turns_its_edge_to_the_sun():
    """A plate flies aslant, and its shadow is as wide as it is long times the sine of its angle with the light: on a
    point for a fifth of the time between two frames, though the plate is far wider along its way."""
    speed, half = 60.0, 0.5
    narrow = 0.5 * 0.2 * GAP / K * 1e-9 * speed
    begins = speed * (START + GAP / 2) * 1e-9
    scene = before_the_sun(quad(half), edge_on(half, narrow), Linear(speed * ALONG), begins)
    there, height = on_the_wall()
    expected = [(there + height + way * narrow) / speed * 1e9 + GAP / 2 for way in (-1, 1)]
    check(np.where(abs(height) < 0.6 * half, expected, np.nan), found_times(scene))


def test_a_plate_that_flies_for_a_part_of_the_gap_is_looked_for_as_often():
    speed, half, middle = 60.0, 0.5, (START + GAP / 2) * 1e-9
    axes = edge_on(half, 0.5 * 0.2 * GAP / K * 1e-9 * speed)
    all_along = before_the_sun(quad(half), axes, Linear(speed * ALONG), speed * middle)
    # From rest to rest, and in its middle as fast.
    ends = np.array([-1, 1]) * GAP / 50 * 1e-9
    jolt = Path(Spline(middle + ends, speed / 1.5 * ends[:, None] * ALONG))
    assert parts_of(before_the_sun(quad(half), axes, jolt, 0.0)) == parts_of(all_along) == (8, False)


def test_the_shadow_of_a_box_that_flies_corner_first():
    """A shadow that is a square on its corner is on a point for the longer the nearer the point is to its middle's way,
    and is looked for on all but the outermost seventh."""
    speed, half = 600.0, 0.5 * 0.4 * GAP / K * 1e-9 * 600.0 / np.sqrt(2)
    axes = np.sqrt(0.5) * (ALONG + ACROSS), np.sqrt(0.5) * (ALONG - ACROSS)
    begins = speed * (START + GAP / 2) * 1e-9
    scene = before_the_sun(box((half,) * 3), (*axes, np.cross(*axes)), Linear(speed * ALONG), begins)
    there, height = on_the_wall()
    width = np.sqrt(2) * half - abs(height)
    expected = [(there + way * width) / speed * 1e9 + GAP / 2 for way in (-1, 1)]
    check(np.where(width > 0, expected, np.nan), found_times(scene), least=1 / 7)


def test_a_lamp_that_passes_behind_what_stands_still():
    speed = 60.0
    half = 0.5 * 0.1 * GAP / K * 1e-9 * speed * (1 - ROD / WALL)
    check(shadow_times(half, 0.0, speed), found_times(torch(half, speed)), 0.3)


def lighthouse(rate, cone):
    """A wall before a beam that turns about the camera, and lights the middle of the image at half of the gap."""
    turn = Spin(np.array([0.0, 1.0, 0.0]), rate)
    begin = Prescribed(pose(turn=(0.0, -rate * (START + GAP / 2) * 1e-9, 0.0)), [turn])
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL)))]
    scene = world(things, spares=[("head", begin)], sky=0.02)
    ahead = {"kind": "spot", "vector": np.zeros(3), "direction": np.array([0.0, 0.0, 1.0])}
    head = [b.name for b in scene.bodies].index("head")
    scene.lights.append(replace(lamp(), **ahead, cone=(0.99 * cone, cone), body=head))
    return scene


@pytest.mark.parametrize("shadows", [True, False])
@pytest.mark.parametrize("cone", [0.1, 0.03])
def test_a_beam_that_turns(cone, shadows):
    """It is on a point while the angle to its axis is less than the cone's."""
    rate = 250.0
    scene = lighthouse(rate, cone)
    scene.lights[0] = replace(scene.lights[0], shadows=shadows)
    k = scene.cameras[0].k
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    x, y = (u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]
    flat = np.hypot(x, 1.0)
    with np.errstate(invalid="ignore"):
        aside = np.arccos(np.cos(cone) / (flat / np.hypot(flat, y)))
    expected = np.array([(np.arctan2(x, 1.0) + side * aside) / rate * 1e9 + GAP / 2 for side in (-1, 1)])
    check(expected, found_times(scene, bright=True), least=0.45)


def test_the_shadow_of_a_ball():
    """A point is in it while the line from the lamp comes closer to the ball's middle than its radius."""
    speed, radius, middle = 60.0, 0.5 * 0.7 * GAP / K * 1e-9 * 60.0, (START + GAP / 2) * 1e-9
    flight = Prescribed(pose(-speed * middle, -1.4, ROD), [Linear(np.array([speed, 0.0, 0.0]))])
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), (sphere(radius), plain(0.2), flight)]
    scene = world(things, lights=[replace(lamp(), vector=LIGHT)])
    k = scene.cameras[0].k
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    points = np.stack([WALL * (u - k[0, 2]) / k[0, 0], WALL * (v - k[1, 2]) / k[1, 1], np.full(u.shape, WALL)], -1)
    ways = (points - LIGHT) / np.linalg.norm(points - LIGHT, axis=-1, keepdims=True)
    # Squared distance of the ball's middle from the line, a + 2 b t + c t^2, t from the middle of the gap on.
    beside = np.array([0.0, -1.4, ROD]) - LIGHT
    beside = beside - (ways @ beside)[..., None] * ways
    onward = np.array([speed, 0.0, 0.0]) - speed * ways[..., :1] * ways
    a, b, c = (beside**2).sum(-1) - radius**2, (beside * onward).sum(-1), (onward**2).sum(-1)
    with np.errstate(invalid="ignore"):
        half = np.sqrt(b**2 - a * c) / c
    expected = np.array([(-b / c + side * half) * 1e9 + GAP / 2 for side in (-1, 1)])
    # The mesh's flat faces are within the ball.
    check(expected, found_times(scene), thickness=0.02, least=0.5)


@wp.kernel
def keys_of(lamps: wp.array(dtype=wp.int32), keys: wp.array(dtype=wp.uint64)):
    keys[wp.tid()] = key_of(lamps[wp.tid()])


def test_any_two_lamps_may_change_at_once():
    """Keys are SplitMix64's published first numbers of seed 0; all lamps, and all pairs of forty, can be told apart."""
    keys = wp.empty(1000, dtype=wp.uint64, device="cpu")
    wp.launch(keys_of, 1000, [wp.array(np.arange(1000), dtype=wp.int32, device="cpu")], [keys], device="cpu")
    found = keys.numpy()
    assert found[:3].tolist() == [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    assert len(np.unique(found)) == 1000
    pairs = (found[:40, None] + found[:40])[np.tril_indices(40, -1)]
    assert len(np.unique(pairs)) == len(pairs)


def test_while_the_camera_moves_too():
    """What it looks at is another point of the wall at each instant, whose shadow is where that is then."""
    speed, half = 60.0, 0.006
    still, moving = shadow_times(half, speed, 0.0), found_times(rod(half, speed, camera_speed=-3.0))
    there = np.isfinite(moving[0]) & np.isfinite(still[0]) & (still[0] > 0) & (still[1] < GAP)
    assert there.sum() > 0.9 * (np.isfinite(still[0]) & (still[0] > 0) & (still[1] < GAP)).sum() > 300
    # The camera is -3 t further on, from the middle of the gap on, and so is the point, of which the rod sees a fifth.
    faster = still.mean(0) - GAP / 2
    wanted = GAP / 2 + faster / (1 + 3.0 * ROD / WALL / speed)
    assert np.abs(moving.mean(0) - wanted)[there].max() < 3 * TOLERANCE + 0.3 * (still[1] - still[0])[there].max()


@pytest.mark.parametrize(("part", "wanted"), [(0.9, 0), (0.63, 0), (0.4, 4), (0.2, 8), (0.05, 32)])
def test_as_many_looks_as_what_passes_is_thin(part, wanted):
    """One in each 0.8 of the time for which it is on a point, in powers of two; half a coarse interval is looked at
    anyway."""
    speed = 60.0
    assert parts_of(rod(0.5 * part * GAP / K * 1e-9 * speed, speed)) == (wanted, False)


def test_what_turns_is_as_fast_as_its_ends():
    """A blade of 0.4 m that turns about its middle, 4 mm wide, is on a point at its end for 0.2 ms."""
    turn = [Spin(np.array([0.0, 0.0, 1.0]), 100.0)]
    blade = (box((0.2, 0.002, 0.0005)), plain(0.2), Prescribed(pose(0, -1.4, ROD), turn))
    scene = world([(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), blade], lights=[replace(lamp(), vector=LIGHT)])
    assert parts_of(scene) == (16, False)


@pytest.mark.parametrize("tilt", [0.0, 0.1, 0.3])
def test_a_long_rod_that_goes_aslant_is_on_a_point_no_longer_than_it_is_wide(tilt):
    """One of 2 m, 4 mm wide, at 20 m/s hides a lamp for 0.2 ms, over the cosine of its tilt."""
    flight = Prescribed(pose(0, -1.4, ROD, (0.0, 0.0, tilt)), [Linear(np.array([20.0, 0.0, 0.0]))])
    slim = (box((0.002, 1.0, 0.002)), plain(0.2), flight)
    scene = world([(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), slim], lights=[replace(lamp(), vector=LIGHT)])
    assert parts_of(scene) == (16, False)


def test_a_sun_that_turns_sweeps_with_the_shadows_of_posts():
    """Those of posts 0.5 m high, 1 cm wide, fall up to four times their radius away."""
    turn = Prescribed(pose(), [Spin(np.array([0.0, 1.0, 0.0]), 20.0)])
    things = [
        (quad(6.0), plain(0.5), Prescribed(pose(z=WALL))),
        (box((0.005, 0.25, 0.005)), plain(0.2), Prescribed(pose(0, 0, WALL - 0.3))),
    ]
    scene = world(things, spares=[("sky", turn)])
    sky = [b.name for b in scene.bodies].index("sky")
    scene.lights.append(replace(lamp(), kind="directional", vector=np.array([1.0, 0.5, 1.0]), body=sky))
    # 1 cm over 20 rad/s times a metre.
    assert parts_of(scene) == (8, False)
    scene.lights[0] = replace(scene.lights[0], body=-1)
    assert parts_of(scene)[0] == 0


@pytest.mark.parametrize(("amplitude", "rate", "wanted"), [(0.02, 400.0, 8), (0.02, 100.0, 0), (1e-6, 400.0, 0)])
def test_what_goes_to_and_fro_hides_lamps_for_less_than_it_is_wide(amplitude, rate, wanted):
    """A wide plate at 400 Hz turns each 1.25 ms, of which a third is looked for; at 100 Hz, or by a micrometre, it asks
    for no more than half a coarse interval."""
    shake = Sinusoid(np.array([amplitude, 0.0, 0.0]), rate)
    plate = (box((0.3, 0.3, 0.2)), plain(0.2), Prescribed(pose(0, -1.4, ROD), [shake]))
    scene = world([(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), plate], lights=[replace(lamp(), vector=LIGHT)])
    assert parts_of(scene) == (wanted, False)


def test_nothing_is_looked_at_without_lamps_or_shadows():
    fast = rod(0.001, 60.0)
    assert parts_of(replace(fast, lights=[]))[0] == 0
    assert parts_of(replace(fast, lights=[replace(fast.lights[0], shadows=False)]))[0] == 0


def test_what_is_too_thin_and_fast_is_told():
    parts, unseen = parts_of(rod(0.001, 200.0), tolerance_ns=100_000)
    assert parts > 4 and unseen


def test_the_samples_are_the_same_with_any_number_of_threads():
    one, two = (refined(rod(0.004, 60.0), K, TOLERANCE, threads=n)[1] for n in (1, 2))
    for a, b in zip(one, two):
        np.testing.assert_array_equal(a, b)


def test_an_environment_has_the_samples_that_it_has_by_itself():
    """However fast things are in others."""
    scenes = [rod(0.004, 60.0), rod(0.004, 5.0), rod(0.1, 0.0)]
    view = scenes[0].cameras[0]
    renderer, keys = Renderer(scenes[0], view, len(scenes)), []
    for t in (np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)):
        each = [closed_form(scene, t) for scene in scenes]
        states = each[0]
        states.pose, states.twist = (np.concatenate([getattr(s, n) for s in each]) for n in ("pose", "twist"))
        keys.append(keyframe(renderer, states, None, int(t[-1])))
    rigid = Rigid(scenes[0], view, len(scenes), K, options=RigidOptions(single=True), worlds=scenes)
    method = Refined(rigid, TOLERANCE)
    method.between(*keys, np.zeros(len(scenes), bool), np.empty((len(scenes), K, HEIGHT, WIDTH), np.float32))
    assert method.further is not None
    for found, scene in zip(Parting(len(scenes), "cpu").of(method.further)(), scenes):
        _, alone = refined(scene, K, TOLERANCE)
        if alone is None:
            assert found is None
            continue
        assert found is not None
        first = found.first.numpy()
        np.testing.assert_array_equal(np.repeat(np.arange(len(first) - 1), np.diff(first)), alone[0])
        np.testing.assert_array_equal(found.offset.numpy(), alone[1])
        np.testing.assert_array_equal(found.value.numpy(), alone[2])


@pytest.mark.gpu
def test_a_gpu_finds_the_same_shadows():
    here, there = (found_times(rod(0.004, 60.0), device=device) for device in ("cpu", "cuda"))
    both = np.isfinite(here[0]) & np.isfinite(there[0])
    assert both.sum() > 0.99 * np.isfinite(here[0]).sum() > 300
    assert (np.abs(here - there)[:, both] > 2 * TOLERANCE).mean() < 0.005


def test_focal_length_is_that_of_the_closed_form():
    """Of the rig, which `shadow_times` goes by."""
    assert rod(0.01, 1.0).cameras[0].k[0, 0] == FOCAL


def spokes(count, inner, outer, half):
    """A wheel of flat spokes that is one mesh with holes, about z."""
    angle = 2 * np.pi * np.arange(count)[:, None] / count
    along, aside = np.hstack([np.cos(angle), np.sin(angle)]), np.hstack([-np.sin(angle), np.cos(angle)])
    ends = [inner * along - half * aside, outer * along - half * aside, outer * along + half * aside]
    corners = np.stack([*ends, inner * along + half * aside], axis=1).reshape(-1, 2)
    first = 4 * np.arange(count)[:, None]
    faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))])
    return Mesh(np.pad(corners, ((0, 0), (0, 1))).astype(np.float32), faces.astype(np.int32))


def test_parts_and_holes_of_a_mesh_are_as_wide_as_they_were_made():
    """A spoke seen at an angle is wider along a row: from 2 half on; a hole between two at the rim is not finer."""
    half = 0.012
    width = 2 * finest_half(spokes(12, 0.05, 0.35, half))
    assert 2 * half * 0.95 < width[0] < 2 * half * 1.3
    assert 2 * half * 0.95 < width[1] < 2 * half * 1.3
    assert width[2] == 0.0


def test_a_comb_is_as_fine_as_its_teeth_or_the_gaps_between_them():
    teeth = [quad(0.5).vertices * np.float32([0.02, 1.0, 1.0]) + np.float32([0.05 * n, 0, 0]) for n in range(10)]
    faces = np.concatenate([quad(0.5).faces + 4 * n for n in range(10)])
    width = 2 * finest_half(Mesh(np.concatenate(teeth), faces))
    np.testing.assert_allclose(width[:2], [min(0.02, 0.05 - 0.02), 1.0], rtol=0.05)


def test_what_is_round_is_hardly_finer_than_it_is_large():
    """Of a disk's rows a tenth is shorter than 0.436 of its diameter: 1 - sqrt(1 - c^2 / 4) = 0.1, c in radii."""
    mesh = disk(0.5)
    np.testing.assert_allclose(2 * finest_half(Mesh(mesh.vertices, mesh.faces))[:2], 0.436, atol=0.03)


def test_a_wire_too_thin_to_be_met_is_as_wide_as_a_place():
    """Aslant, a millionth of its length wide: no ray of the outline meets it, and that is no error."""
    wire = np.array([(0, 0, 0), (1, 1, 0), (1, 1 + 1e-6, 0)], np.float32)
    width = 2 * finest_half(Mesh(wire, np.array([[0, 1, 2]], np.int32)))
    np.testing.assert_allclose(width, [1 / PLACES, 1 / PLACES, 0.0], rtol=1e-4, atol=1e-9)


def test_the_light_between_the_spokes_of_a_wheel():
    """At a point of the wall the shadows of spokes come by, each for 2 half / (radius rate); as many are found as the
    closed form has them."""
    count, half, rate, radius = 12, 0.012, 300.0, 0.3
    turn = Prescribed(pose(0, -1.4, ROD), [Spin(np.array([0.0, 0.0, 1.0]), rate)])
    wheel = (spokes(count, 0.05, 0.8, half), plain(0.2), turn)
    scene = world(
        [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), wheel], lights=[replace(lamp(), vector=LIGHT)], sky=0.05
    )
    frames, (pixels, ns, values) = refined(scene, K, TOLERANCE)
    usual = np.median(frames, axis=0).ravel()
    k = scene.cameras[0].k
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    share = ROD / WALL
    x = share * WALL * (u - k[0, 2]) / k[0, 0]
    y = LIGHT[1] + share * (WALL * (v - k[1, 2]) / k[1, 1] - LIGHT[1]) + 1.4
    apart = np.hypot(x, y).ravel()
    ring = np.flatnonzero((apart > radius) & (apart < 0.75))
    assert len(ring) > 200
    # Whether a pixel is dark at each sample, in the order of time; changes of that are a spoke's edges.
    order = np.lexsort((ns, pixels))
    pixels, dark = pixels[order], values[order] < 0.7 * usual[pixels[order]]
    flips = np.bincount(pixels[1:][(dark[1:] != dark[:-1]) & (pixels[1:] == pixels[:-1])], minlength=usual.size)
    edges = 2 * count * rate * GAP * 1e-9 / (2 * np.pi)
    assert np.abs(flips[ring] - edges).max() <= 2
    assert abs(flips[ring].mean() - edges) < 0.05 * edges


def test_how_dark_a_passing_shadow_gets_under_an_area_light():
    """A rod narrower than the lamp hides part of it at once: the darkest sample is as dark as the darkest of 200
    images, though the middle of the lamp alone would tell of two changes only."""
    speed = 60.0
    scene = rod(0.5 * 0.2 * GAP / K * 1e-9 * speed, speed)
    sides = {"half_u": np.array([0.04, 0.0, 0.0]), "half_v": np.array([0.0, 0.0, 0.02])}
    sides["colour"] = 5000.0 * scene.lights[0].colour
    panel = replace(scene.lights[0], kind="area", direction=np.array([0.0, 1.0, 1.0]), **sides)
    scene.lights[0] = replace(panel, half_v=np.array([0.0, 0.02, -0.02]))
    frames, (pixels, _, values) = refined(scene, K, TOLERANCE)
    found = frames.min(axis=0).ravel()
    np.minimum.at(found, pixels, values)
    renderer = Renderer(scene, scene.cameras[0])
    darkest = np.full(found.shape, np.inf)
    for stamp in np.linspace(START, START + GAP, 201).round().astype(np.int64):
        poses = closed_form(scene, np.array([stamp])).pose[:, 0]
        image = renderer.render(poses, None, ("luminance",), {}, int(stamp))["luminance"]
        darkest = np.minimum(darkest, image.ravel())
    crossed = darkest < 0.8 * np.median(frames, axis=0).ravel()
    assert crossed.sum() > 500
    # The image may have been darker for an instant; a step of its 16 shadow rays is a tenth and more of the light.
    assert (found[crossed] < 1.25 * darkest[crossed]).mean() > 0.9


@pytest.mark.parametrize(
    "waveform",
    [None, Waveform("sine", 1.0, 0.3), Waveform("sine", 100.0, 0.0)],
    ids=["steady", "slowly flickering", "flickering by nothing"],
)
def test_a_shadows_edge_between_two_frames_is_found(waveform):
    """The lamp's light is on a line from frame to frame, so that it alone asks for no sample between them."""
    half, edge = 0.05, GAP / K
    speed = 2 * half / (1.1 * edge * 1e-9)
    scene = rod(half, speed)
    scene.lights[0] = replace(scene.lights[0], waveform=waveform)
    expected, found = shadow_times(half, speed, 0.0), found_times(scene)
    # At the frame between them a pixel is dark.
    listed = (expected[0] // edge != expected[1] // edge) & (expected[0] > 0.1 * edge) & (expected[1] < 0.98 * GAP)
    assert listed.sum() > 200
    off = np.abs(found - expected)[:, listed]
    assert np.quantile(np.nan_to_num(off, nan=np.inf), 0.9) < 4 * TOLERANCE


@pytest.mark.parametrize("swings", [K, 2 * K])
def test_a_shadow_that_is_back_at_every_frame_is_looked_for_where_it_goes_in_between(swings):
    """A rod swings as often as there are frames, or twice as often, and its shadow by 0.4 m to and fro: what a pixel
    shows is known at any time, for the rod's shadow has the edges of the lines from the lamp to the rod's."""
    half, reach, rate = 0.06, 0.04, swings / (GAP * 1e-9)
    sway = Sinusoid(np.array([reach, 0.0, 0.0]), rate, 0.5 * np.pi)
    scene = rod(half, 0.0)
    scene.bodies[1].trajectory = Prescribed(pose(0.0, -1.4, ROD), [sway])
    _, found = refined(scene, K, TOLERANCE)
    assert found is not None
    pixels, ns, values = found
    k = scene.cameras[0].k
    at = WALL * (np.arange(WIDTH) - k[0, 2]) / k[0, 0]
    # Where the line from the lamp to a point passes the rod's front, whose edges are all that matters of so flat a box.
    share = (ROD - half / 4 - LIGHT[2]) / (WALL - LIGHT[2])
    ways = LIGHT[0] + share * (at - LIGHT[0])
    stamps = START + np.linspace(0, GAP, 4001)
    places = reach * np.sin(2 * np.pi * rate * stamps * 1e-9 + 0.5 * np.pi)
    dark = np.abs(ways[:, None] - places) < half
    # Points that it comes over by no less than a fiftieth of the time between two frames.
    changing = np.flatnonzero((dark.mean(axis=1) > 0.02) & (dark.mean(axis=1) < 0.98))
    row = HEIGHT // 4
    assert len(changing) > 8
    wrong = []
    for x in changing:
        mine = pixels == row * WIDTH + x
        assert mine.sum() > K
        level = 0.5 * (values[mine].min() + values[mine].max())
        truth = np.interp(ns[mine], stamps - START, dark[x]) > 0.5
        wrong.append(np.mean((values[mine] < level) != truth))
    assert np.mean(wrong) < 0.1
