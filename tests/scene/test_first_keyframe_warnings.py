"""What is told of a scene at the first keyframe: meshes that are inside out, pictures of nothing."""

import numpy as np
import pytest
import trimesh

from evis.scene import load_scene
from evis.scene.mesh.closed import is_inside_out, surrounds
from evis.scene.model import Mesh
from evis.scene.view.first_look import FirstLook

CAMERA = "cameras: {cam0: {position: [0, -2, 0], look_at: [0, 0, 0], fov: 40 deg, near: NEAR}}\n"
REST = "materials: {paint: {albedo: 0.5}, both: {albedo: 0.5, two_sided: true}}\nenvironment: 1\n"


def ball(turned=False):
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.3)
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1] if turned else mesh.faces, process=False)


def look(folder, shape, camera=CAMERA, near=0.001):
    (folder / "s.yaml").write_text(f"{camera.replace('NEAR', str(near))}{REST}bodies: {{it: {{shapes: [{shape}]}}}}\n")
    scene = load_scene(str(folder / "s.yaml"))
    poses = np.array([body.trajectory.pose(np.zeros(1, np.int64))[0] for body in scene.bodies])
    return FirstLook(scene).lines(scene.cameras[0], poses)


@pytest.mark.parametrize("kind", ["stl", "obj", "glb"])
def test_a_closed_mesh_that_is_inside_out_is_told(tmp_path, kind):
    """Which is which is trimesh's word. Not told where both sides are drawn, nor of a room about the camera; a mirror
    turns nothing, since the reader turns the faces back."""
    for turned in (False, True):
        assert (ball(turned).volume < 0) == turned
        ball(turned).export(tmp_path / f"b.{kind}")
        lines = look(tmp_path, f"{{shape: mesh, file: b.{kind}, material: paint}}")
        assert len(lines) == turned and all("faces of 'it' are turned inwards" in line for line in lines)
        assert len(look(tmp_path, f"{{shape: mesh, file: b.{kind}, material: paint, scale: [-1, 1, 1]}}")) == turned
        assert look(tmp_path, f"{{shape: mesh, file: b.{kind}, material: both}}") == []
        within = look(tmp_path, f"{{shape: mesh, file: b.{kind}, material: paint, scale: 20}}")
        assert not any("turned inwards" in line for line in within) and len(within) == (not turned)


def test_open_meshes_and_hollow_solids_are_not_taken_for_it():
    half = ball(turned=True)
    half = trimesh.Trimesh(half.vertices, half.faces[half.triangles_center[:, 2] > 0], process=False)
    hollow = trimesh.util.concatenate([ball(), ball(turned=True).apply_scale(0.5)])
    for mesh, expected in ((ball(turned=True), True), (half, False), (hollow, False)):
        assert is_inside_out(Mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32))) == expected


def test_a_scene_of_which_nothing_is_drawn_is_told(tmp_path):
    """A sky is something to be seen."""
    for sky, told in (("environment: 1", 1), ("environment_map: {kind: sky}", 0)):
        (tmp_path / "s.yaml").write_text(f"{CAMERA.replace('NEAR', '0.1')}{sky}\n")
        scene = load_scene(str(tmp_path / "s.yaml"))
        poses = np.array([body.trajectory.pose(np.zeros(1, np.int64))[0] for body in scene.bodies])
        lines = FirstLook(scene).lines(scene.cameras[0], poses)
        assert lines == ["camera 'cam0' sees nothing at the start: nothing in the scene is drawn"] * told


def test_a_picture_of_nothing_is_told(tmp_path):
    """The ball of 0.3 m reaches to 2.3 m before the camera: with a near of 2.2 m some of it is there, with 2.4 none. A
    camera that looks away says where the ball is in its own frame."""
    shape = "{shape: sphere, radius: 0.3, material: paint}"
    assert look(tmp_path, shape) == [] and look(tmp_path, shape, near=2.2) == []
    (line,) = look(tmp_path, shape, near=2.4)
    assert "'cam0' sees nothing at the start: 'it' is within 2.3 m of it, and near is 2.4 m" in line
    (line,) = look(tmp_path, shape, CAMERA.replace("[0, 0, 0]", "[1, -2, 0]"))
    assert "'it', the nearest to its picture, is 2 m left, 0 m below, 0 m ahead" in line
    edge = CAMERA.replace("look_at: [0, 0, 0]", "look_at: [0.9, 0, 0]")  # beside the middle, in the picture still
    assert look(tmp_path, shape, edge) == []
    fisheye = CAMERA.replace(
        "fov: 40 deg", "fov: 180 deg, distortion: {model: equidistant, coefficients: [0, 0, 0, 0]}"
    )
    assert look(tmp_path, shape, fisheye) == [] and len(look(tmp_path, shape, fisheye, near=2.4)) == 1


@pytest.mark.parametrize("repeat, told", [(1, 0), (4e4, 0), (2e5, 1), (1e9, 1)])
def test_a_texture_that_is_repeated_too_often_is_told(tmp_path, repeat, told):
    """Whether two places a texel apart, at the far end of the plane, have different coordinates of 24 bits."""
    turn = "rotation: {axis: [1, 0, 0], angle: 90 deg}"
    (tmp_path / "s.yaml").write_text(
        f"{CAMERA.replace('NEAR', '0.001')}environment: 1\n"
        "materials: {paint: {texture: {kind: checker, size: 256}}}\n"
        f"world: [{{shape: plane, size: [1, 1], repeat: [{repeat}, 1], material: paint, {turn}}}]\n"
    )
    end = np.float32(repeat)
    assert (np.float32(repeat - 1 / 256) == end) == bool(told)
    scene = load_scene(str(tmp_path / "s.yaml"))
    poses = np.array([body.trajectory.pose(np.zeros(1, np.int64))[0] for body in scene.bodies])
    lines = FirstLook(scene).lines(scene.cameras[0], poses)
    assert len(lines) == told and all("'world' is repeated up to" in line and "65536 times" in line for line in lines)


def test_a_camera_within_a_solid_is_told(tmp_path):
    """As of a file in millimetres. What is inside of a ring is known in closed form, also of its hole."""
    ball().apply_scale(1000).export(tmp_path / "b.stl")
    (line,) = look(tmp_path, "{shape: mesh, file: b.stl, material: paint}")
    assert "sees nothing at the start: it is inside of 'it', up to 1.04e+03 m large" in line and "scale: 0.001" in line
    assert look(tmp_path, "{shape: mesh, file: b.stl, material: paint, scale: 0.001}") == []
    assert look(tmp_path, "{shape: mesh, file: b.stl, material: both}") == []
    ring = trimesh.creation.torus(1.0, 0.3)
    mesh = Mesh(ring.vertices.astype(np.float32), ring.faces.astype(np.int32))
    points = np.array([[0, 0, 0], [1, 0, 0], [0.75, 0.1, 0.1], [0.69, 0, 0], [1, 0, 0.31], [-0.8, 0.6, 0.2]])
    inside = (np.hypot(points[:, 0], points[:, 1]) - 1.0) ** 2 + points[:, 2] ** 2 < 0.3**2
    assert [surrounds(mesh, point) for point in points] == inside.tolist()
    lid = Mesh(mesh.vertices, mesh.faces[:-1])
    assert not surrounds(lid, points[1])


def test_what_is_seen_from_behind_is_told(tmp_path):
    """A plane faces +z: the camera is before it, behind it, or sees both sides."""
    for angle, material, told in ((90, "paint", 0), (-90, "paint", 1), (-90, "both", 0)):
        turn = f"rotation: {{axis: [1, 0, 0], angle: {angle} deg}}"
        lines = look(tmp_path, f"{{shape: plane, size: [1, 1], material: {material}, {turn}}}")
        assert len(lines) == told and all("'it' is seen from behind" in line for line in lines)
