"""Shadow rays by grids over what lights see: against the trees' answers bit for bit, and against closed form."""

import numpy as np
import pytest
import warp as wp
from renderer_scenes import at, camera, poses, quad, scene, sphere

from evis.geometry import se3
from evis.scene.mesh.shapes import rounded_box
from evis.scene.model import WORLD, Light, Material, Mesh
from nodes.renderer.lighting import Shading
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shading.options import ShadingOptions
from nodes.renderer.shadows.grid import SIDE, SIGNS, ShadowGrid, fill

FLOOR = 2.5


def spot(name, place, direction, cone):
    return Light(name, "spot", np.full(3, 4.0), np.array(place), direction=np.array(direction), cone=(0.8 * cone, cone))


def ball(radius, place, rings=10):
    mesh = sphere(radius, rings)
    mesh.vertices[:] += np.array(place, np.float32)
    return mesh


def room(still, moving, lights):
    """Balls of the world and moving ones before a floor, seen by a camera that moves."""
    floor = quad(4, 4)
    floor.vertices[:, 2] = FLOOR
    materials = [Material("grey", np.full(3, 0.5), two_sided=True)]
    meshes = [(floor, WORLD, 0), *((mesh, WORLD, 0) for mesh in still), *((m, k, 0) for k, m in enumerate(moving))]
    return scene(meshes, len(moving), materials, lights, camera(85, 61, 60.0), still_camera=False)


LIGHTS = [
    spot("above", (0.2, 0.1, -0.5), (0.1, 0, 1), 1.0),
    # Balls lie on both sides of the plane through it, and one touches it.
    spot("between", (-0.9, 0.05, 1.3), (1.0, 0.1, 0.2), 1.3),
    spot("narrow", (0.5, -0.3, 0.2), (-0.2, 0.2, 1), 0.2),
    # In the midst of the balls, and one of them is less than 2 cm away.
    Light("amid", "point", np.full(3, 2.0), np.array([0.3, 0.1, 1.5])),
    Light("slanting", "directional", np.full(3, 1.0), np.array([0.5, -0.3, 0.8])),
    # Along the floor: boxes lie behind one another.
    Light("low", "directional", np.full(3, 1.0), np.array([1.0, 0.0, 0.05])),
]


@pytest.fixture
def without_grids(monkeypatch):
    """Gives what has every ray go by trees."""
    return lambda: monkeypatch.setattr(ShadowGrid, "suits", staticmethod(lambda *given: False))


@pytest.mark.parametrize("split", [False, True])
@pytest.mark.parametrize(("far", "posts"), [(0.0, False), (400.0, False), (0.0, True)])
def test_grids_hide_what_trees_do(far, posts, split, without_grids):
    """far: how far away the camera is [m]; rounding is then more than the grid has room for, and everything is tried.
    posts: what moves are thin and turned boxes, else balls. split: rays in a pass of their own."""
    grid = np.random.default_rng(5)
    still = [ball(0.12, p) for p in grid.uniform((-1.2, -0.9, 0.9), (1.2, 0.9, 2.2), (24, 3))]
    still.append(ball(0.1, (-0.83, 0.05, 1.3)))
    still.append(ball(0.05, (0.3, 0.165, 1.5)))
    thin = rounded_box(np.array([0.05, 0.9, 0.08]), 0.01)
    world = room(still, [Mesh(thin.vertices, thin.faces) if posts else sphere(0.1, 8)] * 5, LIGHTS)
    if far:
        view = world.cameras[0]
        view.k[:2, :2] *= far / 2
    spread = grid.uniform((-1.0, -0.7, 0.8), (1.0, 0.7, 2.2), (2, 5, 3))
    # One is beside all that stands still, where no cell of a directional light is.
    spread[:, 0] = (7.0, 0.2, 2.0)
    turns = grid.uniform(-2, 2, (2, 5, 3)) * posts
    placed = [[at(*p, turn) for p, turn in zip(*both)] for both in zip(spread, turns)]
    now = np.concatenate([poses(*placed[e], at(0.1 * e, 0.05, -far)) for e in (0, 1)])
    images = []
    for trees in (False, True):
        if trees:
            without_grids()
        visibility = Visibility(world, world.cameras[0], 2)
        shading = Shading(visibility, ShadingOptions(split=split))
        for bodies in (now[::-1], now):
            shading.update(visibility.update(np.ascontiguousarray(bodies)))
            image = wp.zeros(visibility.shape, dtype=wp.vec3, device="cpu")
            shading.shade(image)
        images.append(image.numpy())
        if not trees:
            assert all(ShadowGrid.suits(visibility, shading.occluders, light) for light in range(len(LIGHTS)))
            assert shading.features.grids != split
        if shading.shadow_pass is not None:
            hidden = shading.shadow_pass.shadow_mask.numpy()
            assert all(((hidden >> bit) & 1).any() for bit in range(len(LIGHTS)))
    assert np.array_equal(*images)


@pytest.mark.parametrize("parallel", [False, True])
def test_cells_hold_the_boxes_that_are_seen_in_them_and_hardly_others(parallel):
    """By points spread through thin boxes at all angles, some of them beside or behind the light."""
    rng, tall = np.random.default_rng(3), 1.7
    turns = se3.to_matrix(se3.normalize(rng.normal(size=(60, 4))))
    middles = rng.uniform((-3, -3, -0.5), (3, 3, 4), (60, 3))
    half = np.array([0.02, 0.03, 0.8])
    corners = middles[:, None] + np.einsum("nij,kj->nki", turns, SIGNS * half)
    starts, entries = fill(corners, tall, parallel, 1e-9)
    cells = np.repeat(np.arange(SIDE * SIDE), np.diff([*starts, len(entries)]))
    listed = set(zip(entries[:, 0].tolist(), cells.tolist()))
    seen: set[tuple[int, int]] = set()
    for n in range(60):
        points = middles[n] + rng.uniform(-1, 1, (100_000, 3)) * half @ turns[n].T
        points = points[points[:, 2] > 0.02]
        at = points[:, :2] / (tall if parallel else tall * points[:, 2:])
        place = np.floor((at[(np.abs(at) < 1).all(axis=1)] + 1) * (SIDE / 2)).astype(int)
        seen |= {(n, cell) for cell in np.unique(place[:, 1] * SIDE + place[:, 0]).tolist()}
    assert seen <= listed
    ahead = {n for n in range(60) if (corners[n, :, 2] > 0.02).all()}
    assert 20 < len(ahead) < 60
    of_these = [sum(n in ahead for n, _ in found) for found in (listed, seen)]
    # More by those that a box touches with a corner alone, or an edge.
    assert of_these[0] < 1.35 * of_these[1]


SUN = np.array([0.9, -0.4, 1.0])
LAMP = np.array([-0.2, 0.1, 0.0])


@pytest.mark.parametrize("kind", ["spot", "point", "directional"])
@pytest.mark.parametrize("moves", [False, True])
def test_shadow_of_a_ball_on_a_floor(moves, kind):
    """The floor's points whose way to the light passes the ball's centre by less than its radius, and no others."""
    radius, centre = 0.3, np.array([0.15, -0.1, 1.4])
    lamps = {
        "spot": spot("lamp", LAMP, (0, 0, 1), 1.2),
        "point": Light("lamp", "point", np.full(3, 4.0), LAMP),
        "directional": Light("sun", "directional", np.full(3, 4.0), SUN),
    }
    corners = [ball(0.02, (x, y, 2.4)) for x in np.linspace(3.0, 3.9, 5) for y in np.linspace(3.0, 3.9, 4)]
    still = corners if moves else [*corners, ball(radius, centre, 48)]
    world = room(still, [sphere(radius, 48)] if moves else [], [lamps[kind]])
    visibility = Visibility(world, world.cameras[0])
    shading = Shading(visibility, ShadingOptions(split=True, remember=False))
    eye = at(0, 0, 0, (0.05, -0.04, 0.3))
    shading.update(visibility.update(poses(*([at(*centre)] if moves else []), eye)))
    assert ShadowGrid.suits(visibility, shading.occluders, 0)
    assert shading.shadow_pass is not None
    shading.place()
    shading.placed()
    shading.shadow_pass.launch()
    hidden = (shading.shadow_pass.shadow_mask.numpy()[0] & 1) == 1
    depth = (visibility.packed.numpy()[0] >> np.uint64(32)).astype(np.uint32).view(np.float32)
    y, x = np.mgrid[: depth.shape[0], : depth.shape[1]]
    k = world.cameras[0].k
    rays = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones(x.shape)], -1)
    points = se3.transform(eye, rays * depth[..., None].astype(np.float64))
    floor = np.abs(points[..., 2] - FLOOR) < 1e-4
    way = np.broadcast_to(SUN, points.shape) if kind == "directional" else points - LAMP
    way = way / np.linalg.norm(way, axis=-1, keepdims=True)
    beside = np.linalg.norm(np.cross(way, centre - points), axis=-1)
    # Within the cone, and not at the edge, where the ball is a polyhedron.
    inside, outside = (
        floor & (beside < 0.98 * radius),
        floor & (beside > 1.001 * radius) & ((kind != "spot") | (way[..., 2] > np.cos(1.19))),
    )
    assert inside.sum() > 100 and outside.sum() > 1000
    assert hidden[inside].all()
    assert not hidden[outside].any()
