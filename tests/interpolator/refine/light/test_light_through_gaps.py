"""Light through gaps between shapes, each of which by itself is wide: a slit between plates, the bars of a fence."""

from dataclasses import replace

import numpy as np
import pytest
from refine_rig import box, parts_of, refined
from rigid_rig import GAP, START, closed_form, keyframe, lamp, plain, pose, quad, world

from evis.scene.model import Instance, Mesh
from evis.scene.motion import Linear, Prescribed, Spin
from nodes.interpolator.refine.light.silhouettes import finest_hole
from nodes.interpolator.refine.method import Refined
from nodes.interpolator.rigid import Rigid, RigidOptions
from nodes.interpolator.samples import Parting
from nodes.renderer.renderer import Renderer

K = 4
WALL, AHEAD = 3.0, 0.6
LIGHT = np.array([0.0, -2.0, 0.0])
TOLERANCE = 20_000
PLATE = 0.25
"""Half of a plate's width and height [m]."""


def plates(slit, speed, how, count=2):
    """Plates beside the view with slits between them, before a lamp, that go at a speed [m/s] and are in the middle at
    the middle of the gap: shapes of one body, bodies that stand on one, or bodies that go the same way."""
    middle = (START + GAP / 2) * 1e-9
    motions, apart = [Linear(np.array([speed, 0.0, 0.0]))] if speed else [], 2 * PLATE + slit
    places = apart * (np.arange(count) - (count - 1) / 2)
    mesh, at = box((PLATE, PLATE, 0.01)), (-speed * middle, -1.4, AHEAD)
    carrier = Prescribed(pose(*at), motions)
    ways = {
        "shapes": lambda x: carrier,
        "bodies on one": lambda x: Prescribed(pose(x), (), carrier),
        "bodies that go the same way": lambda x: Prescribed(pose(at[0] + x, *at[1:]), list(motions)),
    }
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL)))]
    things += [(mesh, plain(0.2), ways[how](x)) for x in (places[:1] if how == "shapes" else places)]
    scene = world(things, lights=[replace(lamp(), vector=LIGHT)], spares=[("frame", carrier)], sky=0.05)
    if how == "shapes":
        body = scene.instances[1].body
        scene.instances[1] = replace(scene.instances[1], pose=pose(places[0]))
        scene.instances += [Instance(f"plate{n}", body, mesh, 1, pose(x)) for n, x in enumerate(places[1:])]
    return scene


@pytest.mark.parametrize("how", ["shapes", "bodies on one", "bodies that go the same way"])
@pytest.mark.parametrize(("part", "wanted"), [(0.9, 0), (0.4, 4), (0.2, 8)])
def test_a_slit_between_plates_is_looked_for_as_a_rod_of_its_width_is(how, part, wanted):
    """While plates of half a metre counted alone, it was looked at halfway between two frames."""
    speed = 60.0
    assert parts_of(plates(part * GAP / K * 1e-9 * speed, speed, how)) == (wanted, False)


def test_plates_that_touch_have_no_slit():
    speed = 60.0
    assert parts_of(plates(0.0, speed, "shapes"))[0] == parts_of(plates(-0.05, speed, "shapes"))[0] == 0


def test_what_goes_ways_of_its_own_has_no_slit():
    """One of the plates turns besides."""
    speed = 60.0
    scene = plates(0.2 * GAP / K * 1e-9 * speed, speed, "bodies that go the same way")
    path = scene.bodies[1].trajectory
    scene.bodies[1].trajectory = Prescribed(path.start, [*path.shifts, Spin(np.array([0.0, 0.0, 1.0]), 1e-3)])
    assert parts_of(scene)[0] == 0


@pytest.mark.parametrize(("part", "wanted"), [(0.9, 0), (0.4, 4), (0.2, 8)])
def test_so_it_is_between_things_of_one_size_that_stand_still_before_a_lamp_that_goes(part, wanted):
    """Bars of a fence: what stands behind them does not close the gaps."""
    speed, middle = 60.0, (START + GAP / 2) * 1e-9
    way = Prescribed(pose(-speed * middle), [Linear(np.array([speed, 0.0, 0.0]))])
    scene = plates(part * GAP / K * 1e-9 * speed, 0.0, "bodies on one")
    still = world([], spares=[("torch", way)]).bodies[0]
    scene.bodies.insert(-1, still)
    torch = [body.name for body in scene.bodies].index("torch")
    scene.lights[0] = replace(scene.lights[0], body=torch)
    assert parts_of(scene) == (wanted, False)


@pytest.mark.parametrize(("turned", "wanted"), [(0.0, 4), (np.pi / 4, 16)])
def test_a_hole_that_goes_by_with_a_corner_ahead_is_on_points_for_less_time(turned, wanted):
    """Square holes in a lattice of strips. With a side ahead each is on all of its points for as long; with a corner,
    on one in seven for less than 2 / 14 of its diagonal."""
    speed, middle = 60.0, (START + GAP / 2) * 1e-9
    hole = 0.55 * GAP / K * 1e-9 * speed
    onward = speed * np.array([np.cos(turned), np.sin(turned), 0.0])
    path = Prescribed(pose(*(np.array([0, -1.4, AHEAD]) - middle * onward)), [Linear(onward)])
    across, along = box((hole, 6 * hole, 1e-4)), box((6 * hole, hole, 1e-4))
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), (across, plain(0.2), path)]
    # Straight before the lamp, so that it sees the holes as they are.
    scene = world(things, lights=[replace(lamp(), vector=np.array([0.0, -1.4, 0.0]))], sky=0.05)
    body, places = scene.instances[1].body, 3 * hole * (np.arange(4) - 1.5)
    scene.instances[1:] = [
        Instance(f"strip{n}", body, mesh, 1, pose(*at))
        for n, (mesh, at) in enumerate([(across, (x,)) for x in places] + [(along, (0, y)) for y in places])
    ]
    assert parts_of(scene) == (wanted, False)


@pytest.mark.parametrize(("turned", "wanted"), [(0.0, 0), (np.pi / 2, 16)])
def test_a_plate_that_turns_its_edge_to_a_lamp_that_goes_by(turned, wanted):
    """In its plane for a moment, 0.3 m wide and 4 mm thick: a sixteenth of the lamp's way, of 53 degrees as the plate
    sees it, lies within 1.7 degrees of that, where its shadow is 0.3 sin(1.7 deg) + 4 mm = 12.7 mm wide. That is on a
    point for 0.21 ms, and looked for in each 0.8 of that."""
    speed, middle = 60.0, (START + GAP / 2) * 1e-9
    way = Prescribed(pose(-speed * middle), [Linear(np.array([speed, 0.0, 0.0]))])
    plate = Prescribed(pose(0.0, -1.4, AHEAD, (0.0, turned, 0.0)))
    things = [(quad(6.0), plain(0.5), Prescribed(pose(z=WALL))), (box((0.15, 0.5, 0.002)), plain(0.2), plate)]
    scene = world(things, spares=[("torch", way)])
    torch = [body.name for body in scene.bodies].index("torch")
    scene.lights.append(replace(lamp(), vector=np.array([0.0, -1.4, 0.0]), body=torch))
    assert parts_of(scene) == (wanted, False)


@pytest.mark.parametrize(("part", "wanted"), [(0.9, 0), (0.4, 4), (0.2, 8)])
def test_flat_things_under_a_sun_that_turns(part, wanted):
    """Plates without thickness: their shadows fall up to four times their radius away, though nothing is solid."""
    rate, radius = 20.0, np.sqrt(2.0) * PLATE
    slit = part * GAP / K * 1e-9 * rate * 4 * radius
    scene = plates(slit, 0.0, "bodies on one")
    scene.instances[1:] = [replace(thing, mesh=quad(PLATE)) for thing in scene.instances[1:]]
    turn = Prescribed(pose(), [Spin(np.array([0.0, 1.0, 0.0]), rate)])
    scene.bodies.insert(-1, world([], spares=[("sky", turn)]).bodies[0])
    sky = [body.name for body in scene.bodies].index("sky")
    scene.lights[0] = replace(scene.lights[0], kind="directional", vector=np.array([1.0, 0.0, 1.0]), body=sky)
    assert parts_of(scene) == (wanted, False)


def slit_times(slit, speed):
    """When the light through a slit comes to pixels' points and goes, by the line from the lamp to the point, [2, h, w]
    ns since START; NaN beside the plates. Also the wall's share of the light while it is there."""
    scene = plates(slit, 0.0, "shapes")
    k, view = scene.cameras[0].k, scene.cameras[0]
    u, v = np.meshgrid(np.arange(view.width), np.arange(view.height))
    points = np.stack([WALL * (u - k[0, 2]) / k[0, 0], WALL * (v - k[1, 2]) / k[1, 1], np.full(u.shape, WALL)], -1)
    share = (AHEAD - LIGHT[2]) / (WALL - LIGHT[2])
    at = LIGHT + share * (points - LIGHT)
    there = np.abs(at[..., 1] + 1.4) < 0.9 * PLATE
    times = np.stack([(at[..., 0] + side * slit / 2) / speed * 1e9 + GAP / 2 for side in (-1, 1)])
    return np.where(there, times, np.nan)


def test_the_light_through_a_slit_is_found():
    """A fifth of the time between two frames long."""
    speed = 60.0
    slit = 0.2 * GAP / K * 1e-9 * speed
    frames, (pixels, ns, values) = refined(plates(slit, speed, "shapes"), K, TOLERANCE)
    begun, gone = (times.ravel() for times in slit_times(slit, speed))
    # Between two frames, so that none of them shows it.
    apart = GAP / K
    listed = (begun > 0.1 * apart) & (gone < GAP - 0.1 * apart) & (begun // apart == gone // apart)
    assert listed.sum() > 200
    lit = np.zeros(frames[0].size, bool)
    dark = np.median(frames, axis=0).ravel()
    inside = listed[pixels] & (ns > begun[pixels]) & (ns < gone[pixels]) & (values > 1.5 * dark[pixels])
    lit[pixels[inside]] = True
    assert lit[listed].mean() > 0.95


def test_an_environment_has_the_slits_that_it_has_by_itself():
    """However wide those of others are."""
    speed = 60.0
    scenes = [plates(part * GAP / K * 1e-9 * speed, speed, "bodies on one") for part in (0.2, 0.6, 0.05)]
    view, envs = scenes[0].cameras[0], len(scenes)
    renderer, keys = Renderer(scenes[0], view, envs), []
    for t in (np.array([START - GAP, START]), np.linspace(START, START + GAP, 11).round().astype(np.int64)):
        each = [closed_form(scene, t) for scene in scenes]
        states = each[0]
        states.pose, states.twist = (np.concatenate([getattr(s, n) for s in each]) for n in ("pose", "twist"))
        keys.append(keyframe(renderer, states, None, int(t[-1])))
    rigid = Rigid(scenes[0], view, envs, K, options=RigidOptions(single=True), worlds=scenes)
    method = Refined(rigid, TOLERANCE)
    method.between(*keys, np.zeros(envs, bool), np.empty((envs, K, view.height, view.width), np.float32))
    assert method.further is not None
    for found, scene in zip(Parting(envs, "cpu").of(method.further)(), scenes):
        _, alone = refined(scene, K, TOLERANCE)
        assert found is not None and alone is not None
        first = found.first.numpy()
        np.testing.assert_array_equal(np.repeat(np.arange(len(first) - 1), np.diff(first)), alone[0])
        np.testing.assert_array_equal(found.offset.numpy(), alone[1])
        np.testing.assert_array_equal(found.value.numpy(), alone[2])


def test_holes_are_as_wide_as_they_were_made():
    """Three bars 0.1 wide and 1 high, 0.03 and 0.05 apart; seen from aside they are one."""
    bars = [box((0.05, 0.5, 0.05)).vertices + np.float32([x, 0, 0]) for x in (0.0, 0.13, 0.28)]
    faces = np.concatenate([box((1, 1, 1)).faces + 8 * n for n in range(3)])
    hole = 2 * finest_hole(Mesh(np.concatenate(bars), faces))
    np.testing.assert_allclose(hole, [0.03, np.inf, np.inf], rtol=0.05)
