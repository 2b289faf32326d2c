"""Meshes of the primitive shapes: closed, outward, of the right volume, with usable uv and normals."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from evis.scene import SceneError, load_scene
from evis.scene.mesh import shapes


def rounded_volume(size, r):
    """Steiner's formula of the inner box: V + S r + (edges / 4) pi r^2 ... = box, slabs, quarter cylinders, a ball."""
    a, b, c = np.asarray(size) - 2 * r
    return a * b * c + 2 * r * (a * b + b * c + c * a) + np.pi * r**2 * (a + b + c) + 4 / 3 * np.pi * r**3


SOLIDS = {
    "box": (shapes.box(np.array([1.0, 2.0, 3.0])), 6.0),
    "rounded box": (shapes.rounded_box(np.array([1.0, 2.0, 3.0]), 0.3), rounded_volume([1.0, 2.0, 3.0], 0.3)),
    "sphere": (shapes.sphere(0.5), np.pi / 6),
    "ellipsoid": (shapes.ellipsoid(np.array([0.5, 1.0, 2.0])), 4 / 3 * np.pi),
    "cylinder": (shapes.cylinder(0.5, 2.0), np.pi / 2),
    "capsule": (shapes.capsule(0.5, 1.0), np.pi / 4 + np.pi / 6),
}


def corners(mesh):
    return mesh.vertices[mesh.faces].astype(np.float64)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_face_outwards(name):
    """Signed volume close below the true one (chords cut inside), and no open edge."""
    mesh, volume = SOLIDS[name]
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    signed = np.sum(a * np.cross(b, c)) / 6
    assert 0.95 * volume < signed <= volume * (1 + 1e-6)
    _, index = np.unique(np.round(mesh.vertices, 5), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(e) for e in edges} == {tuple(e) for e in edges[:, ::-1]}
    assert len(mesh.faces) < 800


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_point_outwards_and_are_unit(name):
    """Smooth ones agree with the faces they lie on within the angle of one facet."""
    mesh, _ = SOLIDS[name]
    if mesh.normals is None:
        return
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    assert np.abs(np.linalg.norm(mesh.normals, axis=-1) - 1).max() < 1e-6
    assert np.sum(mesh.normals * flat[:, None], axis=-1).min() > 0.8


def test_sphere_normals_are_radial():
    """And those of an ellipsoid are the gradient of x^2/a^2 + y^2/b^2 + z^2/c^2."""
    mesh = shapes.sphere(2.0)
    assert np.abs(mesh.normals - corners(mesh) / 2.0).max() < 1e-6
    radii = np.array([0.5, 1.0, 2.0])
    mesh = shapes.ellipsoid(radii)
    gradient = corners(mesh) / radii**2
    assert np.abs(mesh.normals - gradient / np.linalg.norm(gradient, axis=-1, keepdims=True)).max() < 1e-5


def test_flat_shapes_face_up_with_the_texture_upright():
    """+z, and uv grows with x and y."""
    for mesh, extent in (
        (shapes.disk(0.5), np.array([1.0, 1.0])),
        (shapes.plane(np.array([4.0, 2.0])), np.array([4.0, 2.0])),
    ):
        a, b, c = np.moveaxis(corners(mesh), 1, 0)
        assert np.all(np.cross(b - a, c - a)[:, 2] > 0)
        assert np.abs(mesh.uv - (0.5 + corners(mesh)[..., :2] / extent)).max() < 1e-6
    assert len(shapes.disk(0.5).faces) == 128


def test_disk_area():
    """128 chords: sin(2 pi / 128) / (2 pi / 128) of the circle's area, 0.04 % less."""
    a, b, c = np.moveaxis(corners(shapes.disk(1.0)), 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum()
    assert np.isclose(area, 64 * np.sin(2 * np.pi / 128), rtol=1e-6)


def test_box_faces_show_the_whole_texture_unmirrored():
    """On every face u and v run once from 0 to 1, and u x v points outwards."""
    mesh = shapes.box(np.ones(3))
    for triangle, uv in zip(corners(mesh), mesh.uv.astype(np.float64)):
        edges, turn = triangle[1:] - triangle[0], uv[1:] - uv[0]
        along = np.linalg.solve(turn, edges)  # d(point)/du, d(point)/dv
        assert np.allclose(np.linalg.norm(along, axis=-1), 1)
        assert np.cross(along[0], along[1]) @ triangle.mean(axis=0) > 0


def test_a_rounded_box_lies_within_its_radius():
    """Every vertex is `radius` from the inner box, and no radius beyond half of the shortest edge is taken."""
    size, radius = np.array([1.0, 2.0, 3.0]), 0.3
    points = shapes.rounded_box(size, radius).vertices.astype(np.float64)
    inner = 0.5 * size - radius
    assert np.allclose(np.linalg.norm(points - np.clip(points, -inner, inner), axis=-1), radius, atol=1e-6)
    assert np.allclose(np.ptp(points, axis=0), size)
    with pytest.raises(ValueError, match=r"at most 0\.5 m"):
        shapes.rounded_box(size, 0.6)


@pytest.mark.parametrize("size", [(1.0, 2.0, 3.0), (0.9, 0.54, 0.65), (1.0, 1.5, 0.05), (0.6, 0.6, 0.6)])
@pytest.mark.parametrize("part", [0.01, 0.2, 0.5])
def test_no_corner_of_a_rounded_box_lies_outside_a_face(size, part):
    """Its surface is that of the convex hull of its vertices, as SciPy finds that."""
    mesh = shapes.rounded_box(np.array(size), part * min(size))
    points, faces = mesh.vertices.astype(np.float64), corners(mesh)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = normal @ points.T - (normal * faces[:, 0]).sum(1)[:, None]
    assert height.max() < 1e-6
    hull = ConvexHull(points)
    area = 0.5 * np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1).sum()
    assert np.isclose(area, hull.area, rtol=1e-6)


def test_tiles_have_the_same_size_on_every_face():
    """One turn of uv is 0.5 m along both directions of each face."""
    mesh = shapes.box(np.array([1.0, 2.0, 3.0]), 0.5)
    for triangle, uv in zip(corners(mesh), mesh.uv.astype(np.float64)):
        edges, turn = triangle[1:] - triangle[0], uv[1:] - uv[0]
        assert np.allclose(np.linalg.norm(edges, axis=-1), 0.5 * np.linalg.norm(turn, axis=-1))


@pytest.mark.parametrize(
    "old, new, words",
    [
        ("[1, 0, 0]", "[1.0e+39, 0, 0]", ": vertices must be a list of [a, b, c] with finite numbers up to 1e+30"),
        ("[0, 1, 2]", "[0, 1, 1.0e+30]", ": faces must be whole numbers from 0 to 2"),
        ("[0, 1, 2]", "[0, 1, 1]", " cannot be made: no triangle has an area"),
        ("[0, 1, 0]", "[2, 0, 0]", " cannot be made: no triangle has an area"),
    ],
)
def test_numbers_that_no_mesh_can_hold_name_their_place(tmp_path, recwarn, old, new, words):
    """Beyond single precision and whole numbers, and without any area, in one line and without a warning of numpy's."""
    mesh = "{shape: mesh, vertices: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]], material: m}"
    text = f"cameras: {{cam0: {{fov: 1}}}}\nmaterials: {{m: {{}}}}\nworld:\n  - {mesh.replace(old, new)}\n"
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(str(tmp_path / "s.yaml"))
    assert f"s.yaml:4: shape 1{words}" in str(caught.value) and not len(recwarn)
