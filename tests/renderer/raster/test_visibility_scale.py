"""Many bodies: culling, the layer of what never moves, and trees over casters must change no bit."""

from itertools import pairwise

import numpy as np
import pytest
from renderer_scenes import ALL, Still, at, camera, poses, quad, scene, sphere

from evis.geometry import se3
from evis.scene.model import Light, Material
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.renderer import Renderer
from nodes.renderer.shadows.occlusion import Occluders

LAMPS = [
    Light("lamp", "point", np.full(3, 30.0), np.array([0.5, -2.0, 1.0])),
    Light("sun", "directional", np.full(3, 2.0), np.array([0.3, 0.8, 0.4])),
]


def crowd(movers=20, still=40, still_camera=True, seed=0, lights=LAMPS):
    """Spheres all around the camera, above a floor; (scene, poses of five instants float64 [5, 1, N, 7])."""
    rng = np.random.default_rng(seed)
    mesh = sphere(0.3, 6)
    floor = quad(12, 12)
    meshes = [(mesh, k, 0) for k in range(movers)] + [(mesh, -1, 0)] * still + [(floor, -1, 0)]
    world = scene(meshes, bodies=movers, view=camera(), lights=lights, still_camera=still_camera)
    world.environment = np.full(3, 0.1, np.float32)
    world.materials = [Material("m", np.full(3, 0.5))]
    places = rng.uniform(-4, 4, (still, 3)) * [1, 0.4, 1]
    for instance, place in zip(world.instances[movers:], places):
        instance.pose = at(*place, rng.standard_normal(3))
    world.instances[-1].pose = at(0, 2.0, 0, (np.pi / 2, 0, 0))
    start = rng.uniform(-4, 4, (movers, 3)) * [1, 0.4, 1]
    velocity = rng.standard_normal((movers, 3)) * 0.6
    instants = []
    for n in range(5):
        eye = at(0, 0, 0) if still_camera else at(0.3 * n, 0.1 * n, 0.2, (0, 0.9 * n, 0.1))
        bodies = [at(*(s + n * v), (0.3 * n, 0, 0.2 * n)) for s, v in zip(start, velocity)]
        instants.append(poses(*bodies, eye))
    return world, np.array(instants)


@pytest.mark.parametrize("tiled", [False, True])
@pytest.mark.parametrize("still_camera", [True, False])
def test_culling_leaves_out_only_what_is_not_seen(still_camera, tiled):
    """Against blocks that are never culled: spheres of infinite size and no cone of normals."""
    world, instants = crowd(still_camera=still_camera)
    culled = Visibility(world, world.cameras[0], layered=False, tiled=tiled)
    complete = Visibility(world, world.cameras[0], layered=False)
    for blocks in complete.raster.blocks:
        blocks.radius.fill_(1e9)
        blocks.extent.fill_(1e9)
        blocks.cosine.fill_(0.0)
    seen = set()
    for instant in instants:
        culled.update(instant)
        complete.update(instant)
        np.testing.assert_array_equal(culled.packed.numpy(), complete.packed.numpy())
        seen |= set(np.unique(culled.hits()["instance"]))
    assert len(seen) > 10


@pytest.mark.parametrize("margin,threads", [(0, 1), (5, 1), (0, 3)])
def test_the_still_layer_changes_no_bit(margin, threads):
    world, instants = crowd()
    layered = Visibility(world, world.cameras[0], margin=margin, threads=threads)
    fresh = Visibility(world, world.cameras[0], margin=margin, layered=False)
    assert layered._layered
    for instant in [*instants, instants[1], instants[1]]:
        layered.update(instant)
        fresh.update(instant)
        np.testing.assert_array_equal(layered.packed.numpy(), fresh.packed.numpy())


def test_the_layer_is_drawn_anew_when_what_was_still_has_moved():
    """A body without motion of its own may still be put elsewhere, with a new episode or another camera pose."""
    world, instants = crowd()
    world.bodies[0].trajectory = Still()
    layered, fresh = Visibility(world, world.cameras[0]), Visibility(world, world.cameras[0], layered=False)
    for instant in instants:
        layered.update(instant)
        fresh.update(instant)
        np.testing.assert_array_equal(layered.packed.numpy(), fresh.packed.numpy())
    turned = instants[0].copy()
    turned[:, -1] = at(0.1, 0, 0, (0, 0.3, 0))
    for each in (layered, fresh):
        each.update(turned)
    np.testing.assert_array_equal(layered.packed.numpy(), fresh.packed.numpy())


def test_the_layer_of_every_environment_is_its_own():
    world, instants = crowd()
    together = Visibility(world, world.cameras[0], envs=3)
    for first in (0, 1):
        together.update(np.concatenate(instants[first : first + 3]))
    for env in range(3):
        alone = Visibility(world, world.cameras[0], layered=False)
        alone.update(instants[1 + env])
        np.testing.assert_array_equal(together.packed.numpy()[env], alone.packed.numpy()[0])


def radiances(world, instants, trees, monkeypatch, envs=1):
    build = lambda *arguments, **options: Occluders(*arguments, **{**options, "trees": trees})
    monkeypatch.setattr("nodes.renderer.lighting.Occluders", build)
    renderer = Renderer(world, world.cameras[0], envs)
    assert renderer.shading.occluders.trees == trees
    return [renderer.render(instant)["radiance"].copy() for instant in instants]


@pytest.mark.parametrize("still_camera", [True, False])
def test_trees_find_what_trying_each_caster_finds(still_camera, monkeypatch):
    """Hard shadows, and the soft one of an area light, whose penumbra is looked for in the trees too."""
    panel = Light("panel", "area", np.full(3, 40.0), np.array([0.0, -3.0, 2.0]))
    panel.half_u, panel.half_v = np.array([0.4, 0, 0]), np.array([0, 0, 0.4])
    world, instants = crowd(still_camera=still_camera, lights=[*LAMPS, panel])
    one_by_one = radiances(world, instants, False, monkeypatch)
    by_tree = radiances(world, instants, True, monkeypatch)
    dark = 0
    world.lights = []
    plain = Renderer(world, world.cameras[0])
    for a, b, instant in zip(one_by_one, by_tree, instants):
        np.testing.assert_array_equal(a, b)
        dark += (a == plain.render(instant)["radiance"]).all(-1).mean() / len(instants)
    assert 0.05 < dark < 0.95


def test_trees_far_from_the_origin_and_of_several_environments(monkeypatch):
    world, instants = crowd(still_camera=False)
    world.lights = LAMPS[1:]
    far = np.array([1e5, -2e5, 5e4, 0, 0, 0, 0])
    for instance in world.instances:
        if instance.body < 0:
            instance.pose = instance.pose + far
    instants = instants + far
    together = [np.concatenate([instants[k], instants[k + 1]]) for k in range(4)]
    pair = radiances(world, together, True, monkeypatch, envs=2)
    single = radiances(world, instants, False, monkeypatch)
    for k in range(4):
        np.testing.assert_array_equal(pair[k][0], single[k][0])
        np.testing.assert_array_equal(pair[k][1], single[k + 1][0])


def test_five_hundred_bodies_and_two_hundred_thousand_triangles():
    """A sphere of spheres round the camera: what a ray meets is the one of 560 whose centre is nearest to it."""
    count, rings = 560, 14
    golden = np.pi * (3 - np.sqrt(5))
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    centres = 10 * np.stack([np.sqrt(1 - z * z) * np.cos(golden * k), np.sqrt(1 - z * z) * np.sin(golden * k), z], -1)
    mesh = sphere(0.25, rings)
    world = scene([(mesh, n, 0) for n in range(count)], bodies=count, view=camera(160, 120, 60.0))
    world.materials = [Material("m", np.ones(3))]
    visibility = Visibility(world, world.cameras[0])
    assert len(visibility.geometry.triangles) > 200_000
    eye = at(0, 0, 0, (0.4, 0.3, 0.2))
    visibility.update(np.concatenate([se3.make_pose(centres, np.array([0, 0, 0, 1.0])), eye[None]])[None])
    hits = visibility.hits()["instance"][0]
    y, x = np.indices(hits.shape)
    k = world.cameras[0].k
    d = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones(x.shape)], -1)
    d = se3.rotate(eye[3:], d / np.linalg.norm(d, axis=-1, keepdims=True))
    miss = np.linalg.norm(np.cross(d[:, :, None], centres), axis=-1)
    miss[(d @ centres.T) < 0] = np.inf
    nearest = miss.argmin(-1)
    # The facets of a ball lie between its radius and that times cos(pi / 28) twice.
    inside, outside = miss.min(-1) < 0.25 * 0.98, miss.min(-1) > 0.25
    np.testing.assert_array_equal(hits[inside], nearest[inside])
    assert (hits[outside] == -1).all() and inside.sum() > 200


def test_more_than_tens_of_movers_and_no_still_instance():
    world, instants = crowd(movers=60, still=0)
    world.instances.pop()
    layered, fresh = Renderer(world, world.cameras[0]), Renderer(world, world.cameras[0])
    for before, instant in pairwise(instants):
        one = {name: image.copy() for name, image in layered.render(instant, before, ALL).items()}
        two = fresh.render(instant, before, ALL)
        for name in ALL:
            np.testing.assert_array_equal(one[name], two[name])
