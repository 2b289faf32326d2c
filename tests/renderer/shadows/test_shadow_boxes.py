"""Boxes and rectangles that are tried as such: none is taken for one that is not, and rays meet what they did."""

import itertools

import numpy as np
import pytest
import warp as wp

from evis.scene.model import Mesh
from nodes.renderer.shadows.boxes import half_of
from nodes.renderer.shadows.ray_kernels import hits_box_side


def sheet(cells, k=2, sign=1, size=(2.0, 3.0, 4.0), at=None):
    """Triangles of one side of a box, `cells` x `cells` squares of them, each with corners of its own."""
    axes = [axis for axis in range(3) if axis != k]
    steps = np.linspace(-0.5, 0.5, cells + 1)
    triangles = []
    for (a, b), (c, d) in itertools.product(itertools.pairwise(steps), repeat=2):
        for uv in (((a, c), (b, c), (b, d)), ((a, c), (b, d), (a, d))):
            points = np.zeros((3, 3))
            points[:, axes] = np.array(uv) * np.array(size)[axes]
            points[:, k] = (0.5 * sign * size[k]) if at is None else at
            # Counter-clockwise seen from outside.
            triangles.append(points if (sign > 0) == (k != 1) else points[::-1])
    return np.array(triangles)


def mesh(*triangles, shift=(5.0, -1.0, 2.0)):
    points = np.concatenate(triangles).reshape(-1, 3) + shift
    return Mesh(points.astype(np.float32), np.arange(len(points), dtype=np.int32).reshape(-1, 3))


SIDES = [(k, sign) for k in range(3) for sign in (-1, 1)]


def box(cells=1, leave=()):
    return [sheet(cells, k, sign) for n, (k, sign) in enumerate(SIDES) if n not in leave]


@pytest.mark.parametrize("cells", [1, 5])
def test_boxes_and_rectangles_are_found_in_however_many_triangles(cells):
    np.testing.assert_allclose(half_of(mesh(*box(cells))), [1.0, 1.5, 2.0], rtol=1e-6)
    for k in range(3):
        half = np.array([1.0, 1.5, 2.0])
        half[k] = 0.0
        np.testing.assert_allclose(half_of(mesh(sheet(cells, k, at=0.0))), half, rtol=1e-6)
    empty = Mesh(mesh(*box()).vertices, np.zeros((0, 3), np.int32))
    assert not half_of(empty).any(), "without faces there is nothing to meet"


def turned(triangles, angle):
    c, s = np.cos(angle), np.sin(angle)
    return [t @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) for t in triangles]


def without(triangles, n):
    whole = np.concatenate(triangles)
    return [np.delete(whole, n, axis=0)]


def twice(triangles, kept, lost):
    """A triangle stands twice, and another of the same area is missing."""
    whole = np.concatenate(triangles)
    return [np.concatenate([np.delete(whole, lost, axis=0), whole[kept : kept + 1]])]


def dented(triangles):
    whole = np.concatenate(triangles).copy()
    whole[np.abs(whole - whole[0, 0]).max(-1) < 1e-9] *= 0.9
    return [whole]


@pytest.mark.parametrize(
    "triangles",
    [
        box(leave=[3]),
        box(4, leave=[0]),
        turned(box(), 0.3),
        turned(box(), 1e-4),
        without(box(4), 7),
        without([sheet(4, 2, at=0.0)], 7),
        twice([sheet(4, 2, at=0.0)], 3, 8),
        twice(box(), 0, 1),
        dented(box()),
        dented(box(3)),
        [*box(), sheet(1, 2, at=0.0)],
        [*box(), 0.5 * sheet(1, 2, at=0.0)],
        [sheet(1, 2, at=0.0), sheet(1, 2, at=0.1)],
        [sheet(1, 0, at=0.0), sheet(1, 1, at=0.0)],
        [sheet(2, 2, at=0.0)[:1]],
    ],
)
def test_nothing_else_is(triangles):
    """A side, a triangle or a corner that is missing, turned, doubled or besides."""
    assert not half_of(mesh(*triangles)).any()


@wp.kernel(enable_backward=False)
def meet(
    half: wp.vec3,
    mesh_id: wp.uint64,
    start: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    length: wp.array(dtype=float),
    met: wp.array2d(dtype=int),
):
    """Tells which rays meet a box, by its sides and by its triangles."""
    n = wp.tid()
    if hits_box_side(half, start[n], direction[n], length[n]):
        met[0, n] = 1
    if wp.mesh_query_ray_anyhit(mesh_id, start[n], direction[n], length[n]):
        met[1, n] = 1


def least_gap(half, start, direction, length):
    """How near [m] a ray is to deciding otherwise: to a side's edge where it passes its plane, or to its own ends."""
    with np.errstate(divide="ignore", invalid="ignore"):
        gaps = []
        for k, sign in SIDES:
            t = (sign * half[k] - start[:, k]) / direction[:, k]
            at = start + t[:, None] * direction
            others = [axis for axis in range(3) if axis != k]
            beside = (np.abs(at) - half)[:, others].max(1)
            gaps.append(
                np.nan_to_num(np.minimum(np.abs(beside), np.minimum(np.abs(t), np.abs(t - length))), nan=np.inf)
            )
    return np.min(gaps, axis=0)


@pytest.mark.parametrize("flat", [False, True])
def test_rays_meet_a_box_as_they_meet_its_triangles(flat):
    """From outside and inside, along the axes too, short and without end, but what is within 1e-5 of an edge."""
    rng = np.random.default_rng(11)
    count = 20_000
    half = np.array([1.0, 1.5, 0.0 if flat else 2.0])
    given = mesh(sheet(3, 2, at=0.0) if flat else np.concatenate(box(3)), shift=(0.0, 0.0, 0.0))
    start = rng.uniform(-4, 4, (count, 3))
    aim = rng.uniform(-1.2, 1.2, (count, 3)) * half
    direction = aim - start
    direction[: count // 4] = rng.normal(size=(count // 4, 3))
    along = slice(count // 4, count // 2)
    direction[along] = np.eye(3)[rng.integers(0, 3, count // 4)] * rng.choice([-1.0, 1.0], (count // 4, 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    length = np.where(rng.random(count) < 0.3, 1.0e30, rng.uniform(0.1, 8.0, count))
    points = wp.array(given.vertices, dtype=wp.vec3, device="cpu")
    tree = wp.Mesh(points=points, indices=wp.array(given.faces.reshape(-1), dtype=wp.int32, device="cpu"))
    met = wp.zeros((2, count), dtype=int, device="cpu")
    vectors = [wp.array(v.astype(np.float32), dtype=wp.vec3, device="cpu") for v in (start, direction)]
    lengths = wp.array(length.astype(np.float32), dtype=float, device="cpu")
    wp.launch(meet, count, [wp.vec3(*half), tree.id, *vectors, lengths], [met], device="cpu")
    by_sides, by_triangles = met.numpy()
    sure = least_gap(half, start, direction, length) > 1e-5
    assert sure.mean() > 0.99 and 0.1 < by_sides.mean() < 0.9
    assert (by_sides == by_triangles)[sure].all()
