"""Sub-frames' z-buffers made of keyframes' points: against places that are known in closed form."""

import numpy as np
import pytest
import warp as wp

from bench.visibility.forward import Forward
from bench.visibility.kernels import HOLE, SKY
from bench.visibility.subframes import compared
from evis.geometry import se3
from evis.scene.model import Body, Camera, Instance, Material, Mesh, Scene
from evis.scene.motion import Prescribed
from nodes.renderer.raster.visibility import Visibility

WIDTH, HEIGHT, FOCAL, DEPTH = 64, 48, 50.0, 2.0
PX = DEPTH / FOCAL
"""Width of a pixel at DEPTH [m]."""


def pose(x=0.0, z=0.0, angle=0.0):
    return se3.make_pose(np.array([x, 0.0, z]), se3.exp(np.array([0.0, 0.0, angle])))


def scene(mesh, model="none", coefficients=()):
    """One thing on body 0 before a camera at the origin, body 1; nothing else but sky."""
    k = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
    bodies = [Body("thing", None), Body("cam0", Prescribed(pose()))]
    things = [Instance("thing", 0, mesh, 0)]
    view = Camera("cam0", WIDTH, HEIGHT, k, 1e-3, model, coefficients)
    return Scene("test", bodies, things, [Material("white", np.ones(3), two_sided=True)], [], [view], np.ones(3))


def rectangle(half_width, half_height):
    x, y = half_width, half_height
    corners = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], np.float32)
    return Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], np.int32))


def disc(radius, segments=200):
    angle = 2 * np.pi * np.arange(segments) / segments
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    faces = np.array([(0, 1 + i, 1 + (i + 1) % segments) for i in range(segments)], np.int32)
    return Mesh((np.concatenate([[[0, 0, 0]], rim]) * radius).astype(np.float32), faces)


def moved(world, ends, between, footprint="1 px", view=None, device="cpu"):
    """Z-buffers of sub-frames: thing poses at both keyframes, and between; camera poses alike in `view`."""
    eyes = [pose()] * (2 + len(between)) if view is None else view
    keyframes = []
    one = Visibility(world, world.cameras[0], device=device, layered=False)
    for place, eye in zip(ends, eyes):
        one.update(np.array([[place, eye]]))
        keyframes.append((wp.clone(one.packed), wp.clone(one.poses)))
    many = Visibility(world, world.cameras[0], len(between), device=device)
    exact = many.update(np.stack([np.array([place, eye]) for place, eye in zip(between, eyes[2:])]))
    assert exact is not None
    forward = Forward(many, len(between), footprint)
    forward.draw(many.poses, keyframes)
    return forward, many


def split(packed):
    """Whether something, sky or nothing was moved to a pixel, and its depth."""
    packed = packed.numpy()
    depth = (packed >> np.uint64(32)).astype(np.uint32).view(np.float32)
    hole, sky = packed == np.uint64(HOLE), packed == np.uint64(SKY)
    return ~hole & ~sky, sky, hole, depth


STEPS = range(1, 4)


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
@pytest.mark.parametrize("footprint,wider", [("1 px", 0), ("3x3 px", 1), ("3x3 px, into holes only", 0)])
def test_a_plane_that_moves_sideways(footprint, wider, device):
    """By whole pixels: columns 22 + i ... 41 + i and rows 14 ... 33 show it at sub-frame i, all else the sky."""
    world = scene(rectangle(10 * PX, 10 * PX))
    ends = pose(0.0, DEPTH), pose(4 * PX, DEPTH)
    forward, _ = moved(world, ends, [pose(i * PX, DEPTH) for i in STEPS], footprint, device=device)
    thing, sky, hole, depth = split(forward.packed)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    for i, seen, above, none, z in zip(STEPS, thing, sky, hole, depth):
        true = (x >= 22 + i - wider) & (x <= 41 + i + wider) & (y >= 14 - wider) & (y <= 33 + wider)
        assert (seen == true).all() and (above == ~true).all() and not none.any()
        assert np.allclose(z[true], DEPTH, rtol=1e-6)


def test_what_both_keyframes_hide_is_a_hole():
    """A plane that goes three pixels aside and back uncovers three columns of 20 pixels that no keyframe shows."""
    world = scene(rectangle(10 * PX, 10 * PX))
    forward, exact = moved(world, (pose(0.0, DEPTH), pose(0.0, DEPTH)), [pose(3 * PX, DEPTH)])
    _, _, hole, _ = split(forward.packed)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    assert (hole[0] == ((x >= 22) & (x < 25) & (y >= 14) & (y <= 33))).all()
    forward.settle(exact.packed)
    assert (forward.packed.numpy() >> np.uint64(32) == exact.packed.numpy() >> np.uint64(32)).all()


@pytest.mark.parametrize("degrees", [1.0, 30.0, 90.0])
def test_a_disc_that_turns_stays_one(degrees):
    """Its rim is where it was, whatever the angle; a point is half a pixel's diagonal off at most, its depth exact."""
    world = scene(disc(18 * PX))
    turn = np.deg2rad(degrees)
    places = [pose(0.0, DEPTH, turn * share) for share in (0.0, 1.0, 0.3, 0.5)]
    forward, _ = moved(world, places[:2], places[2:], "3x3 px, into holes only")
    thing, sky, hole, depth = split(forward.packed)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    radius = np.hypot(x - (WIDTH - 1) / 2, y - (HEIGHT - 1) / 2)
    assert not hole.any()
    assert thing[:, radius < 18 - 1].all() and sky[:, radius > 18 + 1].all()
    marked = np.where(depth < 0, -depth, depth)
    assert np.allclose(marked[:, radius < 17], DEPTH, rtol=1e-6)


def test_a_sky_only_turns():
    """A camera that is carried sees the sky where it was; of one that turns, every pixel's ray is turned back and
    projected in float64, and what none of them comes to is a hole."""
    world = scene(rectangle(1e-4, 1e-4))
    away = pose(0.0, -5.0)
    carried, _ = moved(world, (away, away), [away], view=[pose(), pose(1.0), pose(0.5)])
    assert split(carried.packed)[1].all()
    aside = se3.make_pose(np.zeros(3), se3.exp(np.array([0.02, 0.05, 0.1])))
    turned, _ = moved(world, (away, away), [away], view=[pose(), pose(), aside])
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    middle = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
    rays = np.stack([(x - middle[0]) / FOCAL, (y - middle[1]) / FOCAL, np.ones(x.shape)], -1)
    back = se3.transform(se3.inverse(aside), rays)
    u, v = np.floor(FOCAL * back[..., :2] / back[..., 2:] + middle + 0.5).astype(int).transpose(2, 0, 1)
    inside = (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
    reached = np.zeros((HEIGHT, WIDTH), bool)
    reached[v[inside], u[inside]] = True
    assert 0.02 < 1 - reached.mean() < 0.3
    assert (split(turned.packed)[1][0] == reached).all()


def test_shares_by_hand():
    """Of eight pixels: one hole, two wrong (one of them sky), one of the other four depths is off by a percent."""

    def packed(depths, triangles):
        bits = np.array(depths, np.float32).view(np.uint32).astype(np.uint64)
        return bits << np.uint64(32) | np.array(triangles, np.int32).view(np.uint32).astype(np.uint64)

    exact = packed([2.0] * 7 + [np.inf], [0, 1, 2, 2, 2, 2, 0, -1])
    exact[7] = HOLE
    seen = packed([2.0, 2.0, 2.02, 1.0, 1.0, 1.0, 2.0, np.inf], [1, 0, 3, 0, -1, 2, 1, -1])
    seen[5] = HOLE
    found = compared(seen, exact, np.array([0, 0, 1, 1]))
    assert found["holes"] == 1 / 8 and found["wrong instance"] == 2 / 8
    assert found["depth off"] == 1 / 4 and found["median"] == 0.0


def test_a_lens_is_refused():
    world = scene(rectangle(1.0, 1.0), "plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="cam0 has distortion"):
        Forward(Visibility(world, world.cameras[0]), 1, "1 px")
