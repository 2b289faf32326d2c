"""Images do not depend on what was rendered before: a run against renderers that have seen nothing yet."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from renderer_scenes import ALL, at, camera, poses, quad, scene, sphere

from evis.scene import load_scene
from evis.scene.model import WORLD, Light, Material
from nodes.renderer.renderer import LAST, Renderer


def room(still_camera=True):
    """A wall, a ball that moves, and one that could but does not."""
    wall = quad(4, 4)
    wall.vertices[:, 2] = 2.0
    lights = [Light("bulb", "point", np.array([4.0, 4, 4]), np.array([-0.5, 0.2, 0.0]))]
    meshes = [(wall, WORLD, 0), (sphere(0.2, 12), 0, 0), (sphere(0.1, 8), 1, 0)]
    grey = [Material("grey", np.full(3, 0.5), two_sided=True)]
    return scene(meshes, 2, grey, lights, camera(96, 72, 80.0), still_camera=still_camera)


def instant(ball=0.0, eye=0.0):
    return poses(at(ball, 0, 1.2), at(0.4, 0.2, 1.5), at(eye, 0, 0, (0, eye, 0)))


RUN = [
    instant(),
    instant(0.05),
    # What was still is put elsewhere, which shows in the motion of this instant and of no later one.
    instant(0.05, 0.1),
    instant(0.10, 0.1),
    instant(0.10, 0.1),
    instant(0.15, 0.1),
    instant(0.15, 0.0),
    instant(0.20, 0.0),
]


@pytest.mark.parametrize("still_camera", [True, False])
def test_every_image_is_as_if_it_were_the_first(still_camera):
    world = room(still_camera)
    renderer = Renderer(world, world.cameras[0])
    for before, now in zip([None, *RUN], RUN):
        got = {name: image.copy() for name, image in renderer.render(now, before, ALL).items()}
        fresh = Renderer(world, world.cameras[0]).render(now, before, ALL)
        for name in ALL:
            np.testing.assert_array_equal(got[name], fresh[name], err_msg=name)


def test_the_background_of_a_camera_at_rest_does_not_move():
    world = room()
    renderer = Renderer(world, world.cameras[0])
    for before, now in pairwise(RUN):
        out = renderer.render(now, before, ("motion", "ids"))
        wall = out["ids"] == 1
        assert wall.mean() > 0.5
        moved = not np.array_equal(now[:, -1], before[:, -1])
        assert np.any(out["motion"][wall]) == moved


def test_last_stands_for_the_poses_of_the_last_call():
    world = room()
    one, other = (Renderer(world, world.cameras[0]) for _ in range(2))
    one.prepare(ALL)
    assert not one.render(RUN[0], LAST, ("motion",))["motion"].any()
    other.render(RUN[0])
    for before, now in pairwise(RUN):
        got = one.render(now, LAST, ("motion",))["motion"].copy()
        np.testing.assert_array_equal(got, other.render(now, before, ("motion",))["motion"])


def test_other_poses_than_the_last_may_be_previous():
    world = room()
    renderer = Renderer(world, world.cameras[0])
    renderer.render(RUN[3])
    got = renderer.render(RUN[1], RUN[0], ALL)["motion"].copy()
    np.testing.assert_array_equal(got, Renderer(world, world.cameras[0]).render(RUN[1], RUN[0], ALL)["motion"])


def test_a_warp_array_that_is_given_is_given_back():
    world = room()
    renderer = Renderer(world, world.cameras[0])
    given = wp.empty(renderer.shape, dtype=wp.float32, device="cpu")
    out = renderer.render(RUN[0], None, ("depth", "ids"), {"depth": given})
    assert out["depth"] is given and isinstance(out["ids"], np.ndarray)
    np.testing.assert_array_equal(given.numpy(), renderer.render(RUN[0], None, ("depth",))["depth"])


@pytest.mark.parametrize("name", ["tunnel_exit", "drone"])
def test_preparing_leaves_no_trace_in_the_image(name):
    """Kernels are loaded on poses that are nobody's: trees of still things built then must not cast shadows later."""
    scene = load_scene(name, {"width": 48, "height": 36})
    camera = scene.camera("cam0")
    poses = np.stack([body.trajectory.pose(np.array([10_000_000]))[0] for body in scene.bodies])[None]
    fresh = Renderer(scene, camera).render(poses)["radiance"]
    prepared = Renderer(scene, camera)
    prepared.prepare({"radiance"})
    np.testing.assert_array_equal(prepared.render(poses)["radiance"], fresh)
