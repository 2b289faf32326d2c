"""Boxes within convex things, which spare rays their triangles: within them, of closed surfaces alone, and rays meet
what they did."""

import numpy as np
import pytest
import warp as wp
from scipy.spatial import ConvexHull

from evis.geometry import se3
from evis.scene.mesh import shapes
from evis.scene.model import Body, Camera, Instance, Material, Mesh, Scene
from evis.scene.motion import Prescribed
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import core_halves
from nodes.renderer.shadows.occlusion import Occluders
from nodes.renderer.shadows.ray_kernels import Casters, hits_instance

COUNT = 20_000
NEAR = 1e-5
"""Distance [m] within which a ray may go one way or the other: float32 rounds by less."""


def hull(seed):
    """A convex mesh of random points about the origin, its faces counter-clockwise seen from outside."""
    points = np.random.default_rng(seed).normal(size=(30, 3)) * (0.5, 0.3, 0.2)
    found = ConvexHull(points)
    faces = found.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("nk,nk->n", np.cross(b - a, c - a), found.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points.astype(np.float32), faces.astype(np.int32))


MESHES = {
    "rounded box": shapes.rounded_box(np.array([0.9, 0.54, 0.65]), 0.012),
    "thin rounded box": shapes.rounded_box(np.array([1.0, 1.5, 0.05]), 0.02),
    "ellipsoid": shapes.ellipsoid(np.array([0.2, 0.5, 1.0])),
    "cylinder": shapes.cylinder(0.3, 1.0),
    "hull": hull(1),
    "flat hull": hull(2),
}


def occluders(mesh, place=(0.3, -0.2, 4.0), turn=(0.4, -0.8, 0.3)):
    """Makes the occluders of one turned thing before a camera at the origin, and its pose there."""
    pose = se3.make_pose(np.array(place), se3.exp(np.array(turn)))
    bodies = [Body("thing", Prescribed(pose)), Body("cam0", Prescribed(se3.IDENTITY))]
    camera = Camera("cam0", 16, 12, np.array([[16.0, 0, 8], [0, 16.0, 6], [0, 0, 1]]))
    things = [Instance("thing", 0, mesh, 0)]
    scene = Scene("one", bodies, things, [Material("plain", np.ones(3))], [], [camera], np.zeros(3))
    v = Visibility(scene, camera)
    found = Occluders(v, np.ones(1, bool), True)
    found.update(v.update(np.stack([pose, se3.IDENTITY])[None]))
    return v, found


def without(mesh, face):
    return Mesh(mesh.vertices, np.delete(mesh.faces, face, axis=0), None, None)


@pytest.mark.parametrize("name", MESHES)
def test_a_core_is_large_and_within_its_mesh(name):
    v, _ = occluders(MESHES[name])
    core = core_halves(v)[0]
    points = v.geometry.vertices.astype(np.float64)
    planes = ConvexHull(points).equations
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    height = (signs * core) @ planes[:, :3].T + planes[:, 3]
    assert height.max() < 0
    # It touches a face, or nearly: nothing of its shape could be much larger.
    assert height.max() > -1e-3
    assert (core > 0.1 * np.abs(points).max(axis=0)).all()


@pytest.mark.parametrize("face", [0, 100, 587])
def test_what_has_a_hole_has_no_core(face):
    """A ray through the hole would meet less than the core tells."""
    v, _ = occluders(without(MESHES["rounded box"], face))
    assert not core_halves(v).any()


def test_what_is_bent_inwards_has_no_core():
    mesh = MESHES["rounded box"]
    points = mesh.vertices.copy()
    points[np.abs(points - points[40]).max(axis=1) < 1e-6] *= 0.8
    v, _ = occluders(Mesh(points, mesh.faces))
    assert not core_halves(v).any()


@wp.kernel(enable_backward=False)
def meet(
    casters: Casters,
    start: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    length: wp.array(dtype=float),
    met: wp.array(dtype=int),
):
    n = wp.tid()
    met[n] = wp.where(hits_instance(casters, 0, 0, start[n], direction[n], length[n], 0.0), 1, 0)


def crossings(corners, start, direction, length):
    """Whether rays meet any triangle (Moeller and Trumbore, 1997, in float64), and how near each is to doing otherwise:
    to an edge of a triangle, or to its own ends [m]."""
    met, near = np.zeros(len(start), bool), np.full(len(start), np.inf)
    for a, b, c in corners:
        e, f = b - a, c - a
        p = np.cross(direction, f)
        det = p @ e
        with np.errstate(divide="ignore", invalid="ignore"):
            s = start - a
            u = np.einsum("nk,nk->n", s, p) / det
            q = np.cross(s, e)
            w = np.einsum("nk,nk->n", direction, q) / det
            t = (q @ f) / det
        inside = np.minimum(np.minimum(u, w), 1 - u - w)
        met |= (inside >= 0) & (t >= 0) & (t <= length)
        size = min(np.linalg.norm(e), np.linalg.norm(f), np.linalg.norm(b - c))
        edge = np.abs(inside) * size
        ends = np.minimum(np.abs(t), np.abs(t - length))
        near = np.fmin(near, np.where(inside > -1e-3, np.fmin(ends, np.inf), np.inf))
        near = np.fmin(near, np.where((t > -NEAR) & (t < length + NEAR), edge, np.inf))
    return met, near


@pytest.mark.parametrize("name", MESHES)
def test_rays_meet_a_convex_thing_as_they_meet_its_triangles(name):
    """From outside and inside, short and long, but what is within NEAR of an outline or of its own ends. Edges within
    the outline count for nothing, as another triangle is beside them."""
    v, found = occluders(MESHES[name])
    rng = np.random.default_rng(5)
    turn = v.rotation.numpy()[0, 0].astype(np.float64)
    centre = v.translation.numpy()[0, 0].astype(np.float64)
    corners = v.geometry.vertices[v.geometry.triangles].astype(np.float64) @ turn.T + centre
    size = np.abs(v.geometry.vertices).max()
    start = centre + rng.uniform(-2, 2, (COUNT, 3)) * size
    aim = centre + rng.uniform(-1, 1, (COUNT, 3)) * np.abs(v.geometry.vertices).max(axis=0) @ turn.T
    direction = (aim - start) / np.linalg.norm(aim - start, axis=1, keepdims=True)
    start, direction = start.astype(np.float32).astype(np.float64), direction.astype(np.float32).astype(np.float64)
    length = rng.uniform(0.2, 5, COUNT).astype(np.float32) * np.float32(size)
    arrays = [wp.array(x.astype(np.float32), dtype=wp.vec3, device="cpu") for x in (start, direction)]
    met = wp.empty(COUNT, dtype=wp.int32, device="cpu")
    given = [found.casters, *arrays, wp.array(length, dtype=float, device="cpu")]
    wp.launch(meet, COUNT, given, [met], device="cpu")
    expected, near = crossings(corners, start, direction, length)
    differ = met.numpy().astype(bool) != expected
    assert 0.1 < expected.mean() < 0.9
    assert not (differ & (near > NEAR)).any()
    assert differ.mean() < 1e-3
